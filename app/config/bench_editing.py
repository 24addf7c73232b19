"""Editing of bench files: values replaced in the text, with its comments, and the folder of the user's bench files."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Self

import tomlkit
from platformdirs import user_data_path
from pydantic import BaseModel, ValidationError
from tomlkit.items import Table

from app.common import description_of, record_audit
from app.config.bench_file import SIMULATED_BENCHES, BenchConfig, ConfigError, bench_text, read_bench
from app.config.template import bench_template
from app.config.validation import validation_messages
from protocols.base import write_atomic


def benches_folder() -> Path:
    """Return the folder of the bench files of this user."""
    return user_data_path("tactor-bench", appauthor=False) / "benches"


def free_bench_path(name: str) -> Path:
    """Return the path of a new bench file for a bench of this name; no file is there."""
    stem = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-") or "bench"
    folder, number = benches_folder(), 1
    while (path := folder / f"{stem}{f'-{number}' if number > 1 else ''}.toml").exists():
        number += 1
    return path


def changed_text(text: str, before: BenchConfig, after: BenchConfig) -> str:
    """Return the text of a bench file with the values of `after` where they differ from `before`; comments stay.

    Args:
        text: of the file that holds `before`.
        before: as the text was loaded.
        after: as it is to be loaded.
    """
    document = tomlkit.parse(text)
    _write_changes(document, before, after)
    return tomlkit.dumps(document)


def _write_changes(table: Any, before: BaseModel, after: BaseModel) -> None:
    for name in type(after).model_fields:
        old, new = getattr(before, name), getattr(after, name)
        if old == new:
            continue
        if isinstance(new, BaseModel):
            if name not in table:
                table[name] = tomlkit.table()
            _write_changes(table[name], old, new)
        elif isinstance(new, list) and any(isinstance(each, BaseModel) for each in (*old, *new)):
            table.pop(name, None)
            if new:
                tables = tomlkit.aot()
                for each in new:
                    tables.append(_new_table(each))
                table[name] = tables
        elif isinstance(new, Mapping) and any(isinstance(each, BaseModel) for each in (*old.values(), *new.values())):
            table.pop(name, None)
            if new:
                table[name] = {key: _new_table(each) for key, each in new.items()}
        elif isinstance(old, Mapping) and isinstance(new, Mapping):
            _write_record(table, name, old, new)
        else:
            _write_value(table, name, new, description_of(type(after), name))


def _write_record(table: Any, name: str, before: Mapping[str, Any], after: Mapping[str, Any]) -> None:
    """Write the changes of a table that has no type of its own, such as [simulation]."""
    if name not in table:
        table[name] = tomlkit.table()
    part = table[name]
    for key in before.keys() - after.keys():
        part.pop(key, None)
    for key, new in after.items():
        old = before.get(key)
        if isinstance(new, Mapping):
            if old != new:
                _write_record(part, key, old or {}, new)
        elif old != new or key not in before:
            part[key] = new


def _new_table(record: BaseModel) -> Table:
    table = tomlkit.table()
    for name in type(record).model_fields:
        _write_value(table, name, getattr(record, name), description_of(type(record), name))
    return table


def _write_value(table: Any, name: str, value: Any, description: str) -> None:
    """Write a value; a key that is new has its description as comment."""
    is_new = name not in table
    table[name] = value
    if is_new and description and isinstance(table, Table):
        table[name].comment(description)


@dataclass(frozen=True, slots=True)
class BenchDraft:
    """A bench that is being set up: its file, if it has one, and its values as they would be saved.

    Attributes:
        name: path of the file, or one of `SIMULATED_BENCHES`; empty for a new bench.
        text: of the file, or of the template of a new bench.
        saved: the values of the text.
        config: the values as edited.
    """

    name: str
    text: str
    saved: BenchConfig
    config: BenchConfig

    @classmethod
    def load(cls, name: str) -> Self:
        """Return the draft of a bench file or of a simulated bench.

        Raises:
            ConfigError: the file is missing or wrong.
        """
        text = bench_text(name)
        config = read_bench(text, name)
        return cls(name, text, config, config)

    @classmethod
    def new(cls, simulated: bool = False) -> Self:
        """Return the draft of a new bench of real instruments, or of a simulated one."""
        text = bench_text("sim") if simulated else bench_template(())
        config = read_bench(text, "the template")
        return cls("", text, config, config)

    @property
    def edited(self) -> bool:
        """Whether the values differ from the file's."""
        return not self.name or self.config != self.saved

    @property
    def has_file(self) -> bool:
        """Whether the bench has a file of the user's."""
        return bool(self.name) and self.name not in SIMULATED_BENCHES

    def with_tables(self, **tables: Any) -> Self:
        """Return the draft with other tables.

        Raises:
            ConfigError: they contradict each other.
        """
        record = {name: getattr(self.config, name) for name in BenchConfig.model_fields} | tables
        try:
            config = BenchConfig.model_validate(
                {name: value.model_dump() if isinstance(value, BaseModel) else value for name, value in record.items()}
            )
        except ValidationError as error:
            raise ConfigError("; ".join(line.strip() for line in validation_messages(error))) from None
        return replace(self, config=config)

    def save(self) -> Self:
        """Write the file, a new one in `benches_folder` for a bench without a file of its own, and return its draft.

        Raises:
            ConfigError: it cannot be written, or was changed meanwhile by another program.
        """
        path = Path(self.name) if self.has_file else free_bench_path(self.config.name)
        try:
            if self.has_file and bench_text(self.name) != self.text:
                raise ConfigError(
                    f"{path} was changed by another program since it was opened here; nothing was written. Choose the bench "
                    "again in the list, which reads the file, and repeat the change"
                )
            text = changed_text(self.text, self.saved, self.config)
            read_bench(text, str(path))
            path.parent.mkdir(parents=True, exist_ok=True)
            write_atomic(path, text)
            record_audit("bench file", path, subject=self.config.name)
        except OSError as error:
            raise ConfigError(f"{path} cannot be written: {error.strerror or error}; choose another folder") from error
        return type(self)(str(path), text, self.config, self.config)


def bench_files() -> list[Path]:
    """Return the bench files of this user."""
    return sorted(benches_folder().glob("*.toml"))
