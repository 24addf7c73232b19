"""Fault search: runs with random protocols, sources, operators, faults, kills, delays and second hands; writes docs/fault-search.md.

    python docs/make_fault_search.py [--seed N] [--runs N | --minutes N] [--log LOG] [--again] [--page]

Seed N is one run, and gives the same run again; `--runs M` plays the seeds from N on, `--minutes M` as many as the time allows: a night is
`--minutes 600 --log LOG`, without `--seed` from the first seed that LOG does not have. A run that violates a requirement prints one line with the command that replays
it. `--again` plays those of LOG again, after they were mended. `--page` adds the runs of LOG after the page's last seed to the page's counts. The exit code is 1 if a run violates a requirement.
With TMPDIR=/dev/shm, a file system in memory, a run takes a tenth less.
"""

import argparse
import json
import re
import sys
import tempfile
import time
from collections import Counter, defaultdict
from collections.abc import Iterable
from dataclasses import dataclass, field
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from tests.helpers.fault_search.searched import STOPPED_S, TOO_LONG_S, Search  # noqa: E402
from tests.helpers.fault_search.trial import HAZARDS, OPERATORS, SOURCES, drawn  # noqa: E402
from tests.helpers.fault_search.world import TOUCHED_DRIVE_SHARE, TOUCHED_SHARE, WARNED_S  # noqa: E402

ALL = "all runs"

HEAD = f"""# Faults drawn at random

Written by `python docs/make_fault_search.py --log LOG --page`. Each run is drawn from its seed: one of the protocols with random settings, on one of
{len(SOURCES)} generators ({", ".join(SOURCES)}), levels held as a waveform or by the offset, an operator, and up to three hazards at random moments, in a process of its
own on the virtual clock. When the run has ended, the faults end, and a second run follows in the same session or on the bench opened
anew; when the program was killed, another one starts while the simulated world goes on. `python docs/make_fault_search.py --seed N` plays run N again.
Required of every run, from the volts at the simulated amplifier's input, the faults of the simulated bench and the files:

- the volts stay within 0 to 5 V, their slope below 10 kV/s, and no jump exceeds the step of the drive limits (as many steps as messages were lost),
  until another hand or the loss of the drive changes them; high voltage is switched at rest only;
- where the program says *rest*, the input is constant at rest; where the input is not at rest at the end with high voltage on, and no other hand has moved it since rest was measured, the run is *unsafe*, and the warning came within
  {WARNED_S:g} s of the failure; the warning names volts that stood at the input; a source that is live before the end of arming is reported within {WARNED_S:g} s;
- every point that was shown is in a run file with its values, after the repair of the next start;
- no verdict is *good* if another hand, or a fault of the sensor, changed more than {100 * TOUCHED_SHARE:g} % of a recording whose point is used
  ({100 * TOUCHED_DRIVE_SHARE:g} % of its drive, if that began afterwards), or if high voltage was never on;
- the second run completes, at most after the bench was opened anew;
- the run ends within {STOPPED_S:g} s of Stop, never {TOO_LONG_S:g} s of real time without an event or work of the process, without an error of the program in its log.
"""


def main() -> int:
    """Play the chosen runs, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--seed", type=int)
    parser.add_argument("--again", action="store_true", help="play the runs of LOG that violate a requirement")
    parser.add_argument("--runs", type=int)
    parser.add_argument("--minutes", type=float)
    parser.add_argument("--log", type=Path)
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    log = options.log.resolve() if options.log else None
    found = [json.loads(line) for line in log.read_text().splitlines()] if log and log.exists() else []
    if options.page:
        written = HERE / "fault-search.md"
        written.write_text(page(found, written.read_text("utf-8") if written.exists() else ""), "utf-8")
        return 0
    if options.again:
        last_of = {each["seed"]: each for each in found}
        return int(play([seed for seed, each in last_of.items() if each["wrong"]], float("inf"), log))
    first = options.seed if options.seed is not None else max((each["seed"] for each in found), default=0) + 1
    last = first + (options.runs or (1 if options.minutes is None else sys.maxsize))
    until_s = time.monotonic() + 60 * (options.minutes or sys.maxsize)
    return int(play(range(first, last), until_s, log))


def play(seeds: Iterable[int], until_s: float, log: Path | None) -> int:
    """Play seeds until the last or the time; return how many runs violate a requirement."""
    bad = count = 0
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        search = Search(Path(folder))
        for seed in seeds:
            if time.monotonic() > until_s:
                break
            result = search.play(drawn(seed))
            count += 1
            line = {
                "seed": seed,
                "date": datetime.now(UTC).date().isoformat(),
                "protocol": result.trial.protocol,
                "operator": result.trial.operator,
                "status": result.facts.get("status", "none"),
                "happened": [words.partition(" ")[0] for words in result.facts.get("happened", [])],
                "seconds": round(result.seconds, 2),
                "wrong": result.wrong,
            }
            if log is not None:
                with log.open("a") as file:
                    file.write(json.dumps(line) + "\n")
            if result.wrong:
                bad += 1
                words = f"{result.trial.words}: {'; '.join(result.wrong)}"
                print(f"{words[:900]} - python docs/make_fault_search.py --seed {seed}", flush=True)
    print(f"{bad} of {count} runs violate a requirement", flush=True)
    return bad


@dataclass
class Counts:
    """Counts of a page's runs."""

    seeds: tuple[int, int] = (sys.maxsize, 0)
    dates: tuple[str, str] = ("9", "")
    runs: int = 0
    happened: dict[str, Counter[str]] = field(default_factory=lambda: defaultdict(Counter))
    """Runs by how they ended, of each hazard and of `all runs`."""
    operators: Counter[str] = field(default_factory=Counter)
    bad: dict[int, str] = field(default_factory=dict)
    """What the run of a seed violates."""

    @classmethod
    def of_page(cls, text: str) -> "Counts":
        """Return the counts of a written page."""
        counts = cls()
        if not (head := re.search(r"^(\d+) runs, seeds (\d+) to (\d+), (\S+) to (\S+);", text, re.MULTILINE)):
            return counts
        counts.runs, counts.seeds, counts.dates = int(head[1]), (int(head[2]), int(head[3])), (head[4], head[5])
        statuses: list[str] = []
        for row in re.findall(r"^\| (.+) \|$", text, re.MULTILINE):
            name, *cells = (cell.strip() for cell in row.split(" | "))
            if name == "hazard":
                statuses = cells[2:]
            elif name in (*HAZARDS, ALL):
                numbers = zip(statuses, cells[-len(statuses) :], strict=True)
                counts.happened[name].update({status: int(n) for status, n in numbers if n != "-"})
            elif name in OPERATORS:
                counts.operators[name] = int(cells[-1])
        violations = text.partition("## Violations")[2].partition("## ")[0]
        counts.bad = {
            int(seed): words for seed, words in re.findall(r"^\| (\d+) \| (.*) \|$", violations, re.MULTILINE)
        }
        return counts

    def add(self, run: dict[str, Any]) -> None:
        """Count a run."""
        seed = run["seed"]
        if run["wrong"]:
            self.bad[seed] = "; ".join(run["wrong"])[:300]
        self.runs += 1
        self.seeds = min(self.seeds[0], seed), max(self.seeds[1], seed)
        self.dates = min(self.dates[0], run["date"]), max(self.dates[1], run["date"])
        for kind in {*run["happened"], ALL}:
            self.happened[kind][run["status"]] += 1
        self.operators[run["operator"]] += 1


def page(found: list[dict[str, Any]], before: str) -> str:
    """Return the page: the counts of the page before, and of the runs of later seeds, by what happened in them and how they ended."""
    counts = Counts.of_page(before)
    counted = counts.seeds[1]
    for seed, run in sorted({each["seed"]: each for each in found}.items()):
        if seed > counted:
            counts.add(run)
        elif not run["wrong"]:  # it was counted, and mended since then
            counts.bad.pop(seed, None)
    seeds, dates = (" to ".join(map(str, span)) for span in (counts.seeds, counts.dates))
    lines = [HEAD, f"{counts.runs} runs, seeds {seeds}, {dates}; {len(counts.bad)} violate a requirement."]
    statuses = sorted(counts.happened[ALL])
    lines += [
        "",
        f"| hazard | what it is | runs in which it happened | {' | '.join(statuses)} |",
        "|---|---|" + "---|" * (len(statuses) + 1),
    ]
    for kind, words in {**HAZARDS, ALL: ""}.items():
        of_kind = counts.happened[kind]
        lines.append(
            f"| {kind} | {words} | {of_kind.total()} | {' | '.join(str(of_kind[s] or '-') for s in statuses)} |"
        )
    lines += ["", "| operator | what it does | runs |", "|---|---|---|"]
    lines += [f"| {kind} | {words} | {counts.operators[kind]} |" for kind, words in OPERATORS.items()]
    if counts.bad:
        lines += ["", "## Violations", "", "| seed | violated |", "|---|---|"]
        lines += [f"| {seed} | {words} |" for seed, words in sorted(counts.bad.items())]
    return "\n".join([*lines, "", FOUND])


FOUND = """## Found and mended

| seed | what was found | what was mended |
|---|---|---|
| 47 | a Rigol DG1000Z whose download failed between two packets played the next waveform after them: 31 kV/s on the specimen until the readback of the drive stopped it, 0.2 s | the driver ends the packets that may be left before it sends a waveform |
| 914, 597, 905, 1395, 1483, 1819 | another hand moved the source from rest while the program asked for high voltage or measured rest again: the warning came up to 35 s later, after the answer and the failed measurement | while no drive is commanded every block is compared with rest: a warning after 0.3 s, the end of the run after 4 s |
| 909 | a latency was good although the source, whose burst had been switched off, played the step three times | a short drive that begins in a recording is compared as a whole: `DRIVE_OFF` |
| 1430 | a latency of 2.9 ms instead of 1.2 ms was good: another program had played before the sine | the same |
| 1449 | a latency was good although the amplifier was at its current limit: no onset reached the threshold | onsets below the threshold make the verdict doubtful |
| 1898 | the response to a step still moved at its end, for the same reason | such a point is `UNSETTLED` |
| 1276 | a source that played 10 mV was confirmed at rest, since its mean was rest | noise above 5 mV rms is not rest |
| 366 | the message of another program that a 33511B had refused failed the next run | the errors of the source are cleared when it is found at rest |
| 366 | a program that was started after a membrane sag did not ask to put the tactor back under the sensor | the newest run of the folder tells what the next one has to ask for |
| 4473 | the warning came 2.0 s after another model had answered in the place of a DG1032Z: the reply with the level was overdue, and the ramp was begun first | the first failure of a way to rest is told before the next message or wait, on every generator |
| 6065 | an electrical measurement without high voltage ended with "an error of this program" | it ends by the sentence that the voltage on the specimen has no sine |
| 6168, 6342 | on a bench with monitors at the card, rest was not measured to its end after lost scans, and points of an electrical measurement ended with a division by zero | the simulated card forgot its further inputs after lost scans |
| 6777, 7814 | another program set a smaller amplitude while this one held the range of a 33511B: the largest drives were refused until it was switched off | the amplitude is read back when the range is held; with a smaller one the range is set anew at the next start |
| 6860 | a program was killed between the last step to rest and the abort: the next one found a 33511B at rest, whose burst at the idle amplitude ignored the trigger | a burst of others is ended when the source is found at rest, on every generator |
| 8407, 9906 | a person switched burst mode off: an AFG3022C played the burst that was left, 50 mV at 1000 Hz, and a card with 500 Hz saw rest | the burst that is left has 1013 Hz, which no usual sample rate hides |

Not seen: an amplifier at its current limit on a bench without a voltage monitor (481, 2144, 2351, 3226). The drive at its input is right, and the
specimen moves as one with another gain would; a voltage monitor at the amplifier's output shows it (abort levels, `[[channels]]` of the bench file).

Corrected in the requirements: a live source is timed from when it was live, not from the begin of the acquisition (417); a setting that the program sets again before its drive does not count (650); a recording that
the program itself has flagged gives no good point (1352); a failure is seen when the reply is overdue, not when it was asked for (1637); a person
does not set the sensor while the membrane is under it (4188, 4244, 4435, 4481); a point is of the last recording of a drive that is played
twice (4511); a recording begins with a block, and a drive at its trigger (5012, 5068); the amplitude at which a burst idles, 10 mV peak to peak, is rest (2111, 2333);
the ramp to a level is not part of it (2865); a slope is measured over 50 µs, to one code of the converter at either end (5527); a static loading that
begins anew after its zero was lost has a point of the later recordings (6101); a message to a source that has fallen silent is lost, and
the next step of a ramp is by as much larger (6624, 6661); a source holds each point of a waveform for some microseconds (14521); a block of an endurance
run is judged over all of it, not over the rows that are kept (17527); a person moved the level after rest had been measured (20174).
"""


if __name__ == "__main__":
    sys.exit(main())
