"""Writes docs/reference from the code: protocols, commands, the run file, the Python API; and the lists of decisions and of pictures.

`python docs/make_reference.py`

tests/docs/test_documentation.py fails where these pages are not what this script writes.
"""

import argparse
import ast
import inspect
import os
import re
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import h5py  # noqa: E402

import tactor_bench as tb  # noqa: E402
from app.cli.main import complete_parser  # noqa: E402
from app.gui.widgets.form import format_parameter, protocol_fields  # noqa: E402
from model.parameter_spec import parameter_specs  # noqa: E402
from protocols.base import Protocol  # noqa: E402
from protocols.registry import PROTOCOLS  # noqa: E402
from protocols.runfile.schema import point_columns  # noqa: E402

MADE = "<!-- Written by docs/make_reference.py from the code. -->\n\n"
LISTED = "<!-- Written by docs/make_reference.py from the files beside it. -->\n\n"


def main() -> int:
    for name, text in pages():
        (HERE / name).parent.mkdir(exist_ok=True)
        (HERE / name).write_text(text, "utf-8")
        print(HERE / name)
    return 0


def pages() -> Iterator[tuple[str, str]]:
    """Every page by its place below docs/."""
    yield "reference/protocols.md", MADE + "# Protocols\n\n" + "\n".join(protocol(kind) for kind in PROTOCOLS.values())
    yield "reference/commands.md", MADE + "# Commands\n\n" + "\n".join(commands())
    yield "reference/run-file.md", MADE + run_file()
    yield "reference/python.md", MADE + python_api()
    yield "decisions/README.md", LISTED + decisions()
    yield "pictures/README.md", LISTED + pictures()


def protocol(kind: type[Protocol]) -> str:
    """One protocol: what it does, its parameters, its points."""
    defaults = kind.model_validate({})
    lines = [f"## {kind.title}: `{kind.name}`", "", cell(kind.__doc__ or ""), ""]
    high = "The specimen gets high voltage." if kind.high_voltage else "High voltage stays off."
    lines += [high, "", "| parameter | default | range | meaning |", "|---|---|---|---|"]
    for field in protocol_fields(kind):
        default = cell(format_parameter(getattr(defaults, field.name)) + (f" {field.unit}" if field.unit else ""))
        limits = field.limits or (", ".join(field.choices) if field.choices else "")
        lines.append(f"| `{field.name}` | {default} | {cell(limits)} | {cell(field.description)} |")
    lines += ["", "| column of a point | unit | meaning |", "|---|---|---|"]
    for name, (unit, words, width) in point_columns(kind.point_type).items():
        several = f" ({width} values)" if width else ""
        lines.append(f"| `{name}` | {unit} | {cell(words)}{several} |")
    return "\n".join([*lines, ""])


def commands() -> Iterator[str]:
    """The help of every command, as the program prints it."""
    os.environ["COLUMNS"] = "100"
    for name, parser in every_parser("tactor-bench", complete_parser()):
        yield f"## `{name}`\n\n```text\n{parser.format_help().rstrip()}\n```\n"


def every_parser(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, child in action.choices.items():
                yield from every_parser(f"{name} {word}", child)


def run_file() -> str:
    """What stands in a run file, taken from one."""
    from protocols.base.quality import Quality
    from protocols.measurements.sine_dwell import SineDwell
    from tests.helpers.simulated_bench import laboratory, run

    lines = [
        "# The run file",
        "",
        "One HDF5 file a run, NeXus at heart: a NeXus viewer opens it to a plot. Below is everything that stands in the file",
        "of a sine dwell; other protocols have other columns under `points`.",
        "",
        "Raw samples are integers as the card gave them. `displacement_scaling_factor` and `displacement_offset` beside them",
        "turn them into metres by NeXus' rule; the card's own polynomial is in `..._scaling_coefficients` (volts).",
        "`status` is `running` until the run ends: a file that still says so, without its program, tells of a crash. Nothing raw",
        "is ever rewritten; what is identified later is appended under `estimates`.",
        "",
        "The version of the format is the attribute `format_version` of the file (`FORMAT_VERSION` in protocols/runfile/schema.py). A reader",
        "ignores groups, datasets without units, attributes and kinds of events that it does not know; a file of a newer version is",
        "refused with the advice to install a newer program.",
        "",
        "A run that was imported has `/entry/imported` besides, JSON: source files with SHA-256, columns and units, cautions. It has no",
        "samples, no events and no instruments, and NaN for what its table did not tell.",
        "",
        "`points/quality` is a sum of flags; 0 is good. Those marked with * are facts, and leave a value usable:",
        "",
        ", ".join(
            f"{flag.value} {(flag.name or '').lower().replace('_', ' ')}{'*' if flag.usable else ''}"
            for flag in Quality
        )
        + ".",
        "",
        "| path | type | unit | meaning |",
        "|---|---|---|---|",
    ]

    def tell(name: str, item: Any) -> None:
        if isinstance(item, h5py.Group):
            kind, unit, words = str(item.attrs.get("NX_class", "group")), "", ""
        else:
            size = " x ".join("n" if most is None else str(most) for most in item.maxshape) if item.shape else ""
            kind = "text" if item.dtype.kind in "OS" else str(item.dtype) if item.dtype.names is None else "table"
            kind = f"{kind} [{size}]" if size else kind
            unit, words = str(item.attrs.get("units", "")), str(item.attrs.get("long_name", ""))
            if item.dtype.names:
                words = "columns " + ", ".join(item.dtype.names)
        lines.append(f"| `/{name}` | {kind} | {unit} | {cell(re.sub(r' [(][^)]*[)]$', '', words))} |")

    with tempfile.TemporaryDirectory() as folder, laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 150, 160, 170, 200)), Path(folder), lab)
        with h5py.File(ran.path) as file:
            file.visititems(tell)
    return "\n".join([*lines, ""])


def python_api() -> str:
    """Return signatures and docstrings of the public names of `tactor_bench`."""
    lines = [
        "# Python API",
        "",
        "`import tactor_bench as tb`: [how to work with it](../how-to/work-in-a-notebook.md).",
        "",
    ]
    public = {name: getattr(tb, name) for name in tb.__all__}
    for name, value in sorted(public.items(), key=lambda item: (isinstance(item[1], type), item[0])):
        lines += [f"## `tb.{name}`", "", "```text", *api_text(name, value), "```", ""]
    return "\n".join(lines).replace("  # doctest: +SKIP", "")


def api_text(name: str, value: Any) -> Iterator[str]:
    """Yield the lines about one public name: signatures from the source, so that they are the same in every Python."""
    node = source_of(value)
    if isinstance(node, ast.FunctionDef):
        yield from signature(name, node)
    yield from (inspect.getdoc(value) or "").splitlines()
    if specs := parameters_of(value):
        yield from ["", "Parameters:"]
    for spec in specs:
        default = "" if spec.default is None else f" = {spec.default:g}"
        yield f"    {spec.name}{default} {spec.unit}: {spec.description}".rstrip()
    for kind in inspect.getmro(value) if isinstance(value, type) else ():
        for method in source_of(kind).body if kind.__module__.startswith("tactor_bench") else ():
            if isinstance(method, ast.FunctionDef) and not method.name.startswith("_"):
                shown = any(isinstance(each, ast.Name) and "property" in each.id for each in method.decorator_list)
                yield ""
                yield from [method.name] if shown else signature(method.name, method)[:1]
                yield from (f"    {line}".rstrip() for line in (ast.get_docstring(method) or "").splitlines())


def source_of(value: Any) -> ast.FunctionDef | ast.ClassDef:
    """Return the parsed definition of a function or class."""
    tree = ast.parse(Path(inspect.getfile(value)).read_text("utf-8"))
    return next(n for n in tree.body if isinstance(n, ast.FunctionDef | ast.ClassDef) and n.name == value.__name__)


def signature(name: str, node: ast.FunctionDef) -> list[str]:
    """Return a function's signature, a line for each parameter where there are many."""
    arguments = ast.unparse(node.args).removeprefix("self, ").removeprefix("self")
    returns = f" -> {ast.unparse(node.returns)}" if node.returns else ""
    return [f"{name}({arguments}){returns}", ""]


def parameters_of(kind: type) -> tuple[Any, ...]:
    """Return the annotated parameters of a dataclass of the model; none for any other class."""
    return parameter_specs(kind) if kind.__module__.startswith("model.") and is_dataclass(kind) else ()


def decisions() -> str:
    lines = ["# Decisions", "", "Why the program is built as it is, in the order of the decisions.", ""]
    for record in sorted((HERE / "decisions").glob("[0-9]*.md")):
        number, _, title = record.read_text("utf-8").partition("\n")[0].removeprefix("# ").partition(". ")
        lines.append(f"- {number}: [{title}]({record.name})")
    return "\n".join([*lines, ""])


def pictures() -> str:
    lines = ["# Pictures", "", "Taken by `docs/take_pictures.py` from the running program on its simulated bench.", ""]
    there = {picture.stem for picture in (HERE / "pictures").glob("*.png")}
    for name in sorted(n for n in there if not n.endswith(("-dark", "-large"))):
        beside = [f"{name}{look}" for look in ("-dark", "-large", "-large-dark") if f"{name}{look}" in there]
        words = name.replace("-", " ").capitalize()
        more = ", ".join(f"[{other.removeprefix(name)[1:].replace('-', ', ')}]({other}.png)" for other in beside)
        lines += [f"## {words}", "", f"![{words}]({name}.png)", "", *([f"Also: {more}.", ""] if more else [])]
    return "\n".join(lines)


def cell(text: str) -> str:
    """Words that stand in one cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")


if __name__ == "__main__":
    sys.exit(main())
