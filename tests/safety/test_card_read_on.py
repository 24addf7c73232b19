"""The card is read on real wires whatever the program waits for: a silent generator, lost scans, a card that is gone."""

import threading
from contextlib import nullcontext
from pathlib import Path

import pytest

from app.session.bench_connection import BenchConnection
from app.session.reducer import BenchFollower
from app.session.session import Session
from app.session.state import Lamp
from drivers.bench.card_reading import CardReading
from drivers.errors import ScansLostError
from protocols.base import BlockStored, DriveStarted, Event, EventBus, RunStatus
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from tests.helpers.level_protocol import Levels
from tests.helpers.waiting import wait_until
from tests.helpers.wired_bench import WiredBench, wired

BLOCKS = 12
"""Of a twentieth of a second each."""


def reading_of(lab: WiredBench) -> CardReading:
    assert lab.bench.reading is not None
    return lab.bench.reading


@pytest.mark.deep
@pytest.mark.breaks_the_drive
def test_the_card_is_read_while_a_reply_is_awaited_that_does_not_come(tmp_path: Path) -> None:
    stored, drives, ended = 0, 0, []

    def observe(event: Event) -> None:
        nonlocal stored, drives
        stored += isinstance(event, BlockStored)
        drives += isinstance(event, DriveStarted)
        if drives == 1:
            lab.proxy.silent = True

    with wired(generator={"timeout_s": 3.0}) as lab:
        runner = Runner(
            RunRequest(Levels(levels_v=(2.06, 2.3)), tmp_path, "T1"), lab.bench, lab.operator, EventBus(observe)
        )
        thread = threading.Thread(target=lambda: ended.append(runner.run()))
        thread.start()
        measured: dict[int, set[float]] = {}

        def read_on() -> bool:
            if drives:
                measured.setdefault(stored, set()).add(reading_of(lab).measured_s)
            return any(len(each) >= BLOCKS for each in measured.values())

        assert wait_until(read_on), "the program stores nothing, and the card is read"
        low_v, high_v = reading_of(lab).drive_v
        assert (low_v, high_v) == (pytest.approx(2.06, abs=0.02), pytest.approx(2.06, abs=0.02))
        thread.join()
    assert ended[0].status is RunStatus.UNSAFE


@pytest.mark.deep
def test_after_lost_scans_a_served_card_is_read_on_by_itself() -> None:
    with wired() as lab, lab.bench.open_stream(5000.0) as stream:
        stream.read()
        lab.control.inject("card-overrun")

        def lost() -> bool:
            try:
                stream.read()
            except ScansLostError:
                return True
            return False

        assert wait_until(lost)
        before = reading_of(lab).measured_s
        lab.control.clear()
        assert wait_until(lambda: reading_of(lab).measured_s > before)


@pytest.mark.deep
def test_between_runs_the_lamp_of_a_card_that_is_gone_changes_and_comes_back() -> None:
    with wired() as lab:
        follower = BenchFollower(lab.bench.amplifier.map)
        session = Session(lambda: nullcontext(BenchConnection(lab.bench)), [follower.follow], operator=None)  # type: ignore[arg-type]
        follower.observe = lambda: session.observation
        session.monitor(active=True)
        session.start()

        def lamp() -> Lamp:
            return next((each.lamp for each in follower.state.instruments if each.role == "card"), Lamp.WAITING)

        assert wait_until(lambda: follower.strip().present and lamp() is Lamp.READY)
        lab.control.inject("card-unplugged")
        assert wait_until(lambda: lamp() is Lamp.SUSPECT)
        assert wait_until(lambda: follower.strip().measured == "unknown")
        assert "last" in follower.strip().caption
        lab.control.clear()
        assert wait_until(lambda: follower.strip().present and lamp() is Lamp.READY)
        assert session.close(60)
