"""Voltage steps in the fit: measured and imported ones have the same history of levels, hysteresis and creep."""

from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.identification.specimen_identification import identify
from benchmarks.campaigns import staircase
from model import AmplifierMap, Tactor
from model.identification import FitOptions, VoltageStepsObservation
from model.response import voltage_gain
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from tests.helpers.importing import brought
from tests.helpers.simulated_bench import laboratory, run, simulated

FREE = FitOptions(free=("mu", "creep", "hysteresis"))


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Levels rising and falling twice, of a specimen with hysteresis and creep."""
    truth = simulated(beyond={"hysteresis_width": 0.03, "creep_per_decade": 0.02})
    protocol = VoltageSteps(levels_v=(0.5, 1.5, 3.5, 5.0), repeats=2, hold_s=2.0, rest_s=1.0)
    with laboratory(truth) as lab:
        return run(protocol, tmp_path_factory.mktemp("measured"), lab).path


@pytest.mark.deep
def test_exported_and_imported_steps_fit_to_the_parameters_of_the_measured_ones(measured: Path, tmp_path: Path) -> None:
    assert main(["export", str(measured), "--format", "csv", "--out", str(tmp_path)]) == 0
    (table,) = tmp_path.glob("*_points.csv")
    with Run(measured) as file:
        sensor = f"{file.record.sensor.name} {file.record.sensor.serial}".strip()
        gain = file.record.sensor.gain_relative_uncertainty
        parameters, specimen = file.record.parameters, file.record.specimen
    imported = brought(table, "--sensor", sensor, "--gain-error", str(gain))
    with Run(imported) as file:
        assert (file.record.specimen, file.record.parameters, bool(file.record.imported)) == (
            specimen,
            parameters,
            True,
        )
    one, other = (identify([path], options=FREE, sheet="none") for path in (measured, imported))
    assert [e.name for e in one.identified] == ["mu", "creep", "hysteresis"]
    for a, b in zip(one.estimates, other.estimates, strict=True):
        assert b.value == pytest.approx(a.value, rel=1e-9, abs=1e-15)
        assert b.standard_error == pytest.approx(a.standard_error, rel=1e-6, abs=1e-15)
    (steps,) = other.observations.of_type(VoltageStepsObservation)
    assert steps.history is not None


def test_a_laboratory_s_staircase_has_the_loop_of_its_turning_points(tmp_path: Path) -> None:
    """A table of levels one after the other, up and down, made by plays of all widths: no history is in it."""
    levels = np.concatenate((np.arange(0.5, 5.01, 0.5), np.arange(4.5, 0.4, -0.5)))
    acting = staircase(AmplifierMap().specimen_v(levels), 0.05, 0.0, 1.0)
    direction = np.where(np.arange(levels.size) < 10, 1, -1)
    moved = 1e6 * voltage_gain(Tactor()) * acting
    table = np.column_stack((levels, moved, np.full(levels.size, 0.1), direction))
    head = "level [V],deflection [um],deflection_errors [um],direction"
    np.savetxt(tmp_path / "stairs.csv", table, "%.9g", delimiter=",", header=head, comments="")
    fit = identify([brought(tmp_path / "stairs.csv")], options=FitOptions(free=("mu", "hysteresis")), sheet="none")
    found = {e.name: e.value for e in fit.estimates}
    assert found["hysteresis"] == pytest.approx(0.05, abs=1e-3)
    assert found["mu"] == pytest.approx(Tactor().mu, rel=1e-3)
