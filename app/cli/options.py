"""Commands and their typed options: dataclass fields that declare arguments, and groups that commands share."""

import argparse
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, Protocol, TypeVar

from app.common import path_argument, seed_argument, specimen_argument

T = TypeVar("T")


def option(*flags: str, default: Any = None, inherited: bool = False, **keywords: Any) -> Any:
    """Declare a field as a command-line argument: positional without flags, keywords as for `add_argument`.

    An `inherited` option may also precede the command, so its own default must not overwrite that value.
    """
    if keywords.get("action") != "append":  # argparse would append to the default
        keywords["default"] = argparse.SUPPRESS if inherited else default
    return field(default=default, metadata={"flags": flags, "keywords": keywords})


def switch(name: str, text: str) -> Any:
    """Declare a field as an option without a value."""
    return option(name, default=False, action="store_true", help=text)


def repeated(name: str, metavar: str, text: str) -> Any:
    """Declare a field as an option that may be repeated."""
    return option(name, default=(), action="append", metavar=metavar, help=text)


def group(kind: type[Any], what: str = "") -> Any:
    """Declare a field as a group of options; WHAT in their help texts is replaced by `what`."""
    return field(default_factory=kind, metadata={"group": kind, "what": what})


def add_options(parser: argparse.ArgumentParser, kind: Any, what: str = "") -> None:
    """Add the options that a dataclass declares."""
    for each in fields(kind):
        if "group" in each.metadata:
            add_options(parser, each.metadata["group"], each.metadata["what"])
        if "flags" not in each.metadata:
            continue
        keywords = dict(each.metadata["keywords"])
        keywords["help"] = keywords.get("help", "").replace("WHAT", what) or None
        if flags := each.metadata["flags"]:
            keywords["dest"] = each.name
        parser.add_argument(*(flags or (each.name,)), **keywords)


def read_options(kind: type[T], namespace: argparse.Namespace) -> T:
    """Return the options of a command as its dataclass; what was not given has the default of its field."""
    declared: Any = kind
    values = {
        each.name: read_options(each.metadata["group"], namespace)
        if "group" in each.metadata
        else getattr(namespace, each.name, None)
        for each in fields(declared)
    }
    return kind(**{name: value for name, value in values.items() if value is not None})


class Command(Protocol):
    """A command: a dataclass whose fields are its options, and the method that executes it."""

    def execute(self) -> int:
        """Run the command and return its exit code."""


@dataclass(frozen=True)
class CommandSyntax:
    """How a command is parsed: its options and help text."""

    command: type[Command]
    description: str | None = None
    example: str | None = None
    negative_values: bool = False
    """Whether values such as `-500V` may follow an option."""


@dataclass(frozen=True)
class CommandGroup:
    """A command of several verbs, each with a line of help; a field `verb` of their dataclass holds the verb."""

    description: str
    example: str | None
    title: str
    metavar: str
    verbs: Mapping[str, tuple[str, CommandSyntax]]


NEGATIVE_NUMBER = re.compile(r"-\.?\d")
"""Arguments that argparse treats as negative numbers instead of options; before Python 3.14 it does not recognise `-500V`."""


def define_command(parser: argparse.ArgumentParser, syntax: CommandSyntax | CommandGroup) -> None:
    """Give the parser of a command its options, its help text and the function that runs it."""
    parser.description, parser.epilog = syntax.description, syntax.example
    if isinstance(syntax, CommandGroup):
        verbs = parser.add_subparsers(title=syntax.title, metavar=syntax.metavar, dest="verb", required=True)
        for name, (text, verb) in syntax.verbs.items():
            define_command(verbs.add_parser(name, help=text), verb)
        return
    if syntax.negative_values:
        parser._negative_number_matcher = NEGATIVE_NUMBER  # noqa: SLF001 - argparse has no public access to it
    add_options(parser, syntax.command)
    parser.set_defaults(command=lambda namespace: read_options(syntax.command, namespace).execute())


JSON_OBJECT = "one JSON object on standard output, SI units"
JSON_EVENTS = "one JSON object per event on standard output, SI units"
JSON_PLAIN = "as one JSON object on standard output"


@dataclass(frozen=True)
class BenchSelection:
    """Options that choose the bench."""

    bench: str = option(
        "--bench",
        default="sim",
        inherited=True,
        metavar="FILE|sim",
        help="bench file; 'sim' (default): simulated, with an imperfect specimen; 'ideal': simulated, the paper's specimen without imperfections",
    )
    speed: str | None = option(
        "--speed",
        inherited=True,
        metavar="N|max",
        help="simulated bench only: 1 to 20 times real speed, or 'max' (virtual clock)",
    )
    seed: int | None = option(
        "--seed", inherited=True, type=seed_argument, help="simulated bench only: seed of its noise"
    )


@dataclass(frozen=True)
class BenchOptions(BenchSelection):
    """Options that choose the bench, the specimen and the folder of run files."""

    without_commissioning: str | None = option(
        "--without-commissioning",
        inherited=True,
        metavar="REASON",
        help="real bench only: switch high voltage on although the source has no valid commissioning record; "
        "the reason is stored in every run",
    )
    out: Path | None = option(
        "--out",
        inherited=True,
        type=path_argument,
        help="folder for run files (default: runs; the window: the one used last)",
    )
    specimen: str | None = option(
        "--specimen",
        inherited=True,
        type=specimen_argument,
        help="name of the specimen (default: unnamed; the window: the one used last)",
    )
    operator: str | None = option(
        "--operator",
        inherited=True,
        metavar="NAME",
        help="who measures; remembered for today (default: who was named today, or the login of the computer)",
    )
    temperature: str | None = option(
        "--temperature", inherited=True, metavar="T", help="of the air, e.g. '23.4 °C'; remembered for today"
    )
    humidity: str | None = option(
        "--humidity", inherited=True, metavar="RH", help="of the air, e.g. '45 %%'; remembered for today"
    )
    after_run: str = option(
        "--after-run",
        default="",
        inherited=True,
        metavar="COMMAND",
        help="program to start after each run with its file, such as an upload to a lab notebook; {run} is the file, "
        "by default the last argument",
    )


@dataclass(frozen=True)
class ProtocolOptions(BenchOptions):
    """Options of a run: bench and parameters of the protocol."""

    settings: Sequence[str] = repeated(
        "--set", "NAME=VALUE", "a parameter of the protocol, with or without a unit; may be repeated"
    )


def threshold_option() -> Any:
    """Declare `--threshold` of the perception margin."""
    return option(
        "--threshold",
        default=None,
        metavar="SITE",
        help="of perception, max - min: abdomen, thenar or forearm, an amplitude such as '20 um', or a CSV file with a frequency in Hz "
        "and a threshold in µm per line (default: that of laboratory.toml beside the runs, or abdomen, the paper's 50 um)",
    )


def folder_option() -> Any:
    """Declare `--folder` of the run files."""
    return option("--folder", type=path_argument, default=Path("runs"), help="of the runs (default: runs)")


def faults_option() -> Any:
    """Declare `--fault`."""
    return repeated(
        "--fault",
        "NAME[@SECONDS]",
        "simulated bench only: inject a fault this many bench seconds after the run began (default 0); may be given "
        "often. 'tactor-bench faults' lists them",
    )


@dataclass(frozen=True)
class FileOptions:
    """Options that write a result into files."""

    csv: Path | None = option("--csv", type=path_argument, metavar="FILE", help="write WHAT as CSV, SI units")
    picture: Path | None = option("--picture", type=path_argument, metavar="PNG", help="draw WHAT")
