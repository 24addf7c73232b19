"""Reference generator: protocols, commands, run file and Python API from the code; the lists of decisions and pictures.

`python docs/make_reference.py`

tests/docs/test_documentation.py fails if these pages differ from the output of this script.
"""

import argparse
import ast
import inspect
import os
import sys
from collections.abc import Iterator
from dataclasses import is_dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

import tactor_bench as tb  # noqa: E402
from app.cli.main import complete_parser  # noqa: E402
from app.services import format_parameter, protocol_fields  # noqa: E402
from app.session import proven_boxes, read_shared_records  # noqa: E402
from docs.run_file_page import cell, run_file  # noqa: E402
from drivers.deadlines import Deadline  # noqa: E402
from drivers.evidence.evidence_files import assumptions  # noqa: E402
from model import PARAMETERS, RESULTS  # noqa: E402
from model.parameter_spec import parameter_specs  # noqa: E402
from protocols.base import Protocol  # noqa: E402
from protocols.registry import PROTOCOLS  # noqa: E402
from protocols.runfile.schema import point_columns  # noqa: E402
from tests.drivers.command_trees import DRIVERS, status, tree  # noqa: E402

MADE = "<!-- Written by docs/make_reference.py from the code. -->\n\n"
LISTED = "<!-- Written by docs/make_reference.py from the files beside it. -->\n\n"


def main() -> int:
    for name, text in pages():
        (HERE / name).parent.mkdir(exist_ok=True)
        (HERE / name).write_text(text, "utf-8")
        print(HERE / name)
    return 0


def pages() -> Iterator[tuple[str, str]]:
    """Yield the path below docs/ and the text of every page."""
    yield "reference/protocols.md", MADE + "# Protocols\n\n" + "\n".join(protocol(kind) for kind in PROTOCOLS.values())
    yield "reference/commands.md", MADE + "# Commands\n\n" + "\n".join(commands())
    yield "reference/run-file.md", MADE + run_file()
    yield "reference/quantities.md", MADE + "\n".join(quantities())
    yield "reference/python.md", MADE + python_api()
    yield "reference/deadlines.md", MADE + deadlines()
    yield "generators.md", with_assumptions((HERE / "generators.md").read_text("utf-8"))
    yield "command-trees.md", MADE + command_trees()
    yield "decisions/README.md", LISTED + decisions()
    yield "pictures/README.md", LISTED + pictures()


BEGIN, END = "<!-- assumptions: written by docs/make_reference.py from the code -->", "<!-- end of the assumptions -->"


def with_assumptions(text: str, records: Path = HERE / "evidence" / "boxes") -> str:
    """Return the page on generators with its table of assumptions, which the shared records in a folder prove."""
    rows, boxes = assumptions(), proven_boxes(read_shared_records(records))
    quoted, at_arming = sum(bool(row.quotes) for row in rows), sum(row.at_arming is not None for row in rows)
    unproven = sum(row.is_unproven and row not in boxes for row in rows)
    lines = [
        f"{len(rows)} assumptions: {quoted} are quoted, {at_arming} are checked at every arming before high voltage (by the *card*, within the limits of the",
        f"self-test, or by the instrument's *reply*), {len(boxes)} are *proven* on boxes by shared records, and {unproven} are only *unproven*.",
        "",
        "| driver | models | property | value assumed | evidence | at arming | measured by `commission` |",
        "|---|---|---|---|---|---|---|",
    ]
    for each in rows:
        parts = [f"“{quote.text}” ({quote.document}, {quote.place})" for quote in each.quotes]
        evidence = cell("; ".join([*parts, *([each.evidence] if each.evidence else [])]))
        if count := boxes[each]:
            proven = f"*proven on {count} {'box' if count == 1 else 'boxes'}*"
            evidence = f"{proven}; {evidence}" if evidence else proven
        elif each.is_unproven and "unproven" not in evidence:
            evidence = f"{evidence}: *unproven*" if evidence else "*unproven*"
        checks, arming = "; ".join(each.checks) or "-", each.at_arming or "-"
        lines.append(
            f"| `{each.driver}` | {each.models} | {cell(each.quantity)} | {cell(each.value)} | {evidence} | {arming} | {checks} |"
        )
    before, _, rest = text.partition(BEGIN)
    return "\n".join([f"{before}{BEGIN}", "", *lines, "", f"{END}{rest.partition(END)[2]}"])


def command_trees() -> str:
    """Return the page of the command trees of the generators."""
    lines = [
        "# Command trees of the generators",
        "",
        "Every header of each family that a public source names, and what the driver does with it: *set* by arming, *asked* by it, *neutral* for a reason, seen by",
        "the *card* in the self-test at every arming (with the effect), or *unproven*. The trees are `docs/evidence/commands/*.toml`; `tests/drivers/test_command_trees.py`",
        "finds headers that are unaccounted, and plants the effect of each that the card must see.",
    ]
    for driver in DRIVERS:
        headers = tree(driver)["headers"]
        found: dict[tuple[str, str], list[str]] = {}
        for header in headers:
            found.setdefault(status(driver, header), []).append(header)
        lines += [
            "",
            f"## {driver}",
            "",
            f"{len(headers)} headers. Source: {tree(driver)['source']}. Complete: {tree(driver)['complete']}.",
            "",
            "| status | reason or effect | headers |",
            "|---|---|---|",
            *(
                f"| {what} | {why or '-'} | {', '.join(f'`{each}`' for each in names)} |"
                for (what, why), names in sorted(found.items())
            ),
        ]
    return "\n".join([*lines, ""])


def protocol(kind: type[Protocol]) -> str:
    """Return the section of one protocol: description, parameters, columns of its points."""
    defaults = kind.model_validate({})
    lines = [f"## {kind.title}: `{kind.name}`", "", cell(kind.__doc__ or ""), ""]
    high = "The specimen gets high voltage." if kind.high_voltage else "High voltage stays off."
    lines += [high, "", "| parameter | default | range | meaning |", "|---|---|---|---|"]
    for field in protocol_fields(kind):
        default = cell(format_parameter(getattr(defaults, field.name)) + (f" {field.unit}" if field.unit else ""))
        limits = field.limits or (", ".join(field.choices) if field.choices else "")
        lines.append(f"| `{field.name}` | {default} | {cell(limits)} | {cell(field.description)} |")
    lines += ["", "| column of a point | unit | meaning |", "|---|---|---|"]
    for name, (unit, description, width) in point_columns(kind.point_type).items():
        several = f" ({width} values)" if width else ""
        lines.append(f"| `{name}` | {unit} | {cell(description)}{several} |")
    return "\n".join([*lines, ""])


def quantities() -> Iterator[str]:
    """Yield the page of the quantities: parameters, then results of runs and figures of merit."""
    yield from (
        "# Quantities",
        "",
        "Limits, fleet, control charts, reports, lists, exports, JSON and the Python API name quantities by these identifiers. A value",
        "is rounded to two digits of its standard uncertainty, and to the given number of digits where it has none. A name may go on with a condition",
        "behind a comma: `compliance, MFC up`.",
    )
    for title, listed in (("Results and figures of merit", RESULTS), ("Parameters", PARAMETERS)):
        yield from (
            "",
            f"## {title}",
            "",
            "| identifier | name | symbol | SI | shown in | digits | definition | in earlier files |",
            "|---|" + "---|" * 7,
        )
        for each in listed.values():
            former = ", ".join(each.former)
            yield f"| `{each.identifier}` | {each.name} | {each.symbol} | {each.unit} | {each.shown.unit} | {each.digits} | {cell(each.definition)} | {former} |"
    yield ""


def commands() -> Iterator[str]:
    """Yield the help of every command, as the program prints it."""
    os.environ["COLUMNS"] = "100"
    for name, parser in every_parser("tactor-bench", complete_parser()):
        yield f"## `{name}`\n\n```text\n{parser.format_help().rstrip()}\n```\n"


def every_parser(name: str, parser: argparse.ArgumentParser) -> Iterator[tuple[str, argparse.ArgumentParser]]:
    yield name, parser
    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for word, child in action.choices.items():
                yield from every_parser(f"{name} {word}", child)


def python_api() -> str:
    """Return signatures and docstrings of the public names of `tactor_bench`."""
    lines = [
        "# Python API",
        "",
        "`import tactor_bench as tb`: [how to use it](../how-to/work-in-a-notebook.md).",
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


def deadlines() -> str:
    lines = [
        "# Deadlines",
        "",
        "Longest real time of every call that leaves the process. A call that cannot be broken off leaves its thread behind; the run",
        "names and counts such threads, and the program then ends without waiting for them. [Safety](../safety.md) states what follows.",
        "",
        "| call | s | then |",
        "|---|---|---|",
    ]
    lines += [
        f"| {cell(each.calls)} | {each.seconds:g} | {cell(each.then or 'an error of the call')} |"
        for each in sorted(Deadline, key=lambda deadline: deadline.calls)
    ]
    return "\n".join([*lines, ""])


def decisions() -> str:
    lines = [
        "# Decisions",
        "",
        "Design decisions and their reasons, in chronological order. A record is not rewritten when the program changes: names of packages,",
        "modules and classes are those of its time. [0090](0090-packages-by-subject.md) has the present structure, the",
        "[glossary](../glossary.md) the terms.",
        "",
    ]
    for record in sorted((HERE / "decisions").glob("[0-9]*.md")):
        number, _, title = record.read_text("utf-8").partition("\n")[0].removeprefix("# ").partition(". ")
        lines.append(f"- {number}: [{title}]({record.name})")
    return "\n".join([*lines, ""])


def pictures() -> str:
    lines = ["# Pictures", "", "Taken by `docs/take_pictures.py` from the running program on its simulated bench.", ""]
    existing = {picture.stem for picture in (HERE / "pictures").glob("*.png")}
    for name in sorted(n for n in existing if not n.endswith(("-dark", "-large"))):
        variants = [f"{name}{suffix}" for suffix in ("-dark", "-large", "-large-dark") if f"{name}{suffix}" in existing]
        title = name.replace("-", " ").capitalize()
        links = ", ".join(f"[{other.removeprefix(name)[1:].replace('-', ', ')}]({other}.png)" for other in variants)
        lines += [f"## {title}", "", f"![{title}]({name}.png)", "", *([f"Also: {links}.", ""] if links else [])]
    return "\n".join(lines)


if __name__ == "__main__":
    sys.exit(main())
