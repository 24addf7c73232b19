"""Protocols other than the sine dwell in the window: points of the wiring check, report of a watchdog action."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import pytest
from annotated_types import Unit

from drivers.watchdog.log import LOG_NAME
from protocols.base import LogMessage, PointMeasured, Quality, RunStarted
from protocols.measurements.wiring_check import WiringPoint
from tests.helpers.main_window import until

POINT = WiringPoint(
    2.6, 0.0, float("nan"), 2.6, 0.0, 3e-4, float("nan"), 1.4e-5, 7e-9, 0.0, float("nan"), 0.0, 5e-7, 32
)


@pytest.mark.deep
def test_points_of_the_wiring_check_are_told_and_break_nothing(open_stage: Any) -> None:
    stage = open_stage()
    stage.window.adapter.observe(RunStarted("wiring-check", "run.h5", 6.0, 4, True))
    stage.window.adapter.observe(PointMeasured(0, POINT))
    until(lambda: any("drive reads back 2.6000 V" in m.text for m in stage.window.state.messages))


def test_what_a_watchdog_wrote_is_told_when_the_window_opens(open_stage: Any, tmp_path: Path) -> None:
    (tmp_path / LOG_NAME).write_text("2026-11-21T09:15:02.000Z  the source was brought to rest\n")
    stage = open_stage()
    until(lambda: any("the watchdog wrote: 2026-11-21" in m.text for m in stage.window.state.messages))


@dataclass
class _PlainPoint:
    """A point of a laboratory's own protocol: two axes, no text and no peak-to-peak value."""

    temperature: Annotated[float, Unit("K"), "of the oven"]
    humidity: Annotated[float, Unit("1"), "beside the specimen"]
    quality: int = int(Quality.SIMULATED)


class _FailingPoint(_PlainPoint):
    @property
    def summary(self) -> str:
        return str({}["text"])


@pytest.mark.deep
def test_points_of_a_laboratorys_own_protocol_are_described_by_their_axes(open_stage: Any) -> None:
    stage = open_stage()
    stage.window.adapter.observe(RunStarted("oven", "run.h5", 6.0, 4, True))
    stage.window.adapter.observe(PointMeasured(0, _PlainPoint(295.25, 0.41)))
    stage.window.adapter.observe(PointMeasured(1, _FailingPoint(296.5, 0.42)))
    stage.window.adapter.observe(LogMessage("what follows is told, too"))
    until(lambda: any("what follows is told" in m.text for m in stage.window.state.messages))
    told = [m.text for m in stage.window.state.messages]
    assert any("295.25 K" in text and "humidity" in text for text in told), told
    assert any("296.5" in text for text in told), told
