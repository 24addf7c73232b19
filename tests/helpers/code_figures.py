"""Figures of the product's code: complexity, names past interfaces, forms of a run, classes of series, pinned messages.

Only the text of the files is read; nothing of the product is imported.
"""

import ast
import json
import re
import subprocess
import sys
import tomllib
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("app", "drivers", "model", "protocols", "sim_hardware", "tactor_bench")

MOST_COMPLEX, MOST_LINES, MOST_PARAMETERS, MOST_METHODS = 12, 60, 8, 25
"""Limits of a function (cyclomatic complexity, lines, parameters) and of a class (methods)."""

RUN_FACTS = frozenset(
    [
        "specimen",
        "protocol",
        "operator",
        "start_time",
        "outcome",
        "state",
        "verdict",
        "estimates",
        "simulated",
        "comment",
        "conditions",
        "parameters",
        "instruments",
        "duration_s",
        "bench",
    ]
)
MOST_RUN_FACTS = 6
"""A class with this many of the facts of a run is a form of a run."""

MESSAGE_WORDS = 5
"""A string of the product with this many words is a message."""

PINNED_WORDS = 2
"""An asserted string with this many words pins each message that contains it."""

ABSCISSAE = frozenset({"x", "x_values", "frequency_hz", "frequency", "times_s", "time_s", "columns"})
ARRAYS = frozenset({"Array", "Complex", "ArrayLike"})


@dataclass(frozen=True)
class SourceTree:
    """The tracked and new Python files below some folders of a checkout, parsed."""

    root: Path
    folders: tuple[str, ...] = PACKAGES

    def files(self, suffix: str) -> list[Path]:
        """Return the paths below the root of the files with a suffix."""
        listed = subprocess.run(
            [
                "git",
                "ls-files",
                "--cached",
                "--others",
                "--exclude-standard",
                *(f"{f}/*{suffix}" for f in self.folders),
            ],
            cwd=self.root,
            capture_output=True,
            text=True,
            check=True,
        )
        return [Path(name) for name in dict.fromkeys(listed.stdout.split()) if (self.root / name).is_file()]

    @cached_property
    def modules(self) -> Mapping[Path, ast.Module]:
        """Syntax tree of each file, by its path below the root."""
        return {
            path: ast.parse((self.root / path).read_text(encoding="utf-8"), str(path)) for path in self.files(".py")
        }

    def table_texts(self) -> Iterator[str]:
        """Yield the texts of the TOML files."""
        tables: list[object] = [
            tomllib.loads((self.root / path).read_text(encoding="utf-8")) for path in self.files(".toml")
        ]
        while tables:
            value = tables.pop()
            if isinstance(value, str):
                yield value
            elif isinstance(value, dict | list):
                tables += value.values() if isinstance(value, dict) else value

    @cached_property
    def lines(self) -> Counter[str]:
        """Lines of each top-level folder."""
        count: Counter[str] = Counter()
        for path in self.modules:
            count[path.parts[0]] += len((self.root / path).read_text(encoding="utf-8").splitlines())
        return count

    def classes(self) -> Iterator[tuple[Path, ast.ClassDef]]:
        """Classes on the top level of the modules."""
        for path, tree in self.modules.items():
            yield from ((path, node) for node in tree.body if isinstance(node, ast.ClassDef))


def module_name(path: Path) -> str:
    """`app.cli` for `app/cli/__init__.py`, `app.cli.main` for `app/cli/main.py`."""
    parts = path.with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def names_past_interfaces(tree: SourceTree) -> list[str]:
    """Imports of a name from a module of a package to which the importer does not belong."""
    packages = {module_name(path) for path in tree.modules if path.name == "__init__.py"}
    modules = {module_name(path) for path in tree.modules}
    listed = {package: interface_names(tree.root / package.replace(".", "/") / "__init__.pyi") for package in packages}
    past = []
    for path, syntax in tree.modules.items():
        importer = module_name(path)
        for node in ast.walk(syntax):
            if not isinstance(node, ast.ImportFrom) or node.module is None:
                continue
            for name in node.names:
                whole = f"{node.module}.{name.name}"
                module = (
                    whole
                    if whole in modules - packages and name.name not in listed.get(node.module, ())
                    else node.module
                )
                package = module.rpartition(".")[0]
                if module in modules - packages and not f"{importer}.".startswith(f"{package}."):
                    past.append(f"{path}:{node.lineno} {whole}")
    return past


def interface_names(stub: Path) -> set[str]:
    """Names that the interface of a package lists; none without one."""
    if not stub.is_file():
        return set()
    imports = (node for node in ast.parse(stub.read_text(encoding="utf-8")).body if isinstance(node, ast.ImportFrom))
    return {name.asname or name.name for node in imports for name in node.names}


def exceptions(tree: SourceTree) -> dict[str, int]:
    """Functions and classes beyond a limit: `path:name complexity` and so on, with the value."""
    found: dict[str, int] = {}
    for path, syntax in tree.modules.items():
        for name, node in definitions(syntax):
            if isinstance(node, ast.ClassDef):
                methods = sum(isinstance(each, ast.FunctionDef | ast.AsyncFunctionDef) for each in node.body)
                figures = {"methods": (methods, MOST_METHODS)}
            else:
                every = [*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs]
                count = len(every) - (bool(every) and every[0].arg in ("self", "cls"))
                length = (node.end_lineno or node.lineno) - node.lineno + 1
                figures = {"lines": (length, MOST_LINES), "parameters": (count, MOST_PARAMETERS)}
            for kind, (value, limit) in figures.items():
                if value > limit:
                    found[f"{path}:{name} {kind}"] = value
    return found | complex_functions(tree)


def definitions(syntax: ast.Module) -> Iterator[tuple[str, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef]]:
    """Every function and class with its qualified name."""
    pending: list[tuple[str, ast.AST]] = [("", syntax)]
    while pending:
        prefix, node = pending.pop()
        for child in ast.iter_child_nodes(node):
            if isinstance(child, ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef):
                yield prefix + child.name, child
                pending.append((f"{prefix}{child.name}.", child))
            else:
                pending.append((prefix, child))


def complex_functions(tree: SourceTree) -> dict[str, int]:
    """Functions of more than the largest cyclomatic complexity, as ruff counts it."""
    setting = f"lint.mccabe.max-complexity={MOST_COMPLEX}"
    command = [sys.executable, "-m", "ruff", "check", "--select", "C901", "--ignore-noqa", "--config", setting]
    told = subprocess.run(
        [*command, "--output-format", "json", *tree.folders], cwd=tree.root, capture_output=True, text=True, check=False
    )
    found = {}
    for each in json.loads(told.stdout):
        path = Path(each["filename"]).relative_to(tree.root)
        name = next(
            name for name, node in definitions(tree.modules[path]) if each["location"]["row"] in header_rows(node)
        )
        found[f"{path}:{name} complexity"] = int(re.findall(r"\((\d+) > ", each["message"])[0])
    return found


def header_rows(node: ast.FunctionDef | ast.AsyncFunctionDef | ast.ClassDef) -> range:
    """Rows of the line with the name of a definition."""
    return range(node.lineno, node.body[0].lineno)


def run_forms(tree: SourceTree) -> list[str]:
    """Classes that have many of the facts of a run."""
    return sorted(
        f"{path}:{node.name}" for path, node in tree.classes() if len(attributes(node) & RUN_FACTS) >= MOST_RUN_FACTS
    )


def series_classes(tree: SourceTree) -> list[str]:
    """Classes that have an abscissa and at least one more array."""
    found = []
    for path, node in tree.classes():
        arrays = {
            each.target.id
            for each in node.body
            if isinstance(each, ast.AnnAssign)
            and isinstance(each.target, ast.Name)
            and {name.id for name in ast.walk(each.annotation) if isinstance(name, ast.Name)} & ARRAYS
        }
        if len(arrays) > 1 and arrays & ABSCISSAE:
            found.append(f"{path}:{node.name}")
    return sorted(found)


def attributes(node: ast.ClassDef) -> set[str]:
    """Names of the fields and properties of a class."""
    fields = {
        each.target.id for each in node.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)
    }
    properties = {
        each.name
        for each in node.body
        if isinstance(each, ast.FunctionDef) and any("property" in ast.unparse(d) for d in each.decorator_list)
    }
    return fields | properties


@dataclass(frozen=True)
class PinnedMessages:
    """Messages of the product, and the test files that contain words of each."""

    files: Mapping[str, frozenset[str]]

    @property
    def share(self) -> float:
        """Share of the messages that a test contains words of."""
        return sum(map(bool, self.files.values())) / len(self.files)

    @property
    def repeated(self) -> int:
        """Number of messages that several test files contain words of."""
        return sum(len(files) > 1 for files in self.files.values())


def pinned_messages(product: SourceTree, tests: SourceTree) -> PinnedMessages:
    """Find the messages that tests pin.

    A message is a string of the product's code and tables, docstrings aside, of at least `MESSAGE_WORDS` words. It is pinned where an assertion,
    or the `match` of an expected error, has a string of `PINNED_WORDS` words that it contains or is contained in.
    """
    messages = {
        " ".join(found)
        for text in (*product.table_texts(), *(text for syntax in product.modules.values() for text in texts(syntax)))
        if len(found := words(text)) >= MESSAGE_WORDS
    }
    containing: dict[tuple[str, ...], set[str]] = {}
    for message in messages:
        for pair in pairwise(message.split()):
            containing.setdefault(pair, set()).add(message)
    files: dict[str, set[str]] = {message: set() for message in messages}
    for path, syntax in tests.modules.items():
        for asserted in {tuple(words(text)) for text in asserted_texts(syntax)}:
            if len(asserted) < PINNED_WORDS:
                continue
            phrase = f" {' '.join(asserted)} "
            for message in {each for pair in pairwise(asserted) for each in containing.get(pair, ())}:
                if phrase in f" {message} " or f" {message} " in phrase:
                    files[message].add(str(path))
    return PinnedMessages({message: frozenset(paths) for message, paths in files.items()})


def texts(syntax: ast.AST) -> Iterator[str]:
    """String literals that are not docstrings; the parts of an f-string are joined by `{}`."""
    inner = {id(part) for node in ast.walk(syntax) if isinstance(node, ast.JoinedStr) for part in ast.walk(node)}
    bare = {id(node.value) for node in ast.walk(syntax) if isinstance(node, ast.Expr)}
    for node in ast.walk(syntax):
        if isinstance(node, ast.JoinedStr):
            yield "".join(str(part.value) if isinstance(part, ast.Constant) else "{}" for part in node.values)
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and not {id(node)} & (inner | bare):
            yield node.value


def asserted_texts(syntax: ast.Module) -> Iterator[str]:
    """String literals within assertions and in the `match` of an expected error."""
    for node in ast.walk(syntax):
        if isinstance(node, ast.Assert):
            yield from texts(node.test)
        elif isinstance(node, ast.keyword) and node.arg == "match":
            yield from texts(node.value)


def words(text: str) -> list[str]:
    """Words of a text in lower case."""
    return re.findall(r"[^\W\d_][\w'’-]*", text.casefold())


def figures(root: Path = ROOT) -> dict[str, dict[str, float]]:
    """All figures of the product of a checkout, as the table `tests/structure.toml` has them."""
    product = SourceTree(root)
    messages = pinned_messages(product, SourceTree(root, ("tests",)))
    return {
        "at_most": {
            "names imported past interfaces": len(names_past_interfaces(product)),
            "forms of a run": len(run_forms(product)),
            "classes of a series": len(series_classes(product)),
            "percent of the messages pinned by tests": round(100 * messages.share, 1),
            "messages pinned in several test files": messages.repeated,
        },
        "lines": {package: product.lines[package] for package in PACKAGES},
        "exceptions": dict(sorted(exceptions(product).items())),
    }


def growth(now: Mapping[str, Mapping[str, float]], table: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Return a sentence for each figure that is beyond the table's."""
    return [
        f"{name}: {value:g}, {f'at most {table[part][name]:g}' if name in table[part] else 'beyond the limit'}"
        for part, values in now.items()
        for name, value in values.items()
        if value > table[part].get(name, -1)
    ]
