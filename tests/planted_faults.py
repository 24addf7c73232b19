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
import hashlib
import multiprocessing
import multiprocessing.context
import os
import queue
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent

AREAS: Mapping[str, Mapping[str, str]] = {
    "safety": {
        "drivers/bench/drive_limits.py": "tests/drivers/test_amplifier_commands.py tests/drivers/test_amplifier.py tests/drivers/test_bench.py",
        "drivers/bench/bench.py": "tests/drivers/test_bench_arming.py tests/drivers/test_bench.py",
        "drivers/bench/armed_bench.py": "tests/drivers/test_bench_arming.py tests/drivers/test_bench.py",
        "drivers/bench/rest.py": "tests/drivers/test_rest.py tests/drivers/test_bench_arming.py tests/drivers/test_bench.py",
        "drivers/watchdog/process.py": "tests/safety/test_watchdog_loop.py tests/safety/test_watchdog_process.py",
        "drivers/watchdog/client.py": "tests/safety/test_watchdog_client.py tests/safety/test_watchdog_process.py",
        "drivers/drive_shapes.py": "tests/drivers/test_waveforms.py tests/drivers/test_drive_shapes.py",
        "drivers/transport/lock.py": "tests/drivers/test_lock.py",
    },
    "runner": {
        "protocols/runner/runner.py": "tests/protocols/test_runner.py tests/protocols/test_entries.py tests/protocols/test_continuation.py tests/protocols/test_interference.py",
        "protocols/runner/entries.py": "tests/protocols/test_entries.py tests/protocols/test_levels.py tests/protocols/test_lost_scans.py tests/protocols/test_runner.py",
        "protocols/runner/publisher.py": "tests/protocols/test_entries.py tests/protocols/test_runner.py",
        "protocols/runner/conclusion.py": "tests/protocols/test_conclusion.py tests/protocols/runfile/test_lost_files.py tests/protocols/test_runner.py tests/protocols/test_judgement.py tests/protocols/test_entries.py",
        "protocols/runner/executor.py": "tests/protocols/test_executor.py tests/protocols/test_entries.py",
        "protocols/runner/acquisition.py": "tests/protocols/test_levels.py tests/protocols/test_executor.py tests/protocols/test_runner.py",
        "protocols/runner/operator_actions.py": "tests/protocols/test_executor.py tests/protocols/test_entries.py",
        "protocols/runner/plan_progress.py": "tests/protocols/test_entries.py tests/protocols/test_continuation.py",
        "protocols/base/verdict.py": "tests/protocols/test_verdict.py",
        "protocols/resume.py": "tests/protocols/test_resume_rules.py tests/protocols/test_continuation.py",
    },
    "file": {
        "protocols/runfile/writer.py": "tests/protocols/runfile/test_runfile_edges.py tests/protocols/runfile/test_runfile.py tests/protocols/runfile/test_lost_files.py tests/protocols/test_verdict.py",
        "protocols/runfile/reader.py": "tests/protocols/runfile/test_runfile_edges.py tests/protocols/runfile/test_runfile.py tests/protocols/runfile/test_hostile_files.py tests/protocols/test_continuation.py tests/protocols/test_verdict.py",
        "protocols/runfile/open.py": "tests/protocols/runfile/test_runfile_edges.py tests/protocols/runfile/test_runfile.py tests/protocols/runfile/test_hostile_files.py",
    },
    "signals": {
        "protocols/signals/sine.py": "tests/protocols/signals/test_exact_numbers.py tests/protocols/signals/test_sine_and_settling.py",
        "protocols/signals/settling.py": "tests/protocols/signals/test_sine_and_settling.py",
        "protocols/signals/held_level.py": "tests/protocols/signals/test_exact_numbers.py tests/protocols/signals/test_level_and_creep.py",
        "protocols/signals/peak.py": "tests/protocols/signals/test_exact_numbers.py tests/protocols/signals/test_response_and_peak.py",
    },
    "identification": {
        "model/identification/joint_least_squares.py": "tests/model/identification/test_joint.py",
        "model/identification/valley_descent.py": "tests/model/identification/test_valley_descent.py",
        "model/identification/paper_chain/chain.py": "tests/model/identification/test_small_formulas.py tests/model/identification/test_chain.py",
        "model/identification/fit_result.py": "tests/model/identification/test_small_formulas.py tests/model/identification/test_calibration.py tests/model/identification/test_joint.py",
    },
    "campaign": {
        "app/campaign/series.py": "tests/app/test_campaign_series.py tests/app/test_campaign_standing.py",
        "app/campaign/status.py": "tests/app/test_campaign_standing.py tests/app/test_campaign.py",
        "app/campaign/queue.py": "tests/app/test_campaign.py",
        "app/session/reducer.py": "tests/app/test_reducer_states.py tests/app/test_view.py",
    },
}
"""Modules of each area and the tests that are responsible for them."""

PER_AREA = {"safety": 80, "runner": 35, "file": 35, "signals": 20, "identification": 20, "campaign": 20}
"""Mutants of each area: 210 in all, most of them where a fault is dangerous."""

GOALS = {"safety": 0.95, "all": 0.90}

FIRST_LIMIT_S, LEAST_LIMIT_S, SLOWER = 900.0, 60.0, 3.0
"""Limits of the tests' duration: without a planted fault, and with one: by so many times longer, and by so many seconds."""

CONTEXT = multiprocessing.get_context(
    "forkserver" if "forkserver" in multiprocessing.get_all_start_methods() else "spawn"
)
if isinstance(CONTEXT, multiprocessing.context.ForkServerContext):  # libraries are imported once
    CONTEXT.set_forkserver_preload(
        [
            "_pytest",
            "hypothesis",
            "numpy",
            "scipy.optimize",
            "scipy.signal",
            "scipy.stats",
            "h5py",
            "pydantic",
            "filelock",
        ]
    )

RAN = 64
"""Added to pytest's exit code, so that a process that could not begin is not taken for a test that failed."""

EQUIVALENT: Mapping[tuple[str, str, str], str] = {
    (
        "protocols/runner/executor.py",
        "scans += max(self._acquisition.scan_index(armed, BLOCK_LATENCY_S) - buffer.first_scan, 0)",
        "1",
    ): "the source starts at least a block's latency after the first recorded scan",
    (
        "drivers/watchdog/process.py",
        "sys.stderr.flush()",
        "pass",
    ): "Python writes every line to standard error at once, and the line is complete",
    (
        "model/identification/fit_result.py",
        "d = np.where(d > 0, d, 1)",
        "10",
    ): "a parameter without variance has no covariance either: 0 / 1 is 0 / 10",
    (
        "protocols/signals/held_level.py",
        "t = (np.arange(n) - 0.5 * (n - 1)) / rate_hz",
        "(np.arange(n) + 0.5 * (n - 1))",
    ): "where the time of the mains begins turns their phase, which is fitted",
    (
        "protocols/signals/held_level.py",
        "t = (np.arange(n) - 0.5 * (n - 1)) / rate_hz",
        "(n + 1)",
    ): "where the time of the mains begins turns their phase, which is fitted",
    (
        "protocols/runfile/reader.py",
        "visited.add(earlier.resolve())",
        "pass",
    ): "a ring of runs is then ended by the limit of earlier runs, with the same sentence",
    (
        "protocols/runfile/open.py",
        "access.set_fclose_degree(h5py.h5f.CLOSE_STRONG)",
        "pass",
    ): "h5py closes the objects of a file itself when the file is closed",
    (
        "protocols/runfile/open.py",
        "if TYPE_CHECKING:",
        "(not (TYPE_CHECKING))",
    ): "imports a library earlier, which the tests of the start (tests/app/cli/test_startup.py) look at, not those of the file",
    (
        "protocols/signals/peak.py",
        "middle, half = 0.5 * (u[0] + u[-1]), 0.5 * (u[-1] - u[0])",
        "1",
    ): "another scaling of the polynomial's variable, by one line of at least ten; its minimum is scaled back",
    (
        "protocols/signals/sine.py",
        "CHUNK_SAMPLES = 1 << 16",
        "160",
    ): "how many samples are summed at a time decides the memory, not the sum",
}
"""Mutants that cannot change behaviour: (file, line of code without indentation, replacement) -> reason."""

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
        return (self.file, code, self.text) in EQUIVALENT


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
    """Return `count` mutants of an area.

    Each mutant's place in the order depends on the seed and on its own line only, so that a change elsewhere leaves the
    sample as it is.
    """
    ordered: list[tuple[str, Mutant]] = []
    for file in AREAS[area]:
        lines = (ROOT / file).read_text("utf-8").splitlines()
        seen: Counter[str] = Counter()
        for mutant in find_mutants(file):
            name = f"{seed} {file} {lines[mutant.line - 1].strip()} {mutant.kind} {mutant.text}"
            seen[name] += 1
            ordered.append((hashlib.sha256(f"{name} {seen[name]}".encode()).hexdigest(), mutant))
    return [mutant for _, mutant in sorted(ordered, key=lambda each: each[0])[:count]]


def copy_repository(tree: Path) -> None:
    """Copy the files of the repository, as far as git knows or would add them."""
    command = ["git", "ls-files", "-co", "--exclude-standard", "-z"]
    listed = subprocess.run(command, cwd=ROOT, capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (ROOT / name).is_file():
            (tree / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(ROOT / name, tree / name)


def _run_pytest(tree: str, arguments: Sequence[str]) -> None:
    """Run pytest in a copy of the repository and end this process with its exit code."""
    if hasattr(os, "setsid"):
        os.setsid()
    os.chdir(tree)
    os.environ |= {"PYTHONPATH": tree, "QT_QPA_PLATFORM": "offscreen"}
    sys.path[:] = [tree, *(path for path in sys.path if Path(path or ".").resolve() != ROOT)]
    for name in [name for name in sys.modules if name.split(".")[0] == "tests"]:
        del sys.modules[name]  # of the repository, not of the copy
    nowhere = os.open(os.devnull, os.O_RDWR)
    for stream in range(3):
        os.dup2(nowhere, stream)
    code = 2
    try:
        code = int(pytest.main(list(arguments)))
    finally:
        os._exit(RAN + code)


class Tree:
    """A copy of the repository in which tests run, with or without a mutant."""

    def __init__(self, folder: Path, quick: bool = False) -> None:
        self._folder = folder
        self._tiers = ("not deep",) if quick else ("not deep", "deep")
        self._changes = 0
        self._limits_s: dict[str, float] = {}
        copy_repository(folder)

    def is_found(self, mutant: Mutant, tests: str) -> bool:
        """Return whether the tests fail, or do not end, with this mutant.

        Raises:
            RuntimeError: the tests fail without it, too.
        """
        if tests not in self._limits_s:
            self._limits_s[tests] = self._measure_limit(tests)
        original = (self._folder / mutant.file).read_bytes()
        self._write(mutant.file, mutant.apply(original))
        try:
            return not self._pass(tests, self._limits_s[tests])
        finally:
            self._write(mutant.file, original)

    def _write(self, file: str, source: bytes) -> None:
        """Write a source file with a time of its own: what Python compiled of it before is out of date."""
        self._changes += 1
        (self._folder / file).write_bytes(source)
        os.utime(self._folder / file, (self._changes, self._changes))

    def _measure_limit(self, tests: str) -> float:
        """Return how many seconds the tests may take on this computer before they count as hanging."""
        for _ in range(2):
            begin = time.monotonic()
            if self._pass(tests, FIRST_LIMIT_S):
                return LEAST_LIMIT_S + SLOWER * (time.monotonic() - begin)
        raise RuntimeError(f"these tests fail without any planted fault, which would find all of them: {tests}")

    def _pass(self, tests: str, limit_s: float) -> bool:
        """Return whether the tests pass: first those of the quick tier, then the deep ones unless they are left out."""
        end = time.monotonic() + limit_s
        return all(self._run(tests, tier, end - time.monotonic()) for tier in self._tiers)

    def _run(self, tests: str, tier: str, limit_s: float) -> bool:
        arguments = ["-q", "-x", "-m", tier, "-p", "no:cacheprovider", "--tb=no", f"--timeout={max(limit_s, 1.0):.0f}"]
        arguments += ["-W", "ignore::pytest.PytestAssertRewriteWarning", *tests.split()]
        process = CONTEXT.Process(target=_run_pytest, args=(str(self._folder), arguments))
        process.start()
        process.join(limit_s + LEAST_LIMIT_S)  # pytest ends a hanging test itself, unless it hangs with it
        hangs = process.exitcode is None
        if hangs:
            if hasattr(os, "killpg"):
                os.killpg(process.pid or 0, 9)
            process.kill()
            process.join()
        code = process.exitcode
        process.close()
        if code == 1:  # Python's own, not pytest's
            raise RuntimeError("pytest cannot be started in a process of its own; its message is above")
        return not hangs and code in (RAN + pytest.ExitCode.OK, RAN + pytest.ExitCode.NO_TESTS_COLLECTED)


def run(mutants: Sequence[tuple[str, Mutant]], workers: int, quick: bool = False) -> list[tuple[str, Mutant]]:
    """Try all mutants, each worker in its own copy of the repository; return the survivors.

    Raises:
        RuntimeError: tests fail without any planted fault.
    """
    waiting: queue.SimpleQueue[tuple[str, Mutant]] = queue.SimpleQueue()
    for each in sorted(mutants, key=lambda each: AREAS[each[0]][each[1].file]):
        waiting.put(each)
    survivors: list[tuple[str, Mutant]] = []
    errors: list[RuntimeError] = []
    done: list[None] = []

    def work(folder: Path) -> None:
        tree = Tree(folder, quick)
        while not errors:
            try:
                area, mutant = waiting.get_nowait()
            except queue.Empty:
                return
            begin = time.monotonic()
            try:
                found = tree.is_found(mutant, AREAS[area][mutant.file])
            except RuntimeError as error:
                errors.append(error)
                return
            done.append(None)
            if not found:
                survivors.append((area, mutant))
            verdict = "found" if found else "SURVIVED"
            took_s = time.monotonic() - begin
            print(f"{len(done):4}/{len(mutants)} {verdict:8} {took_s:5.1f} s  {mutant.describe()}", flush=True)

    with tempfile.TemporaryDirectory() as folder:
        threads = [threading.Thread(target=work, args=(Path(folder) / str(i),)) for i in range(workers)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    if errors:
        raise errors[0]
    return survivors


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command; return 1 where fewer mutants are found than the goals ask for."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--area", choices=AREAS, action="append", help="only this area; may be repeated")
    parser.add_argument("--sample", type=int, help=f"mutants per area (default: {sum(PER_AREA.values())} in all)")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--match", action="append", help="only those whose line of the report contains this text; may be repeated"
    )
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--quick", action="store_true", help="leave the deep tests out")
    parser.add_argument("--list", action="store_true", help="print the mutants and do nothing")
    options = parser.parse_args(arguments)
    areas = options.area or list(AREAS)
    chosen = [
        (area, mutant)
        for area in areas
        for mutant in sample(area, options.sample or PER_AREA[area], options.seed)
        if not options.match or any(text in mutant.describe() for text in options.match)
    ]
    if options.list:
        print(*(mutant.describe() for _, mutant in chosen), sep="\n")
        return 0
    mutants = [(area, mutant) for area, mutant in chosen if not mutant.is_equivalent]
    survivors = run(mutants, options.workers, options.quick)
    code = 0
    print("\nsurvivors:", *(mutant.describe() for _, mutant in survivors), sep="\n  ")
    print(f"\n{'area':14} {'mutants':>8} {'equivalent':>11} {'tried':>6} {'found':>6} {'share':>6}")
    for name in [*areas, "all"]:
        planted, total, left = (sum(name in (area, "all") for area, _ in each) for each in (chosen, mutants, survivors))
        share = 1 - left / total if total else 1.0
        print(f"{name:14} {planted:8} {planted - total:11} {total:6} {total - left:6} {100 * share:4.0f} %")
        code = code or int(share < GOALS.get(name, 0.0))
    return code


if __name__ == "__main__":
    sys.exit(main())
