"""The same measurement with every make of generator: same points, safe voltage throughout."""

from pathlib import Path

import pytest

from protocols.base import RunStatus
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.simulated_bench import laboratory, run, simulated


@pytest.mark.parametrize(
    "model",
    ["33511B", *(pytest.param(m, marks=pytest.mark.deep) for m in ("33220A", "DG1032Z", "SDG1032X", "AFG1022"))],
)
def test_a_dwell_gives_the_same_point_whoever_made_the_generator(model: str, tmp_path: Path) -> None:
    dwell = SineDwell(frequencies_hz=(60.0, 150.0), settle_limit_s=1.0, record_s=0.2)
    with laboratory(simulated(generator={"model": model})) as lab:
        ran = run(dwell, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED, ran.reason
    assert lab.bench.amplifier.identity.model == model
    assert [p.drive_amplitude for p in ran.points] == pytest.approx([2.5, 2.5], rel=1e-3)
    assert [1e6 * p.peak_to_peak for p in ran.points] == pytest.approx([588.35, 1154.18], rel=2e-3)
