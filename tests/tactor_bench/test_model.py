"""Model and identification: same numbers as the command line, same band as the window."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import tactor_bench as tb
from app.cli.main import main
from app.identification.calibrations import CalibrationError, Calibrations, write_calibrations
from app.live.model_overlay import CurveRequest, Overlay
from protocols.measurements.sine_dwell import SineDwell
from tests.helpers.calibrations import calibration
from tests.helpers.simulated_bench import laboratory, run


def told(capsys: pytest.CaptureFixture[str], *arguments: str) -> Any:
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


@pytest.mark.parametrize(
    ("options", "given"),
    [
        ([], {}),
        (["--set", "m_add=5 g", "--set", "c0=120"], {"tactor": tb.Tactor(m_add=5e-3, c0=120.0)}),
        (["--elongation", "1.27 mm"], {"elongation_m": 1.27e-3}),
        (["--pre-stretch", "0.0075"], {"pre_stretch": 0.0075}),
        (["--pre-stretch", "0.01", "--set", "E_m=5e6"], {"pre_stretch": 0.01, "membrane": tb.Membrane(E_m=5e6)}),
        (["--set", "k_s=5e4", "--set", "c_s=300"], {"skin": tb.Skin(5e4, 300.0)}),
        (
            ["--peak-to-peak", "3 V", "--offset", "2 V", "--waveform", "square"],
            {"peak_to_peak_v": 3.0, "offset_v": 2.0, "waveform": "square"},
        ),
        (["-n", "12", "--at", "18 mm"], {"shapes": 12, "position_m": 18e-3}),
    ],
)
def test_the_response_is_that_of_the_command_line(
    options: list[str], given: dict[str, Any], capsys: pytest.CaptureFixture[str]
) -> None:
    answer = told(capsys, "model", "frequency-response", "--frequencies", "25,100,160,250", *options)
    columns = answer["response"]
    model = tb.response([25, 100, 160, 250], **given)
    for name, values in (
        ("frequency", model.frequency_hz),
        ("peak_to_peak", model.peak_to_peak),
        ("twice_fundamental", 2 * np.abs(model.fundamental)),
        ("phase", np.angle(model.fundamental)),
        ("receptance_re", model.receptance.real),
        ("receptance_im", model.receptance.imag),
    ):
        np.testing.assert_allclose(values, columns[name], rtol=1e-12)
    assert model.peak_to_peak_band is None


def test_what_is_not_physical_or_given_twice_is_a_sentence() -> None:
    with pytest.raises(tb.ParameterError, match=r"m_add .* is -1 kg: it must be at least 0 kg"):
        tb.Tactor(m_add=-1)
    with pytest.raises(tb.ParameterError, match=r"frequency .* is 0 Hz"):
        tb.response([0.0])
    with pytest.raises(tb.ParameterError, match=r"0.0 V|-0.5|range"):
        tb.response([100.0], peak_to_peak_v=6.0)
    accepted = calibration(1, {"c0": (150.0, 3.0)})
    for given in (
        {"tactor": tb.Tactor(), "calibration": accepted},
        {"skin": tb.Skin(), "pre_stretch": 0.1},
        {"elongation_m": 1e-3, "pre_stretch": 0.1},
        {"skin": tb.Skin(), "membrane": tb.Membrane()},
    ):
        with pytest.raises(ValueError, match=r"is given twice, .*leave|is given twice; leave"):
            tb.response([100.0], **given)


KNOWN = {"c0": (150.0, 3.0), "mu": (-1.4e-5, 4e-8), "E_m": (6e6, 2e5), "c_s(1.27 mm)": (500.0, 20.0)}


@pytest.mark.one_in(2)
@pytest.mark.parametrize("elongation_m", [None, 1.27e-3])
def test_the_band_of_a_calibration_is_the_one_that_the_window_draws(elongation_m: float | None, tmp_path: Path) -> None:
    accepted = calibration(1, KNOWN)
    write_calibrations(tmp_path, "T7", Calibrations((accepted,), 1))
    overlay = Overlay()
    try:
        drawn = overlay.compute(CurveRequest(275.0, 2.0, tmp_path, "T7", (1.27e-3,))).at_elongation(elongation_m)
    finally:
        overlay.close()
    assert drawn is not None
    model = tb.response(
        drawn["peak_to_peak"].x,
        calibration=tb.calibration("T7", tmp_path),
        elongation_m=elongation_m,
        peak_to_peak_v=4.0,
    )
    assert model.peak_to_peak_band is not None
    assert model.fundamental_band is not None
    np.testing.assert_allclose(model.peak_to_peak, drawn["peak_to_peak"].y, rtol=1e-4)
    for band, curve in (
        (model.peak_to_peak_band, drawn["peak_to_peak"]),
        (model.fundamental_band, drawn["fundamental"]),
    ):
        assert curve.band is not None
        lower, upper = curve.band
        width = (upper - lower).max()
        np.testing.assert_allclose(band.lower, lower, atol=0.02 * width)
        np.testing.assert_allclose(band.upper, upper, atol=0.02 * width)
        assert (band.lower <= band.centre).all()
    half = tb.response(
        drawn["peak_to_peak"].x, calibration=accepted, elongation_m=elongation_m, coverage=0.5, peak_to_peak_v=4.0
    )
    assert half.peak_to_peak_band is not None
    ratio = (half.peak_to_peak_band.upper - half.peak_to_peak).max() / (
        model.peak_to_peak_band.upper - model.peak_to_peak
    ).max()
    assert ratio == pytest.approx(0.6745 / 1.96, rel=1e-3)


@pytest.fixture(scope="module")
def dwell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with laboratory() as lab:
        return run(SineDwell(frequencies_hz=(100, 130, 145, 160, 175, 200)), tmp_path_factory.mktemp("runs"), lab).path


@pytest.mark.deep
def test_identification_and_calibration_are_those_of_the_command_line(
    dwell: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    found = tb.identify(tb.runs(dwell.parent, specimen="T1"))
    answer = told(capsys, "identify", str(dwell), "--accept", "--by", "K. Tanaka")
    tables = ("parameters", "known", "nonidealities")
    listed = {
        name: [each for table in tables for each in answer[table][name]] for name in ("name", "value", "standard_error")
    }
    assert list(found.names) == answer["covariance_names"]
    assert sorted(found.names) == sorted(listed["name"])
    estimates = [found.estimates[name] for name in listed["name"]]
    np.testing.assert_allclose([e.value for e in estimates], listed["value"], rtol=1e-9)
    np.testing.assert_allclose([e.standard_error for e in estimates], listed["standard_error"], rtol=1e-6)
    np.testing.assert_allclose(found.covariance, answer["covariance"], rtol=1e-6)
    assert found.verdict == answer["verdict"]
    assert found.adequacy is not None
    assert (found.adequacy.adequate, found.adequacy.message) == (answer["adequate"], answer["adequacy"])
    assert found.tactor.mu == found.estimates["mu"].value
    assert "mu: -13." in repr(found)
    accepted = tb.calibration("T1", dwell.parent)
    assert (accepted.accepted_by, accepted.tactor()) == ("K. Tanaka", found.tactor)
    np.testing.assert_allclose(accepted.covariance, found.covariance, rtol=1e-6)
    with pytest.raises(CalibrationError, match="there is no version 7 of its calibration; versions: 1"):
        tb.calibration("T1", dwell.parent, version=7)
    points = tb.open_run(dwell).points
    model = tb.response(points["frequency"], calibration=found)
    assert model.peak_to_peak_band is not None
    spread = np.hypot(points.errors("peak_to_peak"), model.peak_to_peak_band.standard_error)
    assert (np.abs(points["peak_to_peak"] - model.peak_to_peak) < 4 * spread).all()


@pytest.mark.deep
def test_the_chain_and_what_goes_with_it(dwell: Path) -> None:
    found = tb.identify([str(dwell)], method="chain")
    assert found.adequacy is None
    assert set(found.names) == {"m_add", "c0"}
    assert tb.identify(tb.open_run(dwell), free=["mu"], fixed={"c0": 150.0}).fixed["c0"] == 150.0
    with pytest.raises(ValueError, match=r"\bfree\b.*\bjoint\b.*\bchain\b"):
        tb.identify(dwell, method="chain", free=["mu"])
    with pytest.raises(ValueError, match="there are no runs to identify"):
        tb.identify([])
