"""Table of protocols and sources: rehearses every protocol on every source, writes docs/protocols-and-sources.md.

    python docs/make_source_table.py

tests/protocols/test_every_source.py fails if the page differs, and runs every cell on simulated hardware.
"""

import math
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from protocols.registry import BUILT_IN_PROTOCOLS  # noqa: E402
from tests.helpers.sources import ALIKE, Outcome, outcomes  # noqa: E402

PAGE = HERE / "protocols-and-sources.md"

HEAD = """# Protocols and sources

Written by `python docs/make_source_table.py`, which rehearses every protocol with its default parameters on a simulated bench with each source. The
test `tests/protocols/test_every_source.py` runs all of them there, with fewer points.

- **yes**: runs as it is.
- **adapted**: runs with other parameters, because the source cannot play the drives as they were requested. The run's log and the rehearsal give
  the change; the run file keeps both the parameters that were played and the requested ones.
- **no**: refused before the operator is asked for high voltage; the message names what to do.

A number refers to the notes below.

"""

UNATTENDED = """## When program and watchdog are dead
After how many seconds the longest drive of each protocol is at rest by itself, at the latest, if program and watchdog die at the moment when it begins. A
generator plays a held level as a finite waveform, whose ramps and margin are included. **stays**: the output stays where it is, and only the amplifier's
own switch helps. **-**: the protocol is refused, or drives nothing. For a generator that is driven without a valid commissioning record
(`--without-commissioning`) every held level *stays*, and so does every drive of a card in this computer without NI's gRPC server (docs/safety.md).

"""


def main() -> int:
    PAGE.write_text(page(), encoding="utf-8")
    print(PAGE)
    return 0


def page() -> str:
    """Return the text of the page."""
    found = outcomes()
    notes = list(dict.fromkeys(each.note for row in found.values() for each in row.values() if each.note))
    names = list(BUILT_IN_PROTOCOLS)
    lines = [f"| source | {' | '.join(names)} |", "|---|" + "---|" * len(names)]
    for source, row in found.items():
        lines.append(f"| {source} | {' | '.join(cell(row[name], notes) for name in names)} |")
    lines += ["", f"Rows stand for other models, too: {'; '.join(alike())}. DC supplies of all families are alike.", ""]
    lines += [*UNATTENDED.splitlines(), *lines[:2]]
    for source, row in found.items():
        lines.append(f"| {source} | {' | '.join(unattended(row[name]) for name in names)} |")
    lines += ["", "## Notes", "", *(f"{i}. {note}." for i, note in enumerate(notes, 1)), ""]
    return HEAD + "\n".join(lines)


def alike() -> list[str]:
    """Return for which models a row stands besides its own."""
    return [f"{row} for {', '.join(others)}" for row, others in ALIKE.items()]


def cell(outcome: Outcome, notes: list[str]) -> str:
    """Return the text of a cell."""
    if not outcome.note:
        return "yes"
    return f"{'adapted' if outcome.runs else 'no'} ({notes.index(outcome.note) + 1})"


def unattended(outcome: Outcome) -> str:
    """Return the text of a cell: after how long the longest drive is at rest by itself."""
    if not outcome.runs or not outcome.unattended_s:
        return "-"
    return f"{math.ceil(outcome.unattended_s)} s" if math.isfinite(outcome.unattended_s) else "**stays**"


if __name__ == "__main__":
    sys.exit(main())
