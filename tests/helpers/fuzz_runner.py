"""Runs fuzz cases in child processes with limits of memory and time, and reports those that fail.

One case again, with the file it damages left in a folder: `python -m tests.helpers.fuzz_runner again KIND SEED FOLDER`.
"""

import contextlib
import io
import json
import os
import random
import resource
import selectors
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
"""Silence after which a case hangs; a busy computer slows a case down, and a hang never ends."""
ROOT = Path(__file__).parents[2]


@dataclass
class Report:
    """What the cases of a session found."""

    cases: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    problems: list[str] = field(default_factory=list)
    seconds: float = 0.0

    def __str__(self) -> str:
        each = ", ".join(f"{kind} {n} ({self.refused[kind]} refused)" for kind, n in sorted(self.cases.items()))
        lines = [f"{self.cases.total()} cases in {self.seconds:.0f} s: {each}", *self.problems]
        return "\n".join(lines)


def kind_of(seed: int, shares: dict[str, float]) -> str:
    return random.Random(f"kind-{seed}").choices(list(shares), list(shares.values()))[0]


def fuzz(folder: Path, start: int, count: int, workers: int = 2) -> Report:
    """Run the cases `start` to `start + count`, shared by child processes."""
    report, began = Report(), time.monotonic()
    children = [_Child(folder / str(i), start + i, start + count, workers) for i in range(workers)]
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
                if child.process.poll() is None and time.monotonic() - child.heard_at > HANG_S:
                    report.problems.append(f"{child.case}: no end after {HANG_S:g} s")
                    child.hung = True
                    child.process.kill()
    report.seconds = time.monotonic() - began
    return report


class _Child:
    """One child process and its cases; after its death another one continues with the next case."""

    def __init__(self, folder: Path, first: int, stop: int, step: int) -> None:
        self.folder, self.next, self.stop, self.step = folder, first, stop, step
        self.case, self.heard_at, self.hung, self.done = "no case", time.monotonic(), False, False
        self._buffer = b""

    def begin(self) -> int:
        words = [sys.executable, "-m", "tests.helpers.fuzz_runner", "child", str(self.folder)]
        words += [str(n) for n in (self.next, self.stop, self.step)]
        environment = {**os.environ, "PYTHONPATH": str(ROOT), "OPENBLAS_NUM_THREADS": "1"}
        self.process = subprocess.Popen(words, stdout=subprocess.PIPE, cwd=ROOT, env=environment)
        self.heard_at, self.hung = time.monotonic(), False
        assert self.process.stdout is not None
        return self.process.stdout.fileno()

    def take(self, report: Report) -> bool:
        """Take the lines that are there; return whether the process lives."""
        assert self.process.stdout is not None
        data = os.read(self.process.stdout.fileno(), 65536)
        self.heard_at = time.monotonic()
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

    def ended(self, report: Report) -> bool:
        """Return whether another process must continue."""
        code = self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()
        if not self.done and not self.hung:
            report.problems.append(f"{self.case}: its process ended with {code}")
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


def _child(folder: Path, first: int, stop: int, step: int) -> None:
    # Readers print on the redirected streams; this one is the parent's.
    channel = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)
    import warnings

    from tests.helpers.fuzz_targets import TARGETS, Originals

    warnings.simplefilter("ignore")
    folder.mkdir(parents=True, exist_ok=True)
    originals = Originals(folder)
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


def _again(kind: str, seed: int, folder: Path) -> Iterator[str]:
    from tests.helpers.fuzz_targets import Originals

    folder.mkdir(parents=True, exist_ok=True)
    yield from problem_of(Originals(folder), kind, seed, folder / "case")


def main(words: Sequence[str]) -> None:
    if words[0] == "child":
        _child(Path(words[1]), *map(int, words[2:]))
    elif words[0] == "again":
        print(*_again(words[1], int(words[2]), Path(words[3])), sep="\n")
    else:
        print(fuzz(Path(words[1]), int(words[2]), int(words[3])))


if __name__ == "__main__":
    main(sys.argv[1:])
