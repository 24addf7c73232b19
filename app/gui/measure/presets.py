"""Presets of protocol parameters: one JSON file per user, and the menu button for it."""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

from platformdirs import user_config_path
from pydantic import ValidationError
from PySide6.QtCore import Signal
from PySide6.QtWidgets import QMenu, QToolButton, QWidgetAction

from app.common import Severity
from app.gui.widgets import configure, give_menu, make_line_edit, tell
from protocols.base import Protocol, write_atomic

MAINS_SHIFT, MAINS_SHIFT_HZ = "mains_shift_hz", 3.0
"""Parameter that moves frequencies off the mains, and how far the menu moves them."""


class PresetError(Exception):
    """The presets cannot be read or written; the message names the file and the reason."""


def presets_path() -> Path:
    """Return the path of the user's presets file."""
    return user_config_path("tactor-bench", appauthor=False) / "presets.json"


@dataclass(frozen=True, slots=True)
class PresetStore:
    """Reads the file at every access: two windows may share it."""

    path: Path

    def names(self, protocol: str) -> list[str]:
        """Return the names of a protocol's presets in alphabetical order."""
        return sorted(self._read().get(protocol, {}))

    def get(self, kind: type[Protocol], name: str) -> Protocol:
        """Return the protocol with a preset's parameters.

        Raises:
            PresetError: it does not exist, or this version rejects a value in it.
        """
        values = self._read().get(kind.name, {}).get(name)
        if values is None:
            raise PresetError(f"there is no preset '{name}' of {kind.title} in {self.path}")
        try:
            return kind(**values)
        except ValidationError as error:
            fault = error.errors()[0]
            where = ".".join(str(part) for part in fault["loc"])
            raise PresetError(f"the preset '{name}' does not fit: {where}: {fault['msg']}; save it again") from error

    def save(self, name: str, protocol: Protocol) -> None:
        """Write a preset, replacing one of that name.

        Raises:
            PresetError: the file cannot be written.
        """
        presets = self._read()
        presets.setdefault(protocol.name, {})[name] = protocol.model_dump(mode="json")
        self._write(presets)

    def delete(self, protocol: str, name: str) -> None:
        """Remove a preset.

        Raises:
            PresetError: the file cannot be written.
        """
        presets = self._read()
        if presets.get(protocol, {}).pop(name, None) is not None:
            self._write(presets)

    def _read(self) -> dict[str, dict[str, dict[str, Any]]]:
        try:
            presets = json.loads(self.path.read_text("utf-8"))
        except FileNotFoundError:
            return {}
        except (OSError, ValueError) as error:
            raise PresetError(
                f"the presets {self.path} cannot be read: {error}; correct or remove that file"
            ) from error
        if not isinstance(presets, dict) or not all(isinstance(v, dict) for v in presets.values()):
            raise PresetError(f"the presets {self.path} are not presets of this program; correct or remove that file")
        return presets

    def _write(self, presets: dict[str, dict[str, dict[str, Any]]]) -> None:
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(self.path, json.dumps(presets, indent=2, ensure_ascii=False) + "\n")
        except OSError as error:
            raise PresetError(f"the presets {self.path} cannot be written: {error.strerror or error}") from error


class PresetButton(QToolButton):
    """Button with a menu of presets, filled when it is opened.

    Args:
        presets: the lab's own sets of parameters.
        current: returns the form's protocol.
    """

    preset_chosen = Signal(object)

    def __init__(self, presets: PresetStore, current: Callable[[], Protocol | None]) -> None:
        super().__init__()
        self._presets, self._current = presets, current
        self.kind: type[Protocol] | None = None
        """The protocol whose presets are offered."""
        configure(
            self,
            "measure.presets",
            kind="tool",
            text="Presets",
            toolTip="The paper's parameters, or your own",
            popupMode=QToolButton.ToolButtonPopupMode.InstantPopup,
        )
        give_menu(self, self._fill_menu)

    def _fill_menu(self, menu: QMenu) -> None:
        kind = self.kind
        if kind is None:
            return
        menu.addAction("The paper's", lambda: self.preset_chosen.emit(kind.model_validate({})))
        if MAINS_SHIFT in kind.model_fields:
            off_mains = menu.addAction(f"These, {MAINS_SHIFT_HZ:g} Hz off the mains", self._shift_off_mains)
            off_mains.setToolTip(
                "Frequencies at multiples of 50 and 60 Hz are measured beside them, apart from the hum"
            )
            off_mains.setEnabled(self._current() is not None)
        try:
            names = self._presets.names(kind.name)
        except PresetError as error:
            menu.addAction(str(error)).setEnabled(False)
            return
        for name in names:
            menu.addAction(name, partial(self._load_preset, kind, name))
        menu.addSeparator()
        menu.addAction(self._name_field(menu))
        if names:
            deletion_menu = menu.addMenu("Forget")
            for name in names:
                deletion_menu.addAction(
                    name, partial(self._report_errors, partial(self._presets.delete, kind.name, name))
                )

    def _shift_off_mains(self) -> None:
        protocol = self._current()
        if protocol is not None:
            self.preset_chosen.emit(type(protocol)(**{**protocol.model_dump(), MAINS_SHIFT: MAINS_SHIFT_HZ}))

    def _name_field(self, menu: QMenu) -> QWidgetAction:
        """Return a text field of the menu that keeps the form's parameters under the name typed into it."""
        hint = "Keep these as … (name, Enter)"
        field = make_line_edit("measure.preset-name", "name of the preset", placeholderText=hint)
        field.setMinimumWidth(32 * field.fontMetrics().averageCharWidth())
        field.setEnabled(self._current() is not None)
        field.returnPressed.connect(lambda: self._save_preset(field.text().strip()))
        action = QWidgetAction(menu)
        action.setDefaultWidget(field)
        return action

    def _save_preset(self, name: str) -> None:
        protocol = self._current()
        if protocol is None or not name:
            return
        self.menu().close()
        self._report_errors(lambda: self._presets.save(name, protocol))

    def _load_preset(self, kind: type[Protocol], name: str) -> None:
        self._report_errors(lambda: self.preset_chosen.emit(self._presets.get(kind, name)))

    def _report_errors(self, action: Callable[[], object]) -> None:
        try:
            action()
        except PresetError as error:
            tell(self, str(error), severity=Severity.ERROR)
