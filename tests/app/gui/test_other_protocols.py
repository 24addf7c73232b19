"""Protocols other than the sine dwell in the window: points of the wiring check, report of a watchdog action."""

from pathlib import Path
from typing import Any

import pytest

from drivers.watchdog.log import LOG_NAME
from protocols.base import PointMeasured, RunStarted
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
