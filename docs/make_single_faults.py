"""Single faults: every system call and every message of a run, campaign, accept, backup and report fails once; writes docs/single-faults.md.

    python docs/make_single_faults.py LOG [--only OPERATION] [--kind KIND] [--alike N] [--at-most N] [--seed N] [--page]

LOG is a file of JSON lines, one for each point; points that it has without a violation are not run again. `--alike N` runs at most N
points of each operation whose calls have the same name, kind of file and fault, `--at-most N` at most N points of each operation, drawn by the seed.
`--page` runs nothing; it writes the page from LOG. With `--only` the page is not written. The exit code is 1 if a point violates a requirement. All of the
25,000 points take a day on one core.
"""

import argparse
import json
import random
import sys
import tempfile
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from tests.helpers.single_faults.points import (  # noqa: E402
    KINDS,
    OPERATIONS,
    TOO_LONG_S,
    WAYS,
    Laboratory,
    Point,
    points_of,
)

HEAD = f"""# One fault at every call

Written by `python docs/make_single_faults.py LOG`. Each point is one operation of the program, in a process of its own on the virtual clock, in which
one call fails in one way: a system call on a file (Linux, by seccomp), or a message on a wire of the simulated bench. Required of every point, from the
voltage at the simulated amplifier's input and from the files:

- it ends within {TOO_LONG_S:g} s, with a documented exit code and without a traceback; where nothing is live, Ctrl-C ends the wait for a silent disk;
- the input is at rest at its end, or the exit code is 3 and the operator was warned; no jump, and no voltage outside the range;
- every point that was shown is in a run file, which opens after the repair of the next start, and no other run file was changed;
- a command that failed succeeds when it is repeated without the fault.

[Deadlines](reference/deadlines.md) are shortened to 0.4 to 2 s here, but for *stop*; a delay of the disk on a busy computer can exceed them, and the run then fails.
"""

OUTCOMES = {0: "done", 1: "failed", 2: "refused", 3: "unsafe", 4: "no result", None: "hung"}


def main() -> int:
    """Run the chosen points and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--only", choices=list(OPERATIONS))
    parser.add_argument("--kind", choices=KINDS)
    parser.add_argument("--alike", type=int, default=sys.maxsize)
    parser.add_argument("--at-most", type=int, default=sys.maxsize)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    log = options.log.resolve()
    lines = [json.loads(line) for line in log.read_text().splitlines()] if log.exists() else []
    found = {(each["operation"], each["number"], each["kind"]): each for each in lines}
    if not options.page:
        run_points(options, found, log)
    if not options.only:
        (HERE / "single-faults.md").write_text(page(list(found.values())), "utf-8")
    bad = [each for each in found.values() if each["faults"]]
    print(f"{len(bad)} of {len(found)} points violate a requirement")
    return int(bool(bad))


def run_points(options: argparse.Namespace, found: dict[tuple[str, int, str], dict[str, Any]], log: Path) -> None:
    """Run the chosen points that were not found good before; add them to `found` and to the log."""
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder, log.open("a", buffering=1) as file:
        laboratory = Laboratory(Path(folder))
        for name in [options.only] if options.only else OPERATIONS:
            every = list(points_of(name, calls := laboratory.count(name), [options.kind] if options.kind else KINDS))
            chosen = list(drawn(every, calls, options.alike, random.Random(options.seed)))[: options.at_most]
            print(f"{name}: {len(calls)} calls, {len(every)} points, of which {len(chosen)} are run", flush=True)
            for point in chosen:
                key = point.operation, point.number, point.kind
                if key in found and not found[key]["faults"]:
                    continue
                outcome = laboratory.run(point)
                found[key] = {
                    "operation": name,
                    "number": point.number,
                    "kind": point.kind,
                    "call": outcome.call,
                    "code": outcome.code,
                    "seconds": round(outcome.seconds, 1),
                    "faults": outcome.faults,
                    "text": outcome.text[-4000:] if outcome.faults else "",
                }
                file.write(json.dumps(found[key]) + "\n")
                if outcome.faults:
                    print(*key, outcome.call, "; ".join(outcome.faults), flush=True)


def drawn(every: list[Point], calls: list[str], alike: int, choice: random.Random) -> Iterator[Point]:
    """Yield the points, or of those whose calls and faults are alike a random selection, in random order."""
    count = Counter[tuple[str, str]]()
    for point in choice.sample(every, len(every)):
        group = calls[point.number], point.kind
        count[group] += 1
        if count[group] <= alike:
            yield point


def page(found: list[dict[str, Any]]) -> str:
    """Return the page: counts of outcomes by operation and kind, and what was violated."""
    bad = [each for each in found if each["faults"]]
    lines = [HEAD, f"{len(found)} points were run; {len(bad)} violate a requirement.", ""]
    lines += [f"| operation | fault | points | {' | '.join(OUTCOMES.values())} | longest, s | violations |"]
    lines += ["|---|---|" + "---|" * (len(OUTCOMES) + 3)]
    for name, operation in OPERATIONS.items():
        for kind in KINDS:
            here = [each for each in found if (each["operation"], each["kind"]) == (name, kind)]
            if not here:
                continue
            counts = Counter(each["code"] for each in here)
            cells = " | ".join(str(counts[code] or "-") for code in OUTCOMES)
            longest = max(each["seconds"] for each in here)
            violations = sum(bool(each["faults"]) for each in here)
            title = f"{name} ({operation.boundary})"
            lines.append(f"| {title} | {kind} | {len(here)} | {cells} | {longest:g} | {violations or '-'} |")
    lines += ["", "## The faults", "", "| boundary | fault | what it is |", "|---|---|---|"]
    lines += [f"| {where} | {kind} | {way} |" for where, ways in WAYS.items() for kind, way in ways.items()]
    if bad:
        lines += ["", "## Violations", "", "| operation | call | fault | violated |", "|---|---|---|---|"]
        lines += [
            f"| {each['operation']} | {each['number']}: {each['call']} | {each['kind']} | {'; '.join(each['faults'])} |"
            for each in bad
        ]
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    sys.exit(main())
