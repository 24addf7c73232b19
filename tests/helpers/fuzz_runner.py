"""Runs fuzz cases in forked processes with limits of memory and time, and reports those that fail.

All of them: `python -m tests.helpers.fuzz_runner all FOLDER START COUNT [WORKERS]`.
One case again, with the file it damages left in a folder: `python -m tests.helpers.fuzz_runner again KIND SEED FOLDER`.
"""

import contextlib
import io
import json
import os
import random
import resource
import selectors
import signal
import subprocess
import sys
import time
import traceback
import unicodedata
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

MEMORY_BYTES = 1_000_000_000
CPU_S = 10.0
"""Limit of the time that a case computes."""
HANG_S = 60.0
"""Time without any computing after which a case hangs: a process that waits for a processor gets one within it."""
HANG_CPU_S = 30.0
"""Time a case computes after which it is ended from outside: within a library that does not return."""
ROOT = Path(__file__).parents[2]


@dataclass
class Report:
    """What the cases of a session found."""

    cases: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)
    seconds: float = 0.0
    cpu_s: float = 0.0

    def __str__(self) -> str:
        each = ", ".join(f"{kind} {n} ({self.refused[kind]} refused)" for kind, n in sorted(self.cases.items()))
        lines = [
            f"{self.cases.total()} cases in {self.seconds:.0f} s, {self.cpu_s:.0f} s of processor: {each}",
            *self.problems,
        ]
        return "\n".join(lines)


def kind_of(seed: int, shares: dict[str, float]) -> str:
    return random.Random(f"kind-{seed}").choices(list(shares), list(shares.values()))[0]


def fuzz_apart(folder: Path, start: int, count: int, workers: int = 2) -> Report:
    """Run the cases `start` to `start + count` from a process of its own, whose imports and originals the workers share."""
    words = [sys.executable, "-m", "tests.helpers.fuzz_runner", "json", str(folder), *map(str, (start, count, workers))]
    environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
    ran = subprocess.run(words, stdout=subprocess.PIPE, cwd=ROOT, env=environment, check=True)
    said = json.loads(ran.stdout.splitlines()[-1])
    return Report(Counter(said["cases"]), Counter(said["refused"]), said["problems"], said["seconds"], said["cpu_s"])


def fuzz(folder: Path, start: int, count: int, workers: int = 2) -> Report:
    """Run the cases `start` to `start + count`, shared by forked processes. The process must have no other threads."""
    import warnings

    from tests.helpers.fuzz_targets import Originals

    warnings.simplefilter("ignore")
    folder.mkdir(parents=True, exist_ok=True)
    report, began = Report(), time.monotonic()
    originals = Originals(folder)
    children = [_Child(originals, folder / str(i), start + i, start + count, workers) for i in range(workers)]
    with selectors.DefaultSelector() as selector:
        for child in children:
            selector.register(child.begin(), selectors.EVENT_READ, child)
        while selector.get_map():
            for key, _ in selector.select(1.0):
                child = key.data
                if not child.take(report):
                    selector.unregister(key.fileobj)
                    if child.ended(report):
                        selector.register(child.begin(), selectors.EVENT_READ, child)
            for child in children:
                if hang := child.hang():
                    report.problems.append(f"{child.case}: {hang}")
                    child.kill()
    report.seconds = time.monotonic() - began
    used = resource.getrusage(resource.RUSAGE_CHILDREN), resource.getrusage(resource.RUSAGE_SELF)
    report.cpu_s = sum(each.ru_utime + each.ru_stime for each in used)
    return report


class _Child:
    """One forked process and its cases; after its death another one continues with the next case."""

    def __init__(self, originals: Any, folder: Path, first: int, stop: int, step: int) -> None:
        self.originals, self.folder = originals, folder
        self.next, self.stop, self.step = first, stop, step
        self.case, self.hung, self.done = "no case", False, False
        self._buffer = b""
        self._pid = self._pipe = -1
        self._cpu_s = self._cpu_at_case_s = 0.0
        self._computed_at = 0.0

    def begin(self) -> int:
        self._pipe, writing = os.pipe()
        self._pid = os.fork()
        if self._pid == 0:
            code = 1
            try:
                os.close(self._pipe)
                _run_cases(self.originals, writing, self.folder, self.next, self.stop, self.step)
                code = 0
            finally:
                os._exit(code)
        os.close(writing)
        self.hung, self._cpu_s, self._cpu_at_case_s, self._computed_at = False, 0.0, 0.0, time.monotonic()
        return self._pipe

    def take(self, report: Report) -> bool:
        """Take the lines that are there; return whether the process lives."""
        data = os.read(self._pipe, 65536)
        self._cpu_at_case_s = self._cpu_s
        *lines, self._buffer = (self._buffer + data).split(b"\n")
        for line in lines:
            said = json.loads(line)
            if "case" in said:
                kind, seed = said["case"]
                self.case, self.next = f"{kind} {seed}", seed + self.step
                report.cases[kind] += 1
            report.refused[said.get("refused", "")] += 1
            if "problem" in said:
                report.problems.append(f"{self.case}: {said['problem']}")
            self.done |= "done" in said
        return bool(data)

    def hang(self) -> str:
        """Return why the present case hangs; empty if it does not, or the process is not there."""
        if self.hung or self._pid < 0:
            return ""
        with contextlib.suppress(OSError):
            fields = Path(f"/proc/{self._pid}/stat").read_text().rpartition(")")[2].split()
            cpu_s = (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")
            if cpu_s > self._cpu_s:
                self._cpu_s, self._computed_at = cpu_s, time.monotonic()
        if self._cpu_s - self._cpu_at_case_s > HANG_CPU_S:
            return f"no end after {HANG_CPU_S:g} s of computing"
        return f"it waited for {HANG_S:g} s" if time.monotonic() - self._computed_at > HANG_S else ""

    def kill(self) -> None:
        self.hung = True
        os.kill(self._pid, signal.SIGKILL)

    def ended(self, report: Report) -> bool:
        """Return whether another process must continue."""
        _, status = os.waitpid(self._pid, 0)
        os.close(self._pipe)
        self._pid = -1
        if not self.done and not self.hung:
            report.problems.append(f"{self.case}: its process ended with {os.waitstatus_to_exitcode(status)}")
        self._buffer = b""
        return not self.done and self.next < self.stop and len(report.problems) < 200


# -- in the child ---------------------------------------------------------------------------------------------------------


def _gives_orders(character: str) -> bool:
    """Whether a character is a control character, half of one, or changes lines or the direction of reading."""
    return unicodedata.category(character) in ("Cc", "Cs", "Zl", "Zp") or "\u202a" <= character <= "\u202e"


def problem_of(originals: Any, kind: str, seed: int, folder: Path) -> tuple[str, str]:
    """Run one case; return what is wrong with it, and the sentence by which its file was refused."""
    path = originals.case(kind, seed, folder)
    out, err = io.StringIO(), io.StringIO()
    began, sentence = time.process_time(), ""
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            sentence = originals.read(kind, seed, path)
    except BaseException:  # noqa: BLE001 - whatever it is, it is what is looked for
        return traceback.format_exc(), ""
    took = time.process_time() - began
    said = out.getvalue() + err.getvalue()
    for word in ("Traceback", "error of this program", "MemoryError", "Unable to allocate", "not enough memory"):
        if word in said or word in sentence:
            return f"'{word}' in: {(err.getvalue() or sentence or said)[-2000:]}", sentence
    if strange := sorted(filter(_gives_orders, set(said) - {"\n", "\t"})):
        return f"control characters {strange} in: {said[:500]!r}", sentence
    if took > CPU_S:
        return f"it took {took:.1f} s", sentence
    return "", sentence or err.getvalue()


def _run_cases(originals: Any, reporting: int, folder: Path, first: int, stop: int, step: int) -> None:
    from tests.helpers.fuzz_targets import TARGETS

    channel = os.fdopen(reporting, "w", buffering=1)
    os.dup2(2, 1)  # readers print on the redirected streams only
    folder.mkdir(parents=True, exist_ok=True)
    shares = {name: target.share for name, target in TARGETS.items()}
    vsize = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (vsize + MEMORY_BYTES, vsize + MEMORY_BYTES))
    for seed in range(first, stop, step):
        kind = kind_of(seed, shares)
        channel.write(json.dumps({"case": [kind, seed]}) + "\n")
        problem, sentence = problem_of(originals, kind, seed, folder / "case")
        if problem or sentence:
            channel.write(json.dumps({"refused": kind, **({"problem": problem} if problem else {})}) + "\n")
    channel.write(json.dumps({"done": True}) + "\n")
    channel.flush()


def _again(kind: str, seed: int, folder: Path) -> Iterator[str]:
    from tests.helpers.fuzz_targets import Originals

    folder.mkdir(parents=True, exist_ok=True)
    yield from problem_of(Originals(folder), kind, seed, folder / "case")


def main(words: Sequence[str]) -> None:
    if words[0] == "again":
        print(*_again(words[1], int(words[2]), Path(words[3])), sep="\n")
        return
    report = fuzz(Path(words[1]), *map(int, words[2:]))
    print(json.dumps(vars(report)) if words[0] == "json" else report)


if __name__ == "__main__":
    main(sys.argv[1:])
