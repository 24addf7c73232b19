"""Commands as dataclasses: the docstring is the help text, fields declare options and arguments; types of arguments, shared groups."""

import argparse
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields
from pathlib import Path
from types import NoneType
from typing import Any, Literal, Protocol, TypeVar, dataclass_transform, get_args, get_origin

from app.common import UsageError, truncate_text

T = TypeVar("T")
C = TypeVar("C", bound="Command")

MAX_SPECIMEN_NAME_LENGTH = 200
"""Characters of a specimen's name; the name of its run file is shortened, the file itself holds all of them."""


def path_argument(text: str) -> Path:
    """Return the path of a file or folder, existing or not.

    Raises:
        argparse.ArgumentTypeError: the name is empty, too long, or in an inaccessible folder.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError("a name is missing")
    try:
        Path(text).exists()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' cannot be used: {error.strerror or error}") from None
    except ValueError:  # an embedded null
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a file") from None
    return Path(text)


def specimen_argument(text: str) -> str:
    """Return a specimen's name: one line of text.

    Raises:
        argparse.ArgumentTypeError: it is empty, too long, or has unprintable characters.
    """
    name = text.strip()
    if not name or len(name) > MAX_SPECIMEN_NAME_LENGTH or not name.isprintable():
        raise argparse.ArgumentTypeError(
            f"{truncate_text(name)!r} is not a name of a specimen; give up to {MAX_SPECIMEN_NAME_LENGTH} readable characters in one line"
        )
    return name


def seed_argument(text: str) -> int:
    """Return a seed of simulated noise: an integer from 0.

    Raises:
        argparse.ArgumentTypeError: it is not one.
    """
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**63:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' is not a seed; give a whole number from 0 on")
    return number


CONVERSIONS = {Path: path_argument, int: int, float: float}
"""Conversion of the text of an argument by the type of its field."""


@dataclass(frozen=True, slots=True)
class Declaration:
    """An argument of a command line as the value of a class attribute, until `options` makes it a field."""

    flag: str | None
    """None for a positional argument, empty for `--` and the name of the field."""
    keywords: Mapping[str, Any]
    inherited: bool = False


def option(help: str = "", default: Any = None, *, flag: str = "", inherited: bool = False, **keywords: Any) -> Any:  # noqa: A002 - as in argparse
    """Declare a field as an option; its type, and whether it is a switch or may be repeated, follow from its annotation.

    Args:
        help: text of its help.
        default: value where it is not given; an empty text, False or no item where the annotation is a text, a bool or a sequence.
        flag: its name, if that is not `--` and the name of the field.
        inherited: it may also precede the command, so its own default must not overwrite that value.
        **keywords: further arguments of `ArgumentParser.add_argument`.
    """
    return Declaration(flag, {"help": help, "default": default, **keywords}, inherited)


def argument(help: str = "", default: Any = None, **keywords: Any) -> Any:  # noqa: A002 - as in argparse
    """Declare a field as a positional argument; `keywords` as for `ArgumentParser.add_argument`."""
    return Declaration(None, {"help": help, "default": default, **keywords})


def group(kind: type[Any], subject: str = "") -> Any:
    """Declare a field as a group of options; SUBJECT in their help texts is replaced by `subject`."""
    return field(default_factory=kind, metadata={"group": kind, "subject": subject})


@dataclass_transform(frozen_default=True)
def options(kind: type[T]) -> type[T]:
    """Make a class with declared options a frozen dataclass."""
    for name, declared in tuple(vars(kind).items()):
        if isinstance(declared, Declaration):
            keywords = _keywords_of(kind.__annotations__[name], declared)
            default = keywords["default"]
            if keywords.get("action") == "append":  # argparse would append to the default
                del keywords["default"]
            elif declared.inherited:
                keywords["default"] = argparse.SUPPRESS
            flags = [] if declared.flag is None else [declared.flag or f"--{name.replace('_', '-')}"]
            setattr(kind, name, field(default=default, metadata={"flags": flags, "keywords": keywords}))
    return dataclass(frozen=True)(kind)


def _keywords_of(annotation: Any, declared: Declaration) -> dict[str, Any]:
    """Return the arguments of `add_argument`, completed by the annotation of the field."""
    kinds = [kind for kind in get_args(annotation) if kind is not NoneType] if NoneType in get_args(annotation) else []
    kind, optional = (kinds[0], True) if kinds else (annotation, False)
    implied: dict[str, Any] = {}
    default: Any = "" if kind is str and not optional else None
    if get_origin(kind) is Sequence:
        (kind,), default = get_args(kind), ()
        implied = {} if declared.flag is None else {"action": "append"}
    if get_origin(kind) is Literal:
        implied["choices"] = get_args(kind)
    elif kind is bool:
        default, implied = False, {"action": "store_true"}
    elif kind in CONVERSIONS:
        implied["type"] = CONVERSIONS[kind]
    given = {name: value for name, value in declared.keywords.items() if value is not None}
    return {"default": default, **implied, **given}


def add_options(parser: argparse.ArgumentParser, kind: Any, subject: str = "") -> None:
    """Add the options that a dataclass declares."""
    for each in fields(kind):
        if "group" in each.metadata:
            add_options(parser, each.metadata["group"], each.metadata["subject"])
        if "flags" in each.metadata:
            flags, keywords = each.metadata["flags"], dict(each.metadata["keywords"])
            keywords["help"] = keywords.get("help", "").replace("SUBJECT", subject) or None
            if flags:
                keywords["dest"] = each.name
            parser.add_argument(*(flags or (each.name,)), **keywords)


def read_options(kind: type[T], namespace: argparse.Namespace) -> T:
    """Return the options of a command as its dataclass; options not given have the defaults of their fields."""
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


@dataclass_transform(frozen_default=True)
def command(example: str = "", *, negative_values: bool = False) -> Callable[[type[C]], type[C]]:
    """Make a class a command or a verb of a group, whose docstring is its help text.

    Args:
        example: last line of the help text; of a verb, the arguments of an example.
        negative_values: whether values such as `-500V` may follow an option.
    """

    def declare(kind: type[C]) -> type[C]:
        declared = options(kind)
        setattr(declared, SYNTAX, (example, negative_values))
        return declared

    return declare


SYNTAX = "command_syntax"
"""Attribute of a command's class: example and negative values."""


@dataclass(frozen=True)
class CommandGroup:
    """A command of several verbs, each with a line of help; a field `verb` of their dataclass holds the verb."""

    description: str
    example: str
    verbs: Mapping[str, type[Command] | tuple[type[Command], str]]
    """The class of each verb; with its line of help where that is not the docstring of the class, which several verbs share."""
    title: str = "verbs"
    metavar: str = "VERB"
    negative_values: bool = False


NEGATIVE_NUMBER = re.compile(r"-\.?\d")
"""Arguments that argparse treats as negative numbers instead of options; before Python 3.14 it does not recognise `-500V`."""


def define_command(parser: argparse.ArgumentParser, syntax: type[Command] | CommandGroup) -> None:
    """Give the parser of a command its options, its help text and the function that runs it."""
    if isinstance(syntax, CommandGroup):
        parser.description, parser.epilog = syntax.description, syntax.example
        verbs = parser.add_subparsers(title=syntax.title, metavar=syntax.metavar, dest="verb", required=True)
        for name, given in syntax.verbs.items():
            verb, text = given if isinstance(given, tuple) else (given, given.__doc__ or "")
            one = verbs.add_parser(name, help=text[0].lower() + text[1:].removesuffix("."), description=text)
            one.epilog = f"example: {one.prog} {getattr(verb, SYNTAX)[0]}".strip()
            _define(one, verb, syntax.negative_values)
    else:
        parser.description = syntax.__doc__
        parser.epilog, negative_values = getattr(syntax, SYNTAX)
        _define(parser, syntax, negative_values)


def _define(parser: argparse.ArgumentParser, command: type[Command], negative_values: bool) -> None:
    if negative_values:
        parser._negative_number_matcher = NEGATIVE_NUMBER  # noqa: SLF001 - argparse has no public access to it
    add_options(parser, command)
    parser.set_defaults(command=lambda namespace: read_options(command, namespace).execute())


def split_setting(text: str, flag: str, example: str) -> tuple[str, str]:
    """Return name and value of `NAME=VALUE`.

    Raises:
        UsageError: one of them is missing; the message shows the example.
    """
    name, _, value = (part.strip() for part in text.partition("="))
    if not name or not value:
        raise UsageError(f"{flag} {text}: write NAME=VALUE, for example {flag} {example}".strip())
    return name, value


JSON_OBJECT = option("one JSON object on standard output, SI units")
JSON_EVENTS = option("one JSON object per event on standard output, SI units")
JSON_PLAIN = option("one JSON object on standard output")
CLUSTER = option("compute on all cores of this computer (local), or on a Dask cluster", metavar="ADDRESS|local")
FOLDER = option("folder of the runs (default: runs)", Path("runs"))
RUN_FILES = argument("run files", nargs="+", metavar="RUN")
FAULTS = option(
    "simulated bench only: inject a fault this many bench seconds after the begin of the run (default 0); may be "
    "repeated. 'tactor-bench faults' lists them",
    flag="--fault",
    metavar="NAME[@SECONDS]",
)
THRESHOLD = option(
    "threshold of perception, max - min: abdomen, thenar or forearm, an amplitude such as '20 um', or a CSV file with a frequency in Hz "
    "and a threshold in µm per line (default: from laboratory.toml beside the runs, or abdomen, the paper's 50 um)",
    metavar="SITE",
)


@options
class BenchSelection:
    """Options that choose the bench."""

    bench: str = option(
        "bench file; 'sim' (default): simulated, with an imperfect specimen; 'ideal': simulated, the paper's specimen without imperfections",
        "sim",
        inherited=True,
        metavar="FILE|sim",
    )
    speed: str | None = option(
        "simulated bench only: 1 to 20 times real speed, or 'max' (virtual clock)", inherited=True, metavar="N|max"
    )
    seed: int | None = option("simulated bench only: seed of its noise", inherited=True, type=seed_argument)


@options
class BenchOptions(BenchSelection):
    """Options that choose the bench, the specimen and the folder of run files."""

    without_commissioning: str | None = option(
        "real bench only: switch high voltage on although the source has no valid commissioning record; "
        "the reason is stored in every run",
        inherited=True,
        metavar="REASON",
    )
    out: Path | None = option("folder for run files (default: runs; in the window the last one used)", inherited=True)
    specimen: str | None = option(
        "name of the specimen (default: unnamed; in the window the last one used)",
        inherited=True,
        type=specimen_argument,
    )
    operator: str | None = option(
        "name of the operator, remembered for today (default: today's operator, or the login of the computer)",
        inherited=True,
        metavar="NAME",
    )
    temperature: str | None = option(
        "air temperature, e.g. '23.4 °C'; remembered for today", inherited=True, metavar="T"
    )
    humidity: str | None = option("air humidity, e.g. '45 %%'; remembered for today", inherited=True, metavar="RH")
    after_run: str = option(
        "program to start after each run with its file, such as an upload to a lab notebook; {run} is the file, "
        "by default the last argument",
        inherited=True,
        metavar="COMMAND",
    )


@options
class ProtocolOptions(BenchOptions):
    """Options of a run: bench and parameters of the protocol."""

    settings: Sequence[str] = option(
        "a parameter of the protocol, with or without a unit; may be repeated", flag="--set", metavar="NAME=VALUE"
    )


@options
class FileOptions:
    """Options that write a result into files."""

    csv: Path | None = option("write SUBJECT as CSV, SI units", metavar="FILE")
    picture: Path | None = option("draw SUBJECT", metavar="PNG")
