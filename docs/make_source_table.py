"""Table of protocols and sources: rehearses every protocol on every source, writes docs/protocols-and-sources.md.

    python docs/make_source_table.py

tests/protocols/test_every_source.py fails if the page differs, and runs every cell on simulated hardware.
"""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from protocols.registry import BUILT_IN_PROTOCOLS  # noqa: E402
from tests.helpers.sources import Outcome, outcomes  # noqa: E402

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
    lines += ["", "## Notes", "", *(f"{i}. {note}." for i, note in enumerate(notes, 1)), ""]
    return HEAD + "\n".join(lines)


def cell(outcome: Outcome, notes: list[str]) -> str:
    """Return the text of a cell."""
    if not outcome.note:
        return "yes"
    return f"{'adapted' if outcome.runs else 'no'} ({notes.index(outcome.note) + 1})"


if __name__ == "__main__":
    sys.exit(main())
