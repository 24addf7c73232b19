"""Faults seen in the window: every fault in every state of a bench in real time; writes docs/window-faults.md.

    python docs/make_window_faults.py LOG [--only STATE] [--page]

LOG is a file of JSON lines, one for each case; cases that it has are not run again. A case takes ten seconds. `--page` runs
nothing. The exit code is 1 if a view lags by more than it may.
"""

import argparse
import contextlib
import itertools
import json
import math
import re
import sys
import tempfile
import time
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from PySide6.QtCore import QCoreApplication, QSettings, Qt  # noqa: E402
from PySide6.QtWidgets import QApplication  # noqa: E402

from app.config.bench_file import load_bench  # noqa: E402
from app.gui.shell.main_window import MainWindow  # noqa: E402
from app.session.state import BenchState, Lamp  # noqa: E402
from drivers.nidaq.analog_input import NiStream  # noqa: E402
from protocols.measurements.sine_dwell import SineDwell  # noqa: E402
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS, INTERLOCK_FAULTS  # noqa: E402
from tests.helpers.fault_search.witness import PARTS, SLACK_V, Witness  # noqa: E402
from tests.helpers.main_window import Bench, press, whole_window  # noqa: E402

FAULTS = [name for name in FAULT_DESCRIPTIONS if name not in INTERLOCK_FAULTS]
STATES = [
    BenchState.IDLE,
    BenchState.ARMING,
    BenchState.LIVE,
    BenchState.PAUSED,
    BenchState.GOING_TO_REST,
    BenchState.AT_REST,
]
MOST_S, ROUNDING_S = 0.3, 1e-6
"""Largest lag of the volts and of the lamps behind the card and the instruments."""
WATCHED_S = 3.0
PATIENCE_S = 40.0

HEAD = f"""# Faults in the window

Written by `python docs/make_window_faults.py LOG`: {len(FAULTS)} faults in {len(STATES)} states of the simulated bench, served on its wires in real time,
in a whole window whose prompts the script answers. For {WATCHED_S:g} s after the fault, at every turn of the window's event loop, the strip's volts are
compared with the blocks that left the card, and the lamps with the blocks and the errors of the instruments, noted at their source.

- **volts**: largest lag of volts that are shown as present: age of the newest block that lies within them, or of the oldest that is needed to contain them.
- **lamp**: for so long the part at fault was green after the fault had shown in a block, an answer or a passed deadline; no figure where no part is at fault,
  or the fault does not show in this state.

Both may be {MOST_S:g} s at most. Both contain turns of the event loop: *turn* is the longest one, *busy* the processor time that the window's thread used in
it; a turn that is much longer than its busy time waited for the computer's other programs, or for this program's other threads.

With *scpi-late* in *going to rest* the deadline passes in the ramp, and the failure is told before its next command: in 8 further tries at load
averages of 14 to 17 the lamp was never late (0.0 s).
"""


@dataclass
class Case:
    """What the window showed of a fault."""

    state: str
    fault: str
    injected: bool = False
    shown: bool = False
    """Whether the fault showed in a block or an answer."""
    volts_s: float = 0.0
    lamp_s: float = 0.0
    turn_s: float = 0.0
    """Longest turn of the event loop."""
    busy_s: float = 0.0
    """Processor time of the window's thread in that turn."""
    looks: int = 0
    ended: str = ""
    """The state of the bench at the end."""

    @property
    def is_late(self) -> bool:
        return not self.injected or max(self.volts_s, self.lamp_s) > MOST_S + ROUNDING_S


class WindowWitness(Witness):
    """Compares what a window shows with what the card and the instruments show."""

    def __init__(self, window: MainWindow, bench: Bench, case: Case) -> None:
        super().__init__()
        self.window, self.case = window, case
        self.lab = bench.laboratory
        self._last_s, self._last_busy_s = time.monotonic(), time.thread_time()

    @property
    def view(self) -> Any:
        return self.window.state

    def look(self) -> None:
        now_s, real_s, busy_s = self.now(), time.monotonic(), time.thread_time()
        if self.injected_s < math.inf:
            if real_s - self._last_s > self.case.turn_s:
                self.case.turn_s, self.case.busy_s = real_s - self._last_s, busy_s - self._last_busy_s
            self.case.looks += 1
            self.case.volts_s = max(self.case.volts_s, self._volts_lag_s(now_s))
            lamps = {each.role: each.lamp for each in self.window.state.instruments}
            if lamps.get(PARTS.get(self.fault, "")) is Lamp.READY and now_s > self.shown_s:
                self.case.lamp_s = max(self.case.lamp_s, now_s - self.shown_s)
        self._last_s, self._last_busy_s = real_s, busy_s

    def _volts_lag_s(self, now_s: float) -> float:
        """Return how old the blocks are that the shown volts describe; 0 where none are shown as present."""
        strip = self.window.strip.view
        figures = [float(v.replace("−", "-")) for v in re.findall(r"[−+]?\d+", strip.measured)] if strip else []
        if strip is None or not strip.present or not figures or not self.blocks:
            return 0.0
        low, high = min(figures) - SLACK_V, max(figures) + SLACK_V
        within = next((at for at, b_low, b_high in reversed(self.blocks) if low <= b_low and b_high <= high), -math.inf)
        contained, lowest, highest = -math.inf, math.inf, -math.inf
        for at, b_low, b_high in reversed(self.blocks):
            lowest, highest = min(lowest, b_low), max(highest, b_high)
            if lowest - SLACK_V <= min(figures) and max(figures) <= highest + SLACK_V:
                contained = at
                break
        newest = self.blocks[-1][0]  # a block that was not read yet contradicts nothing
        return min(newest - min(within, contained), now_s)


def run_case(state: BenchState, fault: str) -> Case:
    """Bring a window into a state, inject the fault there, and watch it."""
    case, config = Case(str(state), fault), load_bench("ideal")
    bench = Bench(config, speed=1.0)
    protocol = SineDwell(frequencies_hz=(100.0,) if state is BenchState.AT_REST else (100.0, 120.0, 140.0, 160.0))
    with tempfile.TemporaryDirectory(ignore_cleanup_errors=True) as folder:
        settings = QSettings(f"{folder}/settings.ini", QSettings.Format.IniFormat)
        with whole_window(bench, config, protocol, Path(folder), settings) as window:
            witness = WindowWitness(window, bench, case)
            with witness.noting(NiStream), contextlib.suppress(TimeoutError):
                _drive(window, witness, state, fault)
            case.injected, case.shown = witness.injected_s < math.inf, witness.shown_s < math.inf
            case.ended = str(window.state.bench_state)
    return case


def _drive(window: MainWindow, witness: WindowWitness, state: BenchState, fault: str) -> None:
    idle = state in (BenchState.IDLE, BenchState.AT_REST)

    def turn_until(is_so: Callable[[], bool], patience_s: float = PATIENCE_S) -> None:
        until_s = time.monotonic() + patience_s
        while not is_so():
            if time.monotonic() > until_s:
                raise TimeoutError
            QCoreApplication.processEvents()
            prompt = window.adapter.mailbox.pending_id
            if prompt is not None and state is not BenchState.ARMING:
                window.adapter.mailbox.reply(prompt)
            witness.look()
            time.sleep(0.005)

    def is_there() -> bool:
        view = window.state
        if state is BenchState.ARMING:
            return view.phase is state and window.adapter.mailbox.pending_id is not None
        if idle:
            return view.phase is state and not view.busy and len(witness.blocks) > 4
        return view.phase is state and (state is not BenchState.LIVE or view.drive is not None)

    if state is not BenchState.IDLE:
        press(window, Qt.Key.Key_F5)
    if state in (BenchState.PAUSED, BenchState.GOING_TO_REST):
        turn_until(lambda: window.state.phase is BenchState.LIVE and window.state.drive is not None)
        press(window, Qt.Key.Key_F8 if state is BenchState.PAUSED else Qt.Key.Key_F12)
    turn_until(is_there)
    witness.inject(fault)
    with contextlib.suppress(TimeoutError):
        turn_until(lambda: False, WATCHED_S)


def page(cases: Iterable[Case]) -> str:
    """Return the page: the largest lags of each fault, and the cases that are late."""
    cases = list(cases)
    lines = [
        HEAD,
        f"Cases: {len(cases)}; late: {sum(each.is_late for each in cases)}.",
        "",
        "| fault | part | states | shows in | volts, s | lamp, s | turn, s | busy, s | late |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for fault in FAULTS:
        if not (here := [each for each in cases if each.fault == fault]):
            continue
        turn, busy = max((each.turn_s, each.busy_s) for each in here)
        cells = [
            fault,
            PARTS.get(fault, "-"),
            str(len(here)),
            str(sum(each.shown for each in here) or "-"),
            f"{max(each.volts_s for each in here):.2f}",
            f"{max(each.lamp_s for each in here):.2f}" if fault in PARTS else "-",
            f"{turn:.2f}",
            f"{busy:.2f}",
            ", ".join(each.state for each in here if each.is_late) or "-",
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join([*lines, ""])


def main() -> int:
    """Run the cases that the log does not have and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--only", choices=[str(state) for state in STATES])
    parser.add_argument("--page", action="store_true")
    options = parser.parse_args()
    log: Path = options.log.resolve()
    lines = [Case(**json.loads(line)) for line in log.read_text().splitlines()] if log.exists() else []
    found = {(each.state, each.fault): each for each in lines}
    states = [] if options.page else [state for state in STATES if options.only in (None, str(state))]
    application = QApplication.instance() or QApplication([])
    with log.open("a", buffering=1) as file:
        for state, fault in itertools.product(states, FAULTS):
            if (str(state), fault) not in found:
                case = found[str(state), fault] = run_case(state, fault)
                file.write(json.dumps(asdict(case)) + "\n")
                if case.is_late:
                    print(case, flush=True)
    del application
    if not options.only:
        (HERE / "window-faults.md").write_text(page(found.values()), "utf-8")
    late = sum(each.is_late for each in found.values())
    print(f"{late} of {len(found)} cases are late")
    return int(bool(late))


if __name__ == "__main__":
    sys.exit(main())
