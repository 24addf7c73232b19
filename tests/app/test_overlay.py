"""Model curve behind the points: computed by the model, in the background, once."""

import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.identification.active_model import PAPER_MODEL
from app.identification.calibrations import Calibrations, calibrations_path, write_calibrations
from app.live.model_overlay import CurveRequest, ModelCurves, Overlay, ResponseCurves, curve_request_for
from model.arrays import Array, Complex
from model.membrane import skin
from model.parameter_spec import ParameterError
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response
from model.series import Role
from protocols.measurements.membrane_series import MembraneSeries
from tests.helpers.calibrations import calibration


@pytest.fixture
def overlay() -> Iterator[Overlay]:
    made = Overlay()
    yield made
    made.close()


def lines(curves: ResponseCurves) -> tuple[Array, Array, Complex]:
    """Frequency, max - min and fundamental."""
    assert all(curve.role is Role.MODEL for curve in curves.values())
    assert (curves["fundamental"].x == curves["peak_to_peak"].x).all()
    return curves["peak_to_peak"].x, curves["peak_to_peak"].y, curves["fundamental"].y


def has_band(curves: ResponseCurves) -> bool:
    there = {curve.band is not None for curve in curves.values()}
    assert len(there) == 1
    return there.pop()


def wait_for(overlay: Overlay) -> ModelCurves:
    deadline = time.monotonic() + 60
    while (curve := overlay.result()) is None:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    return curve


@pytest.mark.parametrize(
    ("frequency_hz", "peak_to_peak_um", "twice_fundamental_um"),
    [(75, 702.7, 594.2), (100, 760.1, 724.0), (150, 1154.2, 1154.0), (250, 291.8, 291.6)],
)
def test_the_curve_holds_the_reference_numbers(
    overlay: Overlay, frequency_hz: float, peak_to_peak_um: float, twice_fundamental_um: float
) -> None:
    f, peak_to_peak, motion = lines(overlay.compute(CurveRequest(275.0, 2.5)).free)
    drawn = np.interp(frequency_hz, f, peak_to_peak)
    fundamental = np.interp(frequency_hz, f, abs(motion))
    assert 1e6 * drawn == pytest.approx(peak_to_peak_um, rel=2e-3)
    assert 2e6 * fundamental == pytest.approx(twice_fundamental_um, rel=2e-3)


def test_asking_returns_at_once_and_the_answer_comes(overlay: Overlay) -> None:
    assert overlay.result() is None
    overlay.submit(CurveRequest(275.0, 2.5))
    assert wait_for(overlay).request == CurveRequest(275.0, 2.5)


def test_the_newest_question_wins(overlay: Overlay) -> None:
    for amplitude in (0.5, 1.0, 1.5, 2.0):
        overlay.submit(CurveRequest(275.0, amplitude))
    assert wait_for(overlay).request.amplitude_v == 2.0


def test_a_known_curve_is_not_computed_again(overlay: Overlay) -> None:
    overlay.submit(CurveRequest(275.0, 2.5))
    first = wait_for(overlay)
    overlay.submit(CurveRequest(275.0, 1.0))
    wait_for(overlay)
    overlay.submit(CurveRequest(275.0, 2.5))
    assert wait_for(overlay) is first


def test_a_request_outside_the_models_range_has_no_curve(overlay: Overlay) -> None:
    outside = CurveRequest(275.0, 99.0)
    with pytest.raises(ParameterError, match="amplifier"):
        overlay.compute(outside)
    overlay.submit(CurveRequest(275.0, 2.5))
    wait_for(overlay)
    overlay.submit(outside)
    deadline = time.monotonic() + 60
    while overlay._result[0] is not outside:
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert overlay.result() is None


def test_curve_uses_active_calibration_and_band_is_one_standard_error(overlay: Overlay, tmp_path: Path) -> None:
    error = 2e-5
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, {"k2": (8e-3, error)}),), 1))
    curve = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7"))
    assert curve.active_model.description == "calibration 1 of T7, SIMULATED"
    f, peak_to_peak, motion = lines(curve.free)
    truth = amplifier_response(Tactor(k2=8e-3), f).peak_to_peak
    np.testing.assert_allclose(peak_to_peak, truth, rtol=5e-5)
    moved = amplifier_response(Tactor(k2=8e-3 + 1.96 * error), f).peak_to_peak
    assert curve.free["peak_to_peak"].band is not None
    low, high = curve.free["peak_to_peak"].band
    np.testing.assert_allclose(high - peak_to_peak, abs(moved - truth), rtol=0.1, atol=2e-6)
    np.testing.assert_allclose(low + high, 2 * peak_to_peak)
    assert curve.free["fundamental"].band is not None
    np.testing.assert_allclose(sum(curve.free["fundamental"].band), 2 * abs(motion))


def test_on_the_membrane_the_curve_is_that_of_the_skin_at_each_elongation(overlay: Overlay) -> None:
    question = curve_request_for(MembraneSeries(elongations_m=(2.54e-3, 0.0, 1.27e-3, 2.54e-3)))
    found = overlay.compute(question)
    assert list(found.on_membrane) == [0.0, 1.27e-3, 2.54e-3]
    assert [curves["peak_to_peak"].label for curves in found.on_membrane.values()] == ["0 mm", "1.27 mm", "2.54 mm"]
    for elongation_m, curves in found.on_membrane.items():
        pressed = skin(Membrane(), elongation_m / Membrane().L_m)
        f, peak_to_peak, motion = lines(curves)
        truth = amplifier_response(Tactor(), f, skin=pressed)
        np.testing.assert_allclose(peak_to_peak, truth.peak_to_peak, rtol=5e-5)
        np.testing.assert_allclose(abs(motion), abs(truth.fundamental), rtol=1e-9)
        assert found.at_elongation(elongation_m) is curves
    assert found.at_elongation(float("nan")) is found.free
    assert found.at_elongation(3.81e-3) is None
    alone = overlay.compute(replace(question, elongations_m=()))
    np.testing.assert_array_equal(found.free["peak_to_peak"].y, alone.free["peak_to_peak"].y)


@pytest.mark.deep
def test_skin_calibration_moves_membrane_curves_and_adds_bands(overlay: Overlay, tmp_path: Path) -> None:
    found = {"c_s_0": (200.0, 10.0), "E_m": (6e6, 1e5), "c_s(1.27 mm)": (700.0, 5.0)}
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, found),), 1))
    curves = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7", (0.0, 1.27e-3)))
    assert not has_band(curves.free), "nothing of the tactor itself was identified"
    (f, unstretched, _), (_, stretched, _) = (lines(each) for each in curves.on_membrane.values())
    rubber = Membrane(c_s_0=200.0, E_m=6e6)
    at_rest, pulled = (skin(rubber, e / rubber.L_m) for e in (0.0, 1.27e-3))
    np.testing.assert_allclose(unstretched, amplifier_response(Tactor(), f, skin=at_rest).peak_to_peak, 5e-5)
    alone = replace(pulled, c_s=700.0)
    np.testing.assert_allclose(stretched, amplifier_response(Tactor(), f, skin=alone).peak_to_peak, 5e-5)
    more = amplifier_response(Tactor(), f, skin=replace(at_rest, c_s=200.0 + 1.96 * 10.0)).peak_to_peak
    stiffer = skin(replace(rubber, E_m=6e6 + 1.96e5), 0.0)
    softer = amplifier_response(Tactor(), f, skin=stiffer).peak_to_peak
    both = np.hypot(more - unstretched, softer - unstretched)
    band = curves.on_membrane[0.0]["peak_to_peak"].band
    assert band is not None
    np.testing.assert_allclose(band.upper - unstretched, both, rtol=0.1, atol=1e-6)


def test_an_elongation_that_the_model_refuses_has_no_curve_and_the_others_have(
    overlay: Overlay, tmp_path: Path
) -> None:
    found = {"c_s_0": (10.0, 1.0), "c_s_delta": (-5e4, 1.0)}
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, found),), 1))
    curve = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7", (0.0, 6.35e-3)))
    assert list(curve.on_membrane) == [0.0]


def test_the_papers_values_have_no_band_and_say_so(overlay: Overlay, tmp_path: Path) -> None:
    curve = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7"))
    assert not has_band(curve.free)
    assert curve.active_model.description == PAPER_MODEL.description
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, {"k2": (8e-3, 1e-5)}),), 0))
    curve = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7"))
    assert (has_band(curve.free), curve.active_model.tactor) == (False, Tactor())
    assert "no calibration of T7 is active" in curve.active_model.description


def test_another_calibration_is_seen_when_it_is_looked_for(overlay: Overlay, tmp_path: Path) -> None:
    overlay.submit(CurveRequest(275.0, 2.5, tmp_path, "T7"))
    assert not has_band(wait_for(overlay).free)
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, {"c0": (100.0, 5.0)}),), 1))
    overlay.refresh()
    deadline = time.monotonic() + 60
    while (curve := overlay.result()) is None or not has_band(curve.free):
        assert time.monotonic() < deadline
        time.sleep(0.001)
    assert curve.active_model.tactor == replace(Tactor(), c0=100.0)


def test_unreadable_calibration_is_reported_and_paper_values_used(overlay: Overlay, tmp_path: Path) -> None:
    path = calibrations_path(tmp_path, "T7")
    path.write_text("{")
    curve = overlay.compute(CurveRequest(275.0, 2.5, tmp_path, "T7"))
    assert str(path) in curve.active_model.problem
    assert (has_band(curve.free), curve.active_model.description) == (False, PAPER_MODEL.description)
