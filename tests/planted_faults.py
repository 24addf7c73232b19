"""Planted faults: seeded mutants of the product's code, and which of them the tests find.

    python tests/planted_faults.py                         all mutants, on every core; exit code 1 below the goals
    python tests/planted_faults.py --area safety --sample 20 --seed 7
    python tests/planted_faults.py --list

Each mutant is one changed expression or one removed statement in a copy of the repository, where the tests of the changed
module run until the first of them fails. A mutant that no test finds is printed with its line; one that cannot change
behaviour is listed in `EQUIVALENT` with the reason.
"""

import argparse
import ast
import os
import queue
import random
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent

AREAS: Mapping[str, Mapping[str, str]] = {
    "safety": {
        "drivers/bench/amplifier.py": "tests/drivers/test_amplifier.py tests/drivers/test_bench.py tests/safety/test_ways_out.py",
        "drivers/bench/bench.py": "tests/drivers/test_bench.py tests/safety/test_ways_out.py tests/safety/test_live_warning.py",
        "drivers/bench/armed_bench.py": "tests/drivers/test_bench.py tests/safety/test_ways_out.py tests/safety/test_live_warning.py",
        "drivers/bench/shutdown.py": "tests/drivers/test_bench.py tests/safety/test_ways_out.py",
        "drivers/bench/rest.py": "tests/drivers/test_rest.py tests/drivers/test_bench.py",
        "drivers/watchdog/process.py": "tests/safety/test_watchdog_process.py tests/safety/test_watchdog.py tests/safety/test_watchdog_telling.py",
        "drivers/watchdog/client.py": "tests/safety/test_watchdog.py tests/safety/test_watchdog_telling.py tests/safety/test_watchdog_process.py",
        "drivers/drive.py": "tests/drivers/test_drive.py tests/drivers/test_amplifier.py",
        "drivers/transport/lock.py": "tests/drivers/test_lock.py tests/safety/test_one_program.py",
    },
    "runner": {
        "protocols/runner/runner.py": "tests/protocols/test_runner.py tests/protocols/test_entries.py tests/protocols/test_continuation.py tests/safety/test_ways_out.py",
        "protocols/runner/entries.py": "tests/protocols/test_runner.py tests/protocols/test_entries.py tests/protocols/test_continuation.py tests/safety/test_ways_out.py tests/protocols/test_lost_scans.py tests/protocols/test_levels.py",
        "protocols/runner/interrupts.py": "tests/protocols/test_runner.py tests/protocols/test_entries.py",
        "protocols/runner/conclusion.py": "tests/protocols/test_runner.py tests/protocols/test_entries.py tests/protocols/test_continuation.py tests/safety/test_ways_out.py tests/protocols/test_judgement.py",
        "protocols/runner/executor.py": "tests/protocols/test_executor.py tests/protocols/test_entries.py tests/protocols/test_runner.py",
        "protocols/runner/acquisition.py": "tests/protocols/test_levels.py tests/protocols/test_executor.py tests/protocols/test_entries.py tests/protocols/test_runner.py",
        "protocols/runner/operator_prompts.py": "tests/protocols/test_executor.py tests/protocols/test_entries.py tests/protocols/test_runner.py",
        "protocols/runner/plan_progress.py": "tests/protocols/test_entries.py tests/protocols/test_runner.py tests/protocols/test_continuation.py",
        "protocols/base/verdict.py": "tests/protocols/test_verdict.py",
        "protocols/resume.py": "tests/protocols/test_continuation.py",
    },
    "file": {
        "protocols/runfile/writer.py": "tests/protocols/test_runfile.py tests/protocols/test_lost_files.py tests/protocols/test_verdict.py",
        "protocols/runfile/reader.py": "tests/protocols/test_runfile.py tests/test_old_files.py tests/protocols/test_hostile_files.py",
        "protocols/runfile/open.py": "tests/protocols/test_runfile.py tests/protocols/test_hostile_files.py",
    },
    "signals": {
        "protocols/signals/sine.py": "tests/protocols/signals/test_sine_and_settling.py",
        "protocols/signals/settling.py": "tests/protocols/signals/test_sine_and_settling.py",
        "protocols/signals/levels.py": "tests/protocols/signals/test_level_and_creep.py",
        "protocols/signals/peak.py": "tests/protocols/signals/test_response_and_peak.py",
    },
    "identification": {
        "model/identification/joint_least_squares.py": "tests/model/identification/test_joint.py",
        "model/identification/paper_chain.py": "tests/model/identification/test_chain.py",
        "model/identification/fit_result.py": "tests/model/identification/test_joint.py tests/model/identification/test_calibration.py",
    },
    "campaign": {
        "app/campaign/status.py": "tests/app/test_campaign_standing.py tests/app/test_campaign.py",
        "app/campaign/queue.py": "tests/app/test_campaign.py",
        "app/session/reducer.py": "tests/app/test_view.py",
    },
}
"""Modules of each area and the tests that are responsible for them."""

PER_AREA = {"safety": 80, "runner": 35, "file": 35, "signals": 20, "identification": 20, "campaign": 20}
"""Mutants of each area: 210 in all, most of them where a fault is dangerous."""

GOALS = {"safety": 0.95, "all": 0.90}
TIME_LIMIT_S = 300.0

EQUIVALENT: Mapping[tuple[str, str, str], str] = {}
"""Mutants that cannot change behaviour: (file, line of code without indentation, mutation) -> reason."""

COMPARISONS: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
ARITHMETIC: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult,
}  # fmt: skip


@dataclass(frozen=True)
class Mutant:
    """One change of one source file.

    Attributes:
        file: relative to the repository.
        start, stop: offsets of the replaced text, in bytes.
        text: the replacement.
        kind: of the mutation.
    """

    file: str
    line: int
    start: int
    stop: int
    text: str
    kind: str

    def apply(self, source: bytes) -> bytes:
        """Return the changed source."""
        return source[: self.start] + self.text.encode() + source[self.stop :]

    def describe(self) -> str:
        """Return place, kind and replacement as a line."""
        code = (ROOT / self.file).read_text("utf-8").splitlines()[self.line - 1].strip()
        return f"{self.file}:{self.line}  {self.kind}: {code}  ->  {' '.join(self.text.split())}"

    @property
    def is_equivalent(self) -> bool:
        """Whether it is listed as unable to change behaviour."""
        code = (ROOT / self.file).read_text("utf-8").splitlines()[self.line - 1].strip()
        return (self.file, code, self.kind) in EQUIVALENT


def find_mutants(file: str) -> list[Mutant]:
    """Return all mutants of a file. Messages, docstrings and annotations are left alone."""
    source = (ROOT / file).read_bytes()
    lines = source.splitlines(keepends=True)
    starts = [0]
    for line in lines:
        starts.append(starts[-1] + len(line))
    found: list[Mutant] = []

    def add(node: ast.expr | ast.stmt, replacement: str, kind: str) -> None:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        begin, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        found.append(Mutant(file, node.lineno, begin, end, replacement, kind))

    for node in _mutable_nodes(ast.parse(source)):
        match node:
            case ast.Compare(ops=[operator]) if type(operator) in COMPARISONS:
                changed = ast.Compare(node.left, [COMPARISONS[type(operator)]()], node.comparators)
                add(node, f"({ast.unparse(changed)})", "comparison negated")
            case ast.BoolOp(op=operator):
                other = ast.Or() if isinstance(operator, ast.And) else ast.And()
                add(node, f"({ast.unparse(ast.BoolOp(other, node.values))})", "and/or exchanged")
            case ast.BinOp(op=operator) if type(operator) in ARITHMETIC and not isinstance(
                node.left, ast.Constant | ast.JoinedStr
            ):
                add(
                    node,
                    f"({ast.unparse(ast.BinOp(node.left, ARITHMETIC[type(operator)](), node.right))})",
                    "arithmetic",
                )
            case ast.Constant(value=bool() as value):
                add(node, str(not value), "constant")
            case ast.Constant(value=int() | float() as number):
                add(node, repr(10 * number if number else 1), "constant")
            case ast.If(test=test) | ast.While(test=test) if not isinstance(test, ast.Compare | ast.BoolOp):
                add(test, f"(not ({ast.unparse(test)}))", "condition negated")
            case ast.Expr(value=ast.Call()):
                add(node, "pass", "call removed")
            case ast.Raise():
                add(node, "pass", "raise removed")
            case ast.AugAssign():
                add(node, "pass", "assignment removed")
    return found


def _mutable_nodes(tree: ast.AST) -> Iterator[ast.AST]:
    for name, value in ast.iter_fields(tree):
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or name in ("annotation", "returns", "decorator_list"):
                continue
            if isinstance(child, ast.JoinedStr | ast.Assert | ast.Import | ast.ImportFrom):
                continue
            if (
                isinstance(child, ast.Call)
                and isinstance(child.func, ast.Attribute)
                and child.func.attr in ("debug", "info")
            ):
                continue
            yield child
            if not isinstance(child, ast.Raise):  # the wording of an error is not behaviour
                yield from _mutable_nodes(child)


def sample(area: str, count: int, seed: int) -> list[Mutant]:
    """Return `count` mutants of an area, the same ones for the same seed and code."""
    every = [mutant for file in AREAS[area] for mutant in find_mutants(file)]
    chosen = random.Random(f"{area} {seed}").sample(every, min(count, len(every)))
    return [mutant for mutant in chosen if not mutant.is_equivalent]


def is_found(mutant: Mutant, tests: str, tree: Path) -> bool:
    """Return whether the tests fail, or do not end, with this mutant in a copy of the repository."""
    file = tree / mutant.file
    original = file.read_bytes()
    file.write_bytes(mutant.apply(original))
    environment = {
        **os.environ,
        "PYTHONPATH": str(tree),
        "QT_QPA_PLATFORM": "offscreen",
        "PYTHONDONTWRITEBYTECODE": "1",
    }
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-m", "", "-p", "no:cacheprovider", "--no-header", "--tb=no"]
    try:
        process = subprocess.Popen(
            [*command, *tests.split()],
            cwd=tree, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, start_new_session=True,
        )  # fmt: skip
        try:
            return process.wait(TIME_LIMIT_S) != 0
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, 9)
            process.wait()
            return True
    finally:
        file.write_bytes(original)


def run(mutants: Sequence[tuple[str, Mutant]], workers: int) -> list[tuple[str, Mutant]]:
    """Try all mutants, each worker in its own copy of the repository; return the survivors."""
    waiting: queue.SimpleQueue[tuple[str, Mutant]] = queue.SimpleQueue()
    for each in mutants:
        waiting.put(each)
    survivors: list[tuple[str, Mutant]] = []
    done: list[None] = []
    with tempfile.TemporaryDirectory() as folder:

        def work(tree: Path) -> None:
            listed = subprocess.run(["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True, check=True)  # fmt: skip
            for name in filter(None, listed.stdout.decode().split("\0")):
                if (ROOT / name).is_file():
                    (tree / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy2(ROOT / name, tree / name)
            while not waiting.empty():
                try:
                    area, mutant = waiting.get_nowait()
                except queue.Empty:
                    return
                begin = time.monotonic()
                found = is_found(mutant, AREAS[area][mutant.file], tree)
                done.append(None)
                if not found:
                    survivors.append((area, mutant))
                verdict = "found" if found else "SURVIVED"
                print(
                    f"{len(done):4}/{len(mutants)} {verdict:8} {time.monotonic() - begin:5.1f} s  {mutant.describe()}",
                    flush=True,
                )

        threads = [threading.Thread(target=work, args=(Path(folder) / str(i),)) for i in range(workers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    return survivors


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 1 where fewer mutants are found than the goals ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--area", choices=AREAS, action="append", help="only this area; may be repeated")
    parser.add_argument("--sample", type=int, help="mutants per area (default: 210 in all)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--list", action="store_true", help="print the mutants and do nothing")
    options = parser.parse_args(arguments)
    areas = options.area or list(AREAS)
    mutants = [
        (area, mutant) for area in areas for mutant in sample(area, options.sample or PER_AREA[area], options.seed)
    ]
    if options.list:
        print(*(mutant.describe() for _, mutant in mutants), sep="\n")
        return 0
    survivors = run(mutants, options.workers)
    code = 0
    print("\nsurvivors:", *(mutant.describe() for _, mutant in survivors), sep="\n  ")
    for name in [*areas, "all"]:
        total = [area for area, _ in mutants if name in (area, "all")]
        left = [area for area, _ in survivors if name in (area, "all")]
        share = 1 - len(left) / len(total) if total else 1.0
        print(f"{name:>15}: {len(total) - len(left)} of {len(total)} found, {100 * share:.0f} %")
        code = code or int(share < GOALS.get(name, 0.0))
    return code


if __name__ == "__main__":
    sys.exit(main())
