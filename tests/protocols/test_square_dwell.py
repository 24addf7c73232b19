"""Square dwell on a simulated bench: both drives at each frequency, against a solution in time."""

from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError

from drivers.drive_shapes import SquareWave
from model.amplifier_map import AmplifierMap
from model.parameters import Tactor
from model.response.harmonic_response import tactor_modal_form
from protocols.base import Quality, RunStatus
from protocols.measurements.square_dwell import SquareDwell
from protocols.predicted_travel import predict_travel
from protocols.runfile.reader import Run
from tests.helpers.sampled import march
from tests.helpers.simulated_bench import laboratory, run, simulated


def marched_m(drive: SquareWave) -> np.ndarray:
    """The last of forty periods of the displacement, stepped in time."""
    rate, periods = 200_000.0, 40
    t = np.arange(round(periods / drive.frequency_hz * rate)) / rate
    volts = AmplifierMap().specimen_v(drive.volts(t))
    return march(tactor_modal_form(Tactor()), volts, rate)[t > (periods - 1) / drive.frequency_hz]


@pytest.mark.deep
@pytest.mark.parametrize(("model", "duty"), [("33511B", 0.5), ("33220A", 0.35), ("SDG1032X", 0.5)])
def test_the_response_to_the_square_wave_is_the_one_marched_in_time(model: str, duty: float, tmp_path: Path) -> None:
    protocol = SquareDwell(frequencies_hz=(80.0, 160.0), duty=duty)
    with laboratory(simulated(generator={"model": model})) as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert ran.verdict.outcome == "good", ran.verdict.reasons
    for point in ran.points:
        (entry,) = (e for e in protocol.plan(2.5) if e.key == (round(point.frequency),))
        drive = entry.drives[1]
        assert isinstance(drive, SquareWave)
        assert point.peak_to_peak == pytest.approx(np.ptp(marched_m(drive)), rel=4e-3)
        assert point.linearity == pytest.approx(1.0, abs=5 * point.linearity_errors + 2e-3) or duty != 0.5
        assert point.duty == pytest.approx(
            np.mean(drive.volts(np.arange(10_000) / 1e4 / drive.frequency_hz) > 2.5), abs=0.02
        )
        assert Quality(point.quality) is Quality.SIMULATED
    assert [1e6 * p.sine_peak_to_peak for p in ran.points] == pytest.approx([652.3, 1003.9], rel=3e-3)
    with Run(ran.path) as file:
        kinds = [type(recording.drive).__name__ for recording in file.recordings()]
        recordings = list(file.recordings())
    assert kinds == ["Sine", "SquareWave"] * 2
    assert protocol.point((80.0,), recordings[:2], True) == ran.points[0]


def test_the_travel_that_is_foreseen_is_that_of_the_square_wave() -> None:
    (entry,) = SquareDwell(frequencies_hz=(160.0,)).plan(2.5)
    drive = entry.drives[1]
    assert isinstance(drive, SquareWave)
    (reach,) = predict_travel([(entry, drive)], Tactor(), AmplifierMap())
    moved = marched_m(drive)
    assert (reach.low_m, reach.high_m) == pytest.approx((moved.min(), moved.max()), rel=2e-3)


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        (
            {"frequencies_hz": (500.0,), "sample_rate_hz": 5000.0},
            "too low for a square wave of 500 Hz; at least 10000 Hz",
        ),
        ({"frequencies_hz": (250.0,), "edge_s": 0.01, "duty": 0.1}, "does not cross its offset at 250 Hz"),
    ],
)
def test_parameters_that_cannot_be_are_refused(settings: dict, says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        SquareDwell(**settings)
