"""Laboratory file `laboratory.toml` in a folder of runs: name, picture, perception threshold, and the template of the reports."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from importlib.resources import files
from pathlib import Path
from typing import Annotated

from pydantic import Field, create_model

from app.common import UsageError
from app.config.validation import ConfigTable, read_toml
from drivers import open_regular
from protocols.base import read_toml_text

LABORATORY_FILE_NAME = "laboratory.toml"
"""Name of the file in the folder of the runs."""
MAX_TEXT, MAX_FILE = 4000, 100_000
LINE = Field(default="", max_length=110)
"""A text that must fit one line of a page."""

EXAMPLE_LABORATORY = files("app.config").joinpath("laboratory.toml.template").read_text("utf-8")


@dataclass(frozen=True, slots=True)
class Laboratory:
    """Settings of a laboratory's file; all of them are optional.

    Attributes:
        logo: path of a PNG picture.
        threshold: of perception, as `--threshold` takes it; a CSV file with its folder.
        header, footer: a line on every page of a report.
        style: style sheet of the HTML report, behind the program's own.
        template: of the HTML report, in place of the program's own; empty without one.
        sections: names of the sections behind the first page, in order; empty for the usual ones.
        texts: title and text of the laboratory's own sections, by name.
    """

    name: str = ""
    logo: Path | None = None
    threshold: str = ""
    header: str = ""
    footer: str = ""
    style: str = ""
    sections: tuple[str, ...] = ()
    texts: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    template: str = ""


class _Text(ConfigTable):
    title: Annotated[str, Field(min_length=1, max_length=110)]
    text: Annotated[str, Field(min_length=1, max_length=MAX_TEXT)]


class _Report(ConfigTable):
    header: Annotated[str, LINE] = ""
    footer: Annotated[str, LINE] = ""
    style: str = ""
    template: str = ""
    sections: tuple[str, ...] = ()
    texts: Mapping[str, _Text] = Field(default_factory=dict)


_File = create_model(
    "Laboratory file",
    __base__=ConfigTable,
    name=(Annotated[str, LINE], ""),
    logo=(str, ""),
    threshold=(str, ""),
    report=(_Report, Field(default_factory=_Report)),
)


def read_laboratory(folder: Path) -> Laboratory:
    """Return the settings in the laboratory file of a folder of runs; without such a file they are empty.

    Raises:
        UsageError: the file cannot be read, or has faults, which are all listed.
    """
    path = folder / LABORATORY_FILE_NAME
    text = read_toml_text(path, str(path), "laboratory file", UsageError, missing="")
    read = read_toml(_File, text, str(path), UsageError).model_dump()
    threshold, report = read["threshold"], read["report"]
    if threshold.casefold().endswith(".csv"):
        threshold = str(folder / threshold)
    return Laboratory(
        read["name"],
        folder / read["logo"] if read["logo"] else None,
        threshold,
        report["header"],
        report["footer"],
        _read_style(folder, report["style"]),
        tuple(report["sections"]),
        {name: (each["title"], each["text"]) for name, each in report["texts"].items()},
        _read_file(folder, "template", report["template"]),
    )


def _read_style(folder: Path, name: str) -> str:
    """Return a style sheet.

    Raises:
        UsageError: it cannot be read, is too long, or would end the element that contains it.
    """
    text = _read_file(folder, "style", name)
    if "<" in text:
        raise UsageError(f"the style sheet {folder / name} has a '<'; give plain CSS")
    return text


def _read_file(folder: Path, key: str, name: str) -> str:
    """Return the text of a file that the laboratory file names; nothing without a name.

    Raises:
        UsageError: it cannot be read, or is too long.
    """
    if not name:
        return ""
    try:
        with open_regular(folder / name, "r", encoding="utf-8") as file:
            text: str = file.read(MAX_FILE + 1)
    except (OSError, ValueError) as error:
        raise UsageError(
            f"{folder / name} cannot be read: {error}; correct `{key}` in {LABORATORY_FILE_NAME}"
        ) from None
    if len(text) > MAX_FILE:
        raise UsageError(f"{folder / name}, the `{key}` of {LABORATORY_FILE_NAME}, has more than {MAX_FILE} characters")
    return text
