"""Silent and cut wires on real connections: the operator is warned at once, with the volts at the amplifier's input."""

import re
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from drivers.bench.rest import SWITCH_OFF_NOW
from protocols.base import DriveStarted, Event, EventBus, RestMeasured, RunStatus, SpecimenMayBeLive
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from tests.helpers.level_protocol import Levels
from tests.helpers.wired_bench import WiredBench, wired


def timed_run(
    lab: WiredBench, folder: Path, at_drive: int, act: Callable[[], None], levels_v: tuple[float, ...] = (2.06, 2.3)
) -> tuple[Runner, RunStatus, list[tuple[float, float, Event]]]:
    """Run levels and act at the given drive; return each event with its time and the volts in the plant since then."""
    events: list[tuple[float, float, Event]] = []
    begin_s = time.monotonic()
    drives = 0

    def observe(event: Event) -> None:
        nonlocal drives, begin_s
        events.append((time.monotonic() - begin_s, lab.control.report().end_v, event))
        if isinstance(event, DriveStarted):
            drives += 1
            if drives == at_drive:
                begin_s = time.monotonic()
                act()

    runner = Runner(RunRequest(Levels(levels_v=levels_v), folder, "T1"), lab.bench, lab.operator, EventBus(observe))
    return runner, runner.run().status, events


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_a_generator_that_falls_silent_under_a_held_level_is_reported_after_one_timeout(tmp_path: Path) -> None:
    def fall_silent() -> None:
        lab.proxy.silent = True

    with wired(generator={"timeout_s": 1.5}) as lab:
        runner, status, events = timed_run(lab, tmp_path, 1, fall_silent)
    assert status is RunStatus.UNSAFE
    at_s, volts, warning = next(e for e in events if isinstance(e[2], SpecimenMayBeLive))
    assert isinstance(warning, SpecimenMayBeLive)
    assert volts == pytest.approx(2.06, abs=0.01), "it is told while the level is on the specimen"
    assert warning.low_v == pytest.approx(2.06, abs=0.01)
    assert re.search(r"\b2\.0[56]\d V\b", warning.words)
    assert SWITCH_OFF_NOW in warning.words
    rest_s = next(e[0] for e in events if isinstance(e[2], RestMeasured))
    assert rest_s > at_s + 1.0, "after one timeout, before the program tries again"
    with Run(runner.path) as file:
        assert "MayBeLive" in [event.kind for event in file.events()]
