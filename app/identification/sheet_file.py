"""Specimen sheet files: TOML with comments, beside the runs, read and edited line by line."""

import re
from collections.abc import Collection, Mapping
from contextlib import suppress
from datetime import date
from pathlib import Path
from typing import Any

from app.common import UnitError, record_audit, to_number, truncate_text
from app.identification.specimen_sheet import GROUPS, PAPER_VALUES, SheetEntry, SpecimenSheet, Weighing, sheet_unit
from app.identification.table_one import TABLE_ONE
from model import ParameterError
from model.identification import MOUNTING_EFFECTS, format_size, parameter_spec
from protocols.base import parse_toml, read_toml_text, write_atomic
from protocols.runfile import SHEET_SUFFIX, other_specimen_message, sheet_path

TEXTS = ("serial", "batch", "photograph", "notes")
MOUNTING = "mounting"
"""Table of a sheet with the repeatability of mountings."""
ENTRY_KEYS = ("value", "uncertainty", "mass", "mass_uncertainty", "length", "length_uncertainty", "instrument", "date")
HEAD = """# Specimen sheet: prior values. Every value enters the fits of its runs with its uncertainty.
# Uncertainties are standard uncertainties (k = 1): half a graduation, or limits of error, divided by the root of 3.
# A line that begins with # is not used: the fits take the paper's Table I there, with the uncertainty of ruler, caliper or scale.
# Set a value here, or by 'tactor-bench specimen set SPECIMEN L="22.1 mm +- 0.05 mm" --instrument caliper'.

specimen = {name}
serial = ""
batch = ""           # specimens made together, compared by 'tactor-bench fleet'
photograph = ""      # path of a file, from the folder of this sheet
notes = ""
"""


class SheetError(ValueError):
    """A specimen sheet cannot be read or written; the message gives file, entry and remedy."""


def load_sheet(folder: Path | None, specimen: str) -> SpecimenSheet:
    """Return the sheet of a specimen; without a file, the sheet of Table I.

    Raises:
        SheetError: the file cannot be read, or is of another specimen.
    """
    if folder is None or not specimen:
        return SpecimenSheet(specimen)
    path = sheet_path(folder, specimen)
    if not path.exists():
        return SpecimenSheet(specimen)
    sheet = read_sheet(path)
    if sheet.specimen != specimen:
        raise SheetError(other_specimen_message(path, SHEET_SUFFIX, sheet.specimen, specimen))
    return sheet


def read_sheet(path: Path) -> SpecimenSheet:
    """Read a sheet.

    Raises:
        SheetError: it cannot be read, or an entry is invalid.
    """
    with suppress(OSError):  # an inaccessible file cannot be read, either
        if not path.is_file():
            raise SheetError(f"{path} is no file; give the specimen sheet, a TOML file")
    return parse_sheet(read_toml_text(path, f"the specimen sheet {path}", "specimen sheet", SheetError), path)


def parse_sheet(text: str, path: Path) -> SpecimenSheet:
    """Return the sheet in a TOML text.

    Raises:
        SheetError: it is not TOML, or an entry is invalid.
    """
    try:
        tables = parse_toml(text)
    except ValueError as error:
        raise SheetError(f"{path} is not valid TOML: {error}") from error
    _check_header(tables, path)
    entries: dict[str, SheetEntry] = {}
    descriptions = {}
    for group in GROUPS:
        table = tables.get(group, {})
        if not isinstance(table, dict):
            raise SheetError(f"{path}: {group} must be a table, [{group}]")
        for name, given in table.items():
            if name == "description":
                if not isinstance(given, str):
                    raise SheetError(f"{path}: description in [{group}] must be a text in quotation marks")
                descriptions[group] = given
            elif name in entries:
                raise SheetError(f"{path}: {name} is in two tables; remove one")
            else:
                entries[name] = _read_entry(f"{path}, [{group}] {name}", name, given)
    sheet = SpecimenSheet(
        tables["specimen"], entries, **{name: tables.get(name, "") for name in TEXTS}, descriptions=descriptions, path=path,
        simulated=tables.get("simulated", False), mountings=_read_mountings(tables.get(MOUNTING, {}), path),
    )  # fmt: skip
    try:
        sheet.tactor, sheet.membrane  # noqa: B018 - raises for lengths in the wrong order
    except ParameterError as error:
        raise SheetError(f"{path}: {error}") from None
    return sheet


def _read_mountings(table: Any, path: Path) -> dict[str, float]:
    """Return the repeatability of mountings by part, SI.

    Raises:
        SheetError: it is no table, or has an unknown part or a value that is no standard deviation.
    """
    if not isinstance(table, dict):
        raise SheetError(f"{path}: {MOUNTING} must be a table, [{MOUNTING}]")
    found = {}
    for part in table:
        where = f"{path}, [{MOUNTING}] {part}"
        if (effect := MOUNTING_EFFECTS.get(part)) is None:
            raise SheetError(f"{where}: there is no such part; the parts are {', '.join(MOUNTING_EFFECTS)}")
        found[part] = _number(where, part, table, effect.unit, whole=1.0)
        if not 0 < found[part] < float("inf"):
            raise SheetError(f"{where}: the standard deviation between mountings must be greater than 0")
    return found


def _check_header(tables: Mapping[str, Any], path: Path) -> None:
    """Raise SheetError for an unknown name, or for a text or mark that is none."""
    if unknown := sorted(set(tables) - {"specimen", "simulated", MOUNTING, *TEXTS, *GROUPS}):
        raise SheetError(
            f"{path}: unknown {truncate_text(', '.join(unknown))}; a specimen sheet has specimen, {', '.join(TEXTS)}, and the tables "
            f"{', '.join(f'[{group}]' for group in (*GROUPS, MOUNTING))}"
        )
    for name in ("specimen", *TEXTS):
        if not isinstance(tables.get(name, ""), str):
            raise SheetError(f"{path}: {name} must be a text in quotation marks")
    if not isinstance(tables.get("simulated", False), bool):
        raise SheetError(f"{path}: simulated must be true or false")
    if not tables.get("specimen"):
        raise SheetError(f'{path}: the name of the specimen is missing; write specimen = "T7"')


def _read_entry(where: str, name: str, given: Any) -> SheetEntry:
    example = f'{name} = {{ value = "22.1 mm", uncertainty = "0.05 mm", instrument = "caliper", date = 2026-11-20 }}'
    if not isinstance(given, dict):
        raise SheetError(f"{where}: a value needs its uncertainty: {example}")
    if unknown := sorted(set(given) - set(ENTRY_KEYS)):
        raise SheetError(f"{where}: unknown {truncate_text(', '.join(unknown))}; an entry has {', '.join(ENTRY_KEYS)}")
    weighed = None
    try:
        spec = parameter_spec(name)
        if "mass" in given:
            if spec.unit != "kg/m":
                raise SheetError(f"{where}: a mass over a length is a linear density (rho1, rho2), not {name}")
            mass, u_mass, length, u_length = (
                _number(where, key, given, unit)
                for key, unit in (("mass", "kg"), ("mass_uncertainty", "kg"), ("length", "m"), ("length_uncertainty", "m"))
            )  # fmt: skip
            if not (mass > 0 and length > 0):
                raise SheetError(f"{where}: mass and length must be greater than 0")
            weighed = Weighing(mass, u_mass, length, u_length)
            value, uncertainty = weighed.density
        else:
            value = _number(where, "value", given, spec.unit)
            uncertainty = _number(where, "uncertainty", given, spec.unit, abs(value))
        spec.check(value)
    except ParameterError as error:
        raise SheetError(f"{where}: {error}") from None
    if not 0 < uncertainty < float("inf"):
        raise SheetError(f"{where}: the uncertainty must be greater than 0; no instrument is exact")
    instrument, day = _text(where, "instrument", given), _date(where, given)
    return SheetEntry(name, value, uncertainty, instrument, day, weighed=weighed)


def _number(where: str, key: str, given: Mapping[str, Any], unit: str, whole: float | None = None) -> float:
    """Return a number of an entry in SI; `whole` is the reference of a percentage."""
    if key not in given:
        raise SheetError(f"{where}: {key} is missing")
    text = given[key]
    if isinstance(text, bool) or not isinstance(text, str | int | float):
        raise SheetError(f"{where}: {key} must be a number with its unit, in quotation marks")
    try:
        if whole is not None and str(text).strip().endswith("%"):
            return whole * to_number(str(text).strip().removesuffix("%"), "1") / 100
        return to_number(str(text).strip(), unit or "1")
    except UnitError as error:
        raise SheetError(f"{where}: {key}: {error}") from None


def _text(where: str, key: str, given: Mapping[str, Any]) -> str:
    text = given.get(key, "")
    if not isinstance(text, str):
        raise SheetError(f"{where}: {key} must be a text in quotation marks")
    return text


def _date(where: str, given: Mapping[str, Any]) -> str:
    day = given.get("date", "")
    if isinstance(day, date):
        return day.isoformat()[:10]
    try:
        return date.fromisoformat(day).isoformat() if day else ""
    except (TypeError, ValueError):
        raise SheetError(
            f"{where}: date must be a day, for example 2026-11-20, not {truncate_text(repr(day))}"
        ) from None


def sheet_template(specimen: str) -> str:
    """Return a commented sheet with Table I's values, none of them in use."""
    lines = [HEAD.format(name=_quote(specimen))]
    for group, names in GROUPS.items():
        lines.append(f'[{group}]\ndescription = ""')
        for name in names:
            entry = SheetEntry(
                name, PAPER_VALUES[name], float(TABLE_ONE[name].uncertainty or 0), TABLE_ONE[name].instrument
            )
            lines += [
                f"# {parameter_spec(name).description}; Table I: {TABLE_ONE[name].source}",
                f"#{format_entry(entry)}",
            ]
        if group == "masses":
            lines.append(
                "# or as weighed: rho1 = { mass = \"0.588 g\", mass_uncertainty = \"0.01 g\", length = \"52 mm\", length_uncertainty = \"0.3 mm\" }"
            )  # fmt: skip
        lines.append("")
    lines.append(
        f"[{MOUNTING}]  # standard deviation between one mounting of a part and the next; a line in use replaces the assumed one"
    )
    for part, effect in MOUNTING_EFFECTS.items():
        lines.append(f"#{part} = {_quote(format_size(effect.standard_deviation, None, effect.unit))}")
    return "\n".join([*lines, ""])


def format_entry(entry: SheetEntry) -> str:
    """Format an entry as a line of the file."""
    factor, unit = sheet_unit(entry.name)
    quantities = {"value": (factor * entry.value, unit), "uncertainty": (factor * entry.uncertainty, unit)}
    if (weighed := entry.weighed) is not None:
        quantities = {
            "mass": (1e3 * weighed.mass, "g"),
            "mass_uncertainty": (1e3 * weighed.mass_uncertainty, "g"),
            "length": (1e3 * weighed.length, "mm"),
            "length_uncertainty": (1e3 * weighed.length_uncertainty, "mm"),
        }
    stated = ", ".join(f"{key} = {_quote(f'{x:.9g} {shown}'.strip())}" for key, (x, shown) in quantities.items())
    day = f", date = {entry.date}" if entry.date else ""
    return f"{entry.name} = {{ {stated}, instrument = {_quote(entry.instrument)}{day} }}"


def _quote(text: str) -> str:
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return '"' + "".join(c if c.isprintable() else f"\\u{ord(c):04x}" for c in escaped) + '"'


def edit_sheet(
    path: Path,
    entries: Mapping[str, SheetEntry],
    texts: Mapping[str, str],
    removed: Collection[str] = (),
    descriptions: Mapping[str, str] | None = None,
) -> SpecimenSheet:
    """Set entries, texts and descriptions in a sheet, which keeps its other lines and comments, and return it.

    Entries that are `removed` become comments: the fits take Table I there.

    Raises:
        SheetError: the file cannot be read or written, or a line cannot be replaced.
    """
    before, descriptions = read_sheet(path), dict(descriptions or {})
    text = path.read_text("utf-8")
    for name, value in texts.items():
        text = _replace_line(text, "", name, f"{name} = {_quote(value)}")
    for group, value in descriptions.items():
        text = _replace_line(text, group, "description", f"description = {_quote(value)}", only_in_table=True)
    for entry in entries.values():
        text = _replace_line(text, group_of(entry.name), entry.name, format_entry(entry))
    for name in before.entries.keys() & set(removed):
        text = _replace_line(text, group_of(name), name, f"#{format_entry(before.entries[name])}")
    after = parse_sheet(text, path)
    expected = {name: each for name, each in {**before.entries, **entries}.items() if name not in removed}
    got = {e.name: (f"{e.value:.6g}", f"{e.uncertainty:.6g}", e.instrument, e.date) for e in after.entries.values()}
    required = {e.name: (f"{e.value:.6g}", f"{e.uncertainty:.6g}", e.instrument, e.date) for e in expected.values()}
    described = {**before.descriptions, **descriptions}
    if (
        got != required
        or any(getattr(after, name) != value for name, value in texts.items())
        or any(after.descriptions.get(group, "") != value for group, value in described.items())
    ):
        raise SheetError(f"{path} is written in a way that cannot be edited by command; edit it by hand")
    try:
        write_atomic(path, text)
    except OSError as error:
        raise SheetError(f"{path} cannot be written: {error.strerror or error}") from error
    changed = [
        *sorted(entries),
        *sorted(removed),
        *(name for name, value in texts.items() if getattr(before, name) != value),
    ]
    record_audit("specimen sheet", path, subject=after.specimen, changed=changed)
    return after


def create_sheet(folder: Path, specimen: str) -> SpecimenSheet:
    """Write the commented sheet of a specimen, with no value in use, and return it.

    Raises:
        SheetError: it is there already, or cannot be written.
    """
    path = sheet_path(folder, specimen)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with path.open("x", encoding="utf-8") as file:
            file.write(sheet_template(specimen))
    except FileExistsError:
        raise SheetError(f"{path} is there already and is not overwritten; 'specimen set' changes it") from None
    except OSError as error:
        raise SheetError(f"{path} cannot be written: {error.strerror or error}") from None
    return read_sheet(path)


def group_of(name: str) -> str:
    """Return the table of a sheet that a value belongs to."""
    groups = {each: group for group, names in GROUPS.items() for each in names}
    return groups.get(name, "masses" if name.startswith("m_add") or "mass" in name else "clamp")


def _replace_line(text: str, group: str, name: str, line: str, only_in_table: bool = False) -> str:
    """Replace the line of a key in a table, or its commented one; append it to the table, or a table to the text.

    An active key is found in any table, unless `only_in_table`.
    """
    lines, table = text.split("\n"), ""
    headers = {"": -1}
    places: dict[bool, int] = {}
    for i, each in enumerate(lines):
        if header := re.match(r"\s*\[([^\[\]]+)\]\s*(#.*)?$", each):
            table = header[1].strip()
            headers.setdefault(table, i)
        elif (
            table in ("", *GROUPS)
            and (key := re.match(rf"\s*(#?)\s*{re.escape(name)}\s*=", each))
            and (table == group or not (key[1] or only_in_table))
        ):
            places.setdefault(bool(key[1]), i)
    at = places.get(False, places.get(True))
    if at is not None:
        lines[at] = line
    elif group in headers:
        lines.insert(headers[group] + 1, line)
    else:
        lines += [f"[{group}]", line, ""]
    return "\n".join(lines)
