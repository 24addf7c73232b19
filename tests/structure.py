"""Structure report: files per folder, class names, import chains, and the figures of the code beside their table.

python tests/structure.py              prints the report; exit code 1 where a limit is exceeded
python tests/structure.py --update     writes the figures of the code into tests/structure.toml; exceptions only shrink
python tests/structure.py --statements also prints the number of statements of each package
"""

import ast
import re
import subprocess
import sys
import tomllib
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping
from functools import cache
from graphlib import TopologicalSorter
from itertools import pairwise
from pathlib import Path

import grimp
import tomlkit

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))
from tests.helpers.code_figures import PACKAGES, ROOT, SourceTree, figures, growth

PLUS_MINUS_AT_END = re.compile(r"(±|(?<![\w\[])\+-|\+/-)\s*$")
PLUS_MINUS_IN_TEMPLATE = re.compile(r"(±|\+-) ?\{")
FORMATTER = Path("model/value_text.py")
MOST_FILES, MOST_TEST_FILES, LONGEST_CHAIN, MOST_FAMILY_FILES = 20, 40, 8, 5
FIGURES = Path(__file__).with_name("structure.toml")
"""Figures of the code, which this program compares with those of the checkout."""


@cache
def source_tree(*folders: str) -> SourceTree:
    """The files below the given top-level folders, parsed once."""
    return SourceTree(ROOT, folders)


def modules(*folders: str) -> Iterable[tuple[Path, ast.Module]]:
    """Tracked and new Python files below the given top-level folders, parsed."""
    return source_tree(*folders).modules.items()


def files_per_folder(*tops: str) -> Counter[str]:
    """Number of Python files of each folder, `__init__` and `__main__` aside."""
    return Counter(str(path.parent) for path, _ in modules(*tops) if not path.stem.startswith("__"))


def repeated_class_names() -> dict[str, list[str]]:
    """Public class names that are defined more than once in the product, with their files."""
    found: defaultdict[str, list[str]] = defaultdict(list)
    for path, tree in modules(*PACKAGES):
        for node in tree.body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith("_"):
                found[node.name].append(str(path))
    return {name: files for name, files in sorted(found.items()) if len(files) > 1}


def statements(*tops: str) -> Counter[str]:
    """Number of Python statements of each top-level folder."""
    count: Counter[str] = Counter()
    for path, tree in modules(*tops):
        count[path.parts[0]] += sum(isinstance(node, ast.stmt) for node in ast.walk(tree))
    return count


def subpackage_imports(package: str) -> dict[str, set[str]]:
    """Direct imports between the direct sub-packages of a package, function-level ones included."""
    graph = grimp.build_graph(package)
    below = {module.split(".")[1] for module in graph.modules if "." in module}
    edges: dict[str, set[str]] = {name: set() for name in below}
    for module in graph.modules - {package}:
        importer = module.split(".")[1]
        for imported in graph.find_modules_directly_imported_by(module):
            parts = imported.split(".")
            if parts[0] == package and len(parts) > 1 and parts[1] != importer:
                edges[importer].add(parts[1])
    return edges


def longest_chain(edges: Mapping[str, set[str]]) -> list[str]:
    """Longest path through an acyclic import graph.

    Raises:
        graphlib.CycleError: the graph has a cycle.
    """
    chains: dict[str, list[str]] = {}
    for name in TopologicalSorter(edges).static_order():
        chains[name] = [name, *max((chains[other] for other in sorted(edges[name])), key=len, default=[])]
    return max((chains[name] for name in sorted(chains)), key=len)


def built_in_protocols() -> tuple[str, ...]:
    """Names of the built-in protocols, as the registry's file has them."""
    tree = ast.parse((ROOT / "protocols" / "registry.py").read_text(encoding="utf-8"))
    (table,) = (
        node.value
        for node in tree.body
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "BUILT_IN_PROTOCOLS"
    )
    return tuple(ast.literal_eval(table))


def names_a_protocol(tree: ast.Module, names: frozenset[str]) -> bool:
    """Whether a module imports a protocol's class, or has its name as a text of its own, longer texts such as help aside.

    A name of one word has other meanings, too (`hysteresis` is a parameter of the model): it counts where it is compared with an
    attribute `protocol`, or looked up in `PROTOCOLS`.
    """
    for node in ast.walk(tree):
        match node:
            case ast.ImportFrom(module=str(module)) if f"{module}.".startswith("protocols.measurements."):
                return True
            case ast.Import(names=aliases) if any(a.name.startswith("protocols.measurements") for a in aliases):
                return True
            case ast.Constant(value=str(text)) if "-" in text and text in names:
                return True
            case ast.Compare() if "protocol" in (attributes := _attributes(node)) or "PROTOCOLS" in attributes:
                if names & _texts(node):
                    return True
            case ast.Subscript(value=ast.Name(id="PROTOCOLS"), slice=ast.Constant(value=str(text))) if text in names:
                return True
    return False


def _attributes(tree: ast.AST) -> set[str]:
    """Names and attributes in an expression."""
    return {
        node.attr if isinstance(node, ast.Attribute) else node.id
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute | ast.Name)
    }


def _texts(tree: ast.AST) -> set[str]:
    return {node.value for node in ast.walk(tree) if isinstance(node, ast.Constant) and isinstance(node.value, str)}


def files_that_name_protocols() -> set[str]:
    """Product files outside `protocols` that name a protocol; tutorial and demonstration may."""
    names = frozenset(built_in_protocols())
    tops = [package for package in PACKAGES if package != "protocols"]
    return {
        str(path)
        for path, tree in modules(*tops)
        if not {"tutorial", "demo"} & set(path.stem.split("_")) and names_a_protocol(tree, names)
    }


def composes_uncertainty(tree: ast.AST) -> bool:
    """Whether code writes `±` or `+-` before a value that it inserts: only `model.value_text` may."""
    for node in ast.walk(tree):
        match node:
            case ast.JoinedStr(values=parts):
                if any(
                    PLUS_MINUS_AT_END.search(str(part.value)) and isinstance(following, ast.FormattedValue)
                    for part, following in pairwise(parts)
                    if isinstance(part, ast.Constant)
                ):
                    return True
            case ast.BinOp(op=ast.Add(), left=ast.Constant(value=str(text))) if PLUS_MINUS_AT_END.search(text):
                return True
            case ast.BinOp(op=ast.Add(), left=ast.BinOp(right=ast.Constant(value=str(text)))) if (
                PLUS_MINUS_AT_END.search(text)
            ):
                return True
            case ast.Call(func=ast.Attribute(value=ast.Constant(value=str(text)), attr="join" | "format")):
                if PLUS_MINUS_AT_END.search(text) or PLUS_MINUS_IN_TEMPLATE.search(text):
                    return True
            case ast.Constant(value=str(text)) if PLUS_MINUS_IN_TEMPLATE.search(text):
                return True
    return False


def names_of_families() -> dict[str, re.Pattern[str]]:
    """What names a family of function generators: its drivers, their classes, and its models and series."""
    found = {}
    for path in sorted((ROOT / "drivers" / "evidence" / "generators").glob("*.toml")):
        drivers = tomllib.loads(path.read_text(encoding="utf-8"))["drivers"]
        code = ast.parse((ROOT / "drivers" / "generators" / f"{path.stem}.py").read_text(encoding="utf-8"))
        classes = [node.name for node in code.body if isinstance(node, ast.ClassDef)]
        models = [rf"(?=\w{{5}}){beginning}\w*" for driver in drivers.values() for beginning in driver["makers"]]
        found[path.stem] = re.compile(rf"\b({'|'.join([*drivers, *classes, *models])})\b")
    return found


def files_that_name_a_family() -> dict[str, list[str]]:
    """Product files that name each family of function generators; simulated benches, which choose a model, aside."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", *(f"{package}/" for package in PACKAGES)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    names = [n for n in listed.stdout.split() if n.endswith((".py", ".pyi", ".toml")) and (ROOT / n).is_file()]
    texts = {
        name: (ROOT / name).read_text(encoding="utf-8")
        for name in names
        if Path(name).parent.name != "sim_hardware" or not name.endswith(".toml")
    }
    return {
        family: [name for name, text in texts.items() if pattern.search(text)]
        for family, pattern in names_of_families().items()
    }


def updated(
    table: Mapping[str, Mapping[str, float]], now: Mapping[str, Mapping[str, float]]
) -> dict[str, dict[str, float]]:
    """Return the table with the figures of now; only lines may grow, and no exception is added."""
    allowed = table["exceptions"]
    kept = {name: min(value, allowed[name]) for name, value in now["exceptions"].items() if name in allowed}
    most = {name: min(value, table["at_most"].get(name, value)) for name, value in now["at_most"].items()}
    return {"at_most": most, "lines": dict(now["lines"]), "exceptions": kept}


def growth_beyond_table(update: bool) -> list[str]:
    """Print the figures of the code; return a sentence for each that is beyond the table, which `update` writes first."""
    now = figures()
    table = tomllib.loads(FIGURES.read_text(encoding="utf-8"))
    if update:
        table = updated(table, now)
        FIGURES.write_text(tomlkit.dumps(table), encoding="utf-8")
    for part in ("at_most", "lines"):
        print(f"{part}:", ", ".join(f"{name} {value:g}" for name, value in now[part].items()))
    total = sum(now["lines"].values())
    print("lines in all:", total, "| functions and classes beyond a limit:", len(now["exceptions"]))
    grown = growth(now, table)
    print("beyond tests/structure.toml:", *(grown or ["none"]), sep="\n  " if grown else " ")
    return grown


def main(arguments: list[str]) -> int:
    """Print the report; return 1 where a limit is exceeded."""
    crowded = {f: n for f, n in files_per_folder(*PACKAGES).items() if n > MOST_FILES}
    crowded |= {f: n for f, n in files_per_folder("tests").items() if n > MOST_TEST_FILES}
    repeated = repeated_class_names()
    chain = longest_chain(subpackage_imports("app"))
    print("folders with too many files:", crowded or "none")
    print("class names defined more than once:", ", ".join(repeated) or "none")
    print(f"longest import chain in app ({len(chain)}, at most {LONGEST_CHAIN}):", " > ".join(chain))
    naming = sorted(files_that_name_protocols())
    print("files outside protocols that name one:", ", ".join(naming) or "none")
    composing = [str(path) for path, tree in modules(*PACKAGES) if path != FORMATTER and composes_uncertainty(tree)]
    print("files that compose an uncertainty:", ", ".join(composing) or "none")
    families = files_that_name_a_family()
    print(f"files that name a family of generators (at most {MOST_FAMILY_FILES}):", families)
    many = max(map(len, families.values())) > MOST_FAMILY_FILES
    grown = growth_beyond_table("--update" in arguments)
    if "--statements" in arguments:
        count = statements(*PACKAGES)
        print("statements:", ", ".join(f"{name} {n}" for name, n in sorted(count.items())), "| all", count.total())
    return 1 if grown or crowded or repeated or len(chain) > LONGEST_CHAIN or naming or composing or many else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
