"""A lab's own sets of parameters, by protocol and name: one JSON file, readable and shareable."""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from platformdirs import user_config_path
from pydantic import ValidationError

from app.whole_file import write_whole
from protocols.protocol import Protocol


class PresetError(Exception):
    """The presets cannot be read or written. The sentence says which file and why."""


def presets_path() -> Path:
    """Where the presets of this user are kept."""
    return user_config_path("tactor-bench", appauthor=False) / "presets.json"


@dataclass(frozen=True, slots=True)
class Presets:
    """Read from the file at every question: two windows may share it."""

    path: Path

    def names(self, protocol: str) -> list[str]:
        """Names of the presets of a protocol, in alphabetical order."""
        return sorted(self._read().get(protocol, {}))

    def get(self, kind: type[Protocol], name: str) -> Protocol:
        """The protocol with a preset's parameters.

        Raises:
            PresetError: it is gone, or this version refuses a value in it.
        """
        values = self._read().get(kind.name, {}).get(name)
        if values is None:
            raise PresetError(f"there is no preset '{name}' of {kind.title} in {self.path}")
        try:
            return kind(**values)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(str(part) for part in fault["loc"])
            raise PresetError(f"the preset '{name}' does not fit: {where}: {fault['msg']}; keep it anew") from error

    def keep(self, name: str, protocol: Protocol) -> None:
        """Write a preset, in place of one of that name.

        Raises:
            PresetError: the file cannot be written.
        """
        known = self._read()
        known.setdefault(protocol.name, {})[name] = protocol.model_dump(mode="json")
        self._write(known)

    def forget(self, protocol: str, name: str) -> None:
        """Remove a preset.

        Raises:
            PresetError: the file cannot be written.
        """
        known = self._read()
        if known.get(protocol, {}).pop(name, None) is not None:
            self._write(known)

    def _read(self) -> dict[str, dict[str, dict[str, Any]]]:
        try:
            known = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise PresetError(f"the presets {self.path} cannot be read: {error}; mend or remove that file") from error
        if not isinstance(known, dict) or not all(isinstance(v, dict) for v in known.values()):
            raise PresetError(f"the presets {self.path} are no presets of this program; mend or remove that file")
        return known

    def _write(self, known: dict[str, dict[str, dict[str, Any]]]) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(self.path, json.dumps(known, indent=2, ensure_ascii=False) + "\n")
        except OSError as error:
            raise PresetError(f"the presets {self.path} cannot be written: {error.strerror or error}") from error
