"""Every fault in every state of a bench: no volts that the card contradicts, and no green lamp on the part at fault.

The state is looked at every 50 ms of bench time, also while the program waits for a reply or a ramp. What it shows is
compared with the blocks that left the card and with the errors of the instruments, which the test notes at their source.
"""

import math
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import pytest

from app.session.bench_connection import BenchConnection, connect
from app.session.reducer import observe, reduce
from app.session.session import BenchFailed, BenchOpened, Observation, Session, SessionEvent
from app.session.state import BenchState, Lamp, TimedEvent, initial_window_state
from app.session.strip import StripView, strip_view
from model.amplifier_map import AmplifierMap
from protocols.base import PointMeasured, Prompt, RunEnded
from protocols.measurements.sine_dwell import SineDwell
from protocols.runner.request import RunRequest
from sim_hardware.clock import VirtualClock
from sim_hardware.operator import SimulatedOperator
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS, INTERLOCK_FAULTS, SPECIMEN_FAULTS
from tests.helpers.fault_search.witness import PARTS, SLACK_V, Witness
from tests.helpers.level_protocol import Levels
from tests.helpers.simulated_bench import simulated

WITHIN_S = 0.3
"""For so long the view may lag behind what the card and the instruments show."""
BLOCK_S = 0.05
WATCHED_S = 3.0
"""Bench time for which a state is watched under a fault."""


class WatchedClock(VirtualClock):
    """Bench time that lets the test look at the view every 50 ms, whatever the program waits for."""

    look: Callable[[], None] = staticmethod(lambda: None)

    def sleep(self, seconds: float) -> None:
        left_s = seconds
        while left_s > 0:
            super().sleep(min(left_s, BLOCK_S))
            left_s -= BLOCK_S
            type(self).look()


class SlowOperator(SimulatedOperator):
    """Answers the prompt with this action only after a while."""

    slow_at = ""

    def show(self, ask_id: int, prompt: Prompt, patience_s: float | None = None) -> None:
        super().show(ask_id, prompt, patience_s)
        if prompt.action == self.slow_at:
            self._answers[ask_id] = self._bench.now() + WATCHED_S, prompt.choices[0]


class Watch(Witness):
    """Looks at the view of a session, and notes what the card and the instruments show."""

    def __init__(self) -> None:
        super().__init__()
        self.view = initial_window_state(AmplifierMap(), "bench", True, {"generator": "g", "card": "c", "sensor": "s"})
        self.seen = Observation()
        self.looks = 0
        self.complaints: list[str] = []
        self.thread = 0

    def event(self, event: SessionEvent) -> None:
        self.view = reduce(
            self.view, TimedEvent(event, datetime.now(UTC), at_s=0.0 if self.lab is None else self.now())
        )
        if isinstance(event, BenchOpened):
            self.thread = threading.get_ident()
        self.look()

    def strip(self) -> StripView:
        assert self.lab is not None
        reading, now_s = self.lab.bench.reading, self.now()
        if reading is not None:  # bench time in the place of real time
            self.seen = Observation(replace(reading, measured_s=now_s - reading.age_s(time.monotonic())))
        self.view = observe(self.view, self.seen, now_s, datetime.now(UTC))
        return strip_view(self.view, self.seen, now_s)

    def look(self) -> None:
        """Compare what is shown now with what the card and the instruments have shown."""
        if self.lab is None or threading.get_ident() != self.thread:
            return
        strip, now_s = self.strip(), self.now()
        self.looks += 1
        figures = [float(v.replace("−", "-")) for v in re.findall(r"[−+]?\d+", strip.measured)]
        latest = [block for block in self.blocks if block[0] > self.blocks[-1][0] - WITHIN_S]
        if figures and strip.present:
            low, high = min(b[1] for b in latest), max(b[2] for b in latest)
            if not (low - SLACK_V <= min(figures) and max(figures) <= high + SLACK_V):
                self.complain(f"shows {strip.measured}, and the card saw {low:.0f} to {high:.0f} V")
            if not (min(figures) - SLACK_V <= latest[-1][1] and latest[-1][2] <= max(figures) + SLACK_V):
                self.complain(
                    f"shows {strip.measured}, and the last block {latest[-1][1]:.0f} to {latest[-1][2]:.0f} V"
                )
        age_s = now_s - self.blocks[-1][0] if self.blocks else math.inf
        if strip.measured and ((age_s > 0.6 and strip.present) or (age_s > 2.1 and figures)):
            self.complain(f"shows {strip.measured} ({strip.caption}), {age_s:.2f} s old")
        lamps = {each.role: each.lamp for each in self.view.instruments}
        if lamps.get(PARTS.get(self.fault, "")) is Lamp.READY and now_s > self.shown_s + WITHIN_S:
            self.complain(f"the {PARTS[self.fault]} is green {now_s - self.shown_s:.2f} s after its fault showed")

    def complain(self, text: str) -> None:
        self.complaints.append(f"{self.now() - self.injected_s:+.2f} s, {self.view.bench_state}: {text}")


@pytest.fixture
def watch(monkeypatch: pytest.MonkeyPatch) -> Iterator[Watch]:
    watch = Watch()
    monkeypatch.setattr("sim_hardware.VirtualClock", WatchedClock)
    monkeypatch.setattr(WatchedClock, "look", watch.look)
    with watch.noting():
        yield watch


@contextmanager
def session(watch: Watch, *observers: Callable[[SessionEvent], None], slow_at: str = "") -> Iterator[Session]:
    @contextmanager
    def opened() -> Iterator[BenchConnection]:
        with connect(simulated(), None) as lab:
            # So that watching between runs takes no real time.
            lab.bench.configuration = {**lab.bench.configuration, "speed": 1.0}
            assert lab.control is not None
            operator = SlowOperator(lab.control)
            operator.slow_at = slow_at
            watch.lab = BenchConnection(lab.bench, operator, lab.control)
            yield watch.lab

    one = Session(opened, [watch.event, *observers], operator=None)  # type: ignore[arg-type]
    one.monitor(active=True)
    one.start()
    try:
        yield one
    finally:
        assert one.close(60)
        watch.lab = None


def reach(state: BenchState, watch: Watch, fault: str, folder: Path) -> None:
    """Bring a bench into a state, inject the fault there, and watch it."""
    done, points = threading.Event(), 0
    idle = state in (BenchState.IDLE, BenchState.AT_REST)

    def follow(event: SessionEvent) -> None:
        nonlocal points
        points += isinstance(event, PointMeasured)
        if isinstance(event, RunEnded | BenchFailed) and not idle:
            done.set()
        if watch.injected_s < math.inf:
            passed_s = watch.now() - watch.injected_s
            if passed_s > WATCHED_S:
                one.resume()
                done.set()
            return
        if state in (BenchState.PAUSED, BenchState.GOING_TO_REST) and points == 1:
            one.pause() if state is BenchState.PAUSED else one.stop()
        here = watch.view.phase is state and (state is not BenchState.LIVE or points == 1)
        if here and (not idle or not watch.view.busy) and watch.view.watched is idle:
            watch.inject(fault)

    slow = {BenchState.ARMING: "disable-high-voltage", BenchState.HV_OFF: "fix-mass"}.get(state, "")
    protocol = Levels(levels_v=(2.0, 2.2), setups=(1, 2)) if state is BenchState.HV_OFF else SineDwell()
    with session(watch, follow, slow_at=slow) as one:
        if state is not BenchState.IDLE:
            one.run(
                RunRequest(
                    protocol if state is not BenchState.AT_REST else SineDwell(frequencies_hz=(100,)), folder, "T1"
                )
            )
        assert done.wait(120), f"{state} was not reached"


STATES = (
    BenchState.IDLE,
    BenchState.ARMING,
    BenchState.LIVE,
    BenchState.PAUSED,
    BenchState.HV_OFF,
    BenchState.GOING_TO_REST,
    BenchState.AT_REST,
)


@pytest.mark.breaks_the_drive
@pytest.mark.one_in(20)
@pytest.mark.parametrize("fault", FAULT_DESCRIPTIONS)
@pytest.mark.parametrize("state", STATES)
def test_no_volts_that_the_card_contradicts_and_no_green_lamp_on_the_part_at_fault(
    state: BenchState, fault: str, watch: Watch, tmp_path: Path
) -> None:
    if state in (BenchState.IDLE, BenchState.AT_REST) and PARTS.get(fault) == "card":
        pytest.skip("bench time stands still while nothing can be read: see tests/safety/test_card_read_on.py")
    reach(state, watch, fault, tmp_path)
    assert watch.looks > 3
    assert watch.injected_s < math.inf, "the fault was injected"
    assert not watch.complaints, "\n".join(watch.complaints[:10])
    assert fault in PARTS or fault in (*SPECIMEN_FAULTS, *INTERLOCK_FAULTS, "amplifier-limited", "clock-drift")
