"""Fault matrix: runs every fault at every moment, writes docs/fault-matrix.md; exit code 1 if a cell violates a requirement.

    python docs/make_fault_matrix.py [--wires] [PROTOCOL...]

With protocol names only their cells are run, with --wires only the second table's; all of them take about ten minutes.
"""

import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from protocols.registry import PROTOCOLS  # noqa: E402
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS, INTERLOCK_FAULTS, SPECIMEN_FAULTS  # noqa: E402
from tests.helpers.fault_matrix import MOMENTS, ON_WIRES_ONLY, Cell, cell, moments_of  # noqa: E402

ON_WIRES = (
    *(("grpc-gone", moment) for moment in MOMENTS),
    ("scpi-dropped", "settling"),
    ("scpi-silent", "stopping"),
    ("scpi-garbled", "ramp"),
    ("generator-power-off", "recording"),
    ("card-unplugged", "settling"),
    ("card-overrun", "arming"),
)

WIRE_ROW = 4
"""Number of separators in a row of the second table; the first table has one column per moment."""

HEAD = """# The fault matrix

Written by `python docs/make_fault_matrix.py`, which runs every cell on the simulated bench: the fault is injected at
that moment of a real run and stays active. The outcome is determined from the voltage at the simulated amplifier's input and from
the run file, which is opened afterwards. A cell gives the status of the run and the state of the input at its end. The status says
how the run ended; what its result is worth is the verdict, which is not in this table: a run whose sensor is stuck is *completed* with
*no result*.

- **at rest**: the input is constant at rest and no source will change it.
- **unsafe**: rest could not be confirmed by measurement. The program reports this (exit code 3) and what to do by hand. The input
  may be at rest nevertheless, for example if only the card was lost, or at **arming** if the source does not reply: it might hold a level
  that an earlier program left, and the card does not see rest.
- **stopped**: an abort level with the action *ask* was exceeded (the laser was lost), the source returned to measured rest, and the
  simulated operator chose to stop the run.
- **ramp**: on the way to a level that is held by the offset, as on a generator that is not commissioned. At the other moments a level is a waveform of the
  generator, which ends at rest by itself.
- **-**: the protocol has no such moment, for example because nothing is ramped.
- **completed** after a fault during safe shutdown: everything was measured, and the card measured rest although the source no
  longer replied.

If the generator loses its power, its cable or its output, the input is pulled to 0 V, -500 V on the specimen, and software cannot
bring it back: see [safety](safety.md) for the hardware remedy.
"""


def main() -> int:
    only_wires = "--wires" in sys.argv
    chosen = [name for name in sys.argv[1:] if name != "--wires"] or list(PROTOCOLS)
    rows = [line for line in (HERE / "fault-matrix.md").read_text("utf-8").splitlines() if line.startswith("| ")]
    before = {name: [row for row in rows if row.startswith(f"| {name} |")] for name in PROTOCOLS}
    kept = {name: before[name] for name in PROTOCOLS if name not in chosen}
    bad: list[str] = []
    lines = [HEAD, "## Every fault, every protocol, every moment (virtual clock)", ""]
    lines += [f"| protocol | fault | {' | '.join(MOMENTS)} |", "|---|---|" + "---|" * len(MOMENTS)]
    for name in PROTOCOLS:
        if name in kept or only_wires:
            lines += [row for row in before[name] if row.count(" | ") != WIRE_ROW]
            continue
        own = moments_of(name).names
        for fault in [
            fault for fault in FAULT_DESCRIPTIONS if fault not in (*ON_WIRES_ONLY, *SPECIMEN_FAULTS, *INTERLOCK_FAULTS)
        ]:
            cells = [_run(fault, name, moment) if moment in own else None for moment in MOMENTS]
            lines.append(f"| {name} | {fault} | {' | '.join(one.words if one else '-' for one in cells)} |")
            bad += [f"{name}, {fault}: {one.words}" for one in cells if one and one.faults]
            print(lines[-1], flush=True)
    lines += ["", "## On real wires, with the watchdog's process", ""]
    lines += ["| protocol | fault | moment | outcome | the watchdog's log |", "|---|---|---|---|---|"]
    for name in PROTOCOLS:
        if name in kept:
            lines += [row for row in kept[name] if row.count(" | ") == WIRE_ROW]
            continue
        for fault, moment in ON_WIRES:
            if moment not in moments_of(name).names:
                continue
            one = _run(fault, name, moment, wires=True)
            lines.append(f"| {name} | {fault} | {moment} | {one.words} | {_log(one)} |")
            bad += [f"{name}, {fault}, on wires: {one.words}" for one in [one] if one.faults]
            print(lines[-1], flush=True)
    lines += ["", "## The faults", "", "| fault | what it is |", "|---|---|"]
    lines += [f"| {name} | {description} |" for name, description in FAULT_DESCRIPTIONS.items()]
    (HERE / "fault-matrix.md").write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{len(bad)} cells violate a requirement", *bad, sep="\n")
    return int(bool(bad))


def _run(fault: str, name: str, moment: str, wires: bool = False) -> Cell:
    with tempfile.TemporaryDirectory() as folder:
        return cell(fault, name, moment, Path(folder), wires)


def _log(one: Cell) -> str:
    """Return the watchdog's log without times, addresses and repetitions."""
    entries = []
    for line in one.watchdog_log.splitlines():
        message = line.partition("  ")[2]
        if "could not confirm rest" in message:
            entries.append("the program could not confirm rest")
        elif "could NOT be brought to rest" in message:
            entries.append("asked for help; the source could NOT be brought to rest: it does not answer")
        elif "was brought to rest" in message:
            entries.append("asked for help; the source was brought to rest")
    return "; ".join(entries) or "nothing"


if __name__ == "__main__":
    sys.exit(main())
