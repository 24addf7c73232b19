"""Structure report: files per folder, class names, import chains and statements of the product.

python tests/structure.py              prints the report; exit code 1 where a limit is exceeded
python tests/structure.py --statements also prints the number of statements of each package
"""

import ast
import subprocess
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from graphlib import TopologicalSorter
from pathlib import Path

import grimp

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("app", "drivers", "model", "protocols", "sim_hardware", "tactor_bench")
MOST_FILES, MOST_TEST_FILES, LONGEST_CHAIN = 20, 40, 7


def modules(*tops: str) -> Iterator[tuple[Path, ast.Module]]:
    """Tracked and new Python files below the given top-level folders, parsed."""
    listed = subprocess.run(
        ["git", "ls-files", "--cached", "--others", "--exclude-standard", *(f"{top}/*.py" for top in tops)],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in listed.stdout.split():
        if (ROOT / name).is_file():
            yield Path(name), ast.parse((ROOT / name).read_text(encoding="utf-8"), name)


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


def main(arguments: list[str]) -> int:
    """Print the report; return 1 where a limit is exceeded."""
    crowded = {f: n for f, n in files_per_folder(*PACKAGES).items() if n > MOST_FILES}
    crowded |= {f: n for f, n in files_per_folder("tests").items() if n > MOST_TEST_FILES}
    repeated = repeated_class_names()
    chain = longest_chain(subpackage_imports("app"))
    print("folders with too many files:", crowded or "none")
    print("class names defined more than once:", ", ".join(repeated) or "none")
    print(f"longest import chain in app ({len(chain)}, at most {LONGEST_CHAIN}):", " > ".join(chain))
    if "--statements" in arguments:
        count = statements(*PACKAGES)
        print("statements:", ", ".join(f"{name} {n}" for name, n in sorted(count.items())), "| all", count.total())
    return 1 if crowded or repeated or len(chain) > LONGEST_CHAIN else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
