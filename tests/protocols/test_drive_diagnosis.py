"""A deviation of the first large drive names its cause: what 50 mV at arming cannot show."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.session.bench_connection import BenchConnection
from protocols.base import RunStatus
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

LARGE_V = 0.3


def plant(lab: BenchConnection, change: Any) -> None:
    """Change the settings of the generator at each trigger of a large drive; no query tells."""
    generator: Any = lab.control.generator  # type: ignore[union-attr]
    trigger = generator.trigger

    def changed() -> None:
        own = generator.settings
        if own.emf_peak_v > LARGE_V and np.ptp(own.wave.points) * own.emf_peak_v > 2 * LARGE_V:
            generator.settings = change(own)
        trigger()
        generator.settings = own

    generator.trigger = changed


def clipped(own: Any) -> Any:
    return replace(own, wave=replace(own.wave, points=np.clip(own.wave.points, -1.0, 0.6 / own.emf_peak_v)))


CASES = {
    "clipped": (clipped, ("clipped", "limits", "load"), "delay"),
    "not started": (lambda own: replace(own, advances_by_trigger=True), ("start", "trigger", "delay"), "limits"),
    "late": (lambda own: replace(own, delay_s=60.0), ("start", "trigger", "delay"), "limits"),
}


@pytest.mark.breaks_the_drive  # a clipped drive that is turned down moves as it was clipped
@pytest.mark.parametrize("model", ["33511B", "SDG1032X"])
@pytest.mark.parametrize("case", CASES)
def test_a_large_drive_that_differs_names_its_cause_and_ends_at_rest(case: str, model: str, tmp_path: Path) -> None:
    change, named, other = CASES[case]
    with laboratory(simulated(generator={"model": model})) as lab:
        plant(lab, change)
        ran = run(SineDwell(frequencies_hz=(75,), peak_to_peak_v=2.0), tmp_path, lab, safe=False)
        report = lab.control.report()  # type: ignore[union-attr]
    assert ran.status is RunStatus.FAILED
    assert_names(ran.reason, *named)
    assert other not in ran.reason
    assert 0 <= report.lowest_v <= report.highest_v <= 5
    assert report.ends_at_rest


def test_a_drive_as_commanded_is_measured(tmp_path: Path) -> None:
    with laboratory(simulated()) as lab:
        plant(lab, lambda own: own)
        assert run(SineDwell(frequencies_hz=(75,), peak_to_peak_v=2.0), tmp_path, lab).status is RunStatus.COMPLETED
