"""Perception threshold against the response, and the paper's figures with the statements of their captions."""

from functools import cache

import numpy as np
import pytest

from model.membrane import skin
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response, frequency_response
from model.response.perception import ABDOMEN_THRESHOLD, SITES, PerceptionThreshold, perception_margin, usable_bands
from model.studies.figures_of_the_paper import PaperFigure, paper_figures

F = np.arange(1.0, 251.0)


def test_free_tactor_is_felt_everywhere_below_250_hz() -> None:
    w = amplifier_response(Tactor(), F).peak_to_peak
    assert usable_bands(F, w) == ((1.0, 250.0),)
    assert perception_margin(160.0, amplifier_response(Tactor(), 160.0).peak_to_peak)[0] == pytest.approx(
        1115.7 / 50, rel=1e-4
    )


def test_ends_of_the_usable_band_lie_on_the_threshold() -> None:
    taut = skin(Membrane(), 0.1)
    (band,) = usable_bands(F, 2000 * abs(frequency_response(Tactor(), F, taut)))
    assert band[0] == 1.0
    assert 2000 * abs(frequency_response(Tactor(), band[1], taut)[0]) == pytest.approx(50e-6, rel=1e-4)


def test_several_bands_and_none() -> None:
    f = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    two = usable_bands(f, 50e-6 * np.array([2, 0.5, 0.5, 2, 2]))
    assert np.array(two) == pytest.approx(np.array([[1.0, 1.5], [3.5, 5.0]]))
    assert usable_bands(f, np.full(5, 1e-6)) == ()
    assert usable_bands(f, np.zeros(5)) == ()


def test_threshold_curve_is_straight_in_log_log() -> None:
    curve = PerceptionThreshold((10.0, 1000.0), (100e-6, 1e-6))
    assert curve.amplitude_at([1.0, 10.0, 100.0, 1e4]) == pytest.approx([100e-6, 100e-6, 10e-6, 1e-6])
    assert ABDOMEN_THRESHOLD.amplitude_at([3.0, 200.0]) == pytest.approx(50e-6)


@cache
def every() -> dict[str, PaperFigure]:
    return {figure.name: figure for figure in paper_figures()}


def test_every_theory_figure_is_there_with_units() -> None:
    assert list(every()) == ["fig4", "fig5", "fig6", "fig8", *(f"fig9{p}" for p in "abcdef"), "fig10", "fig11", "fig12"]
    for figure in every().values():
        assert figure.caption.endswith(".")
        assert figure.y_unit
        for curve in figure.curves:
            assert curve.x.shape == curve.y.shape
            assert np.isfinite(curve.y).all()


def curves(name: str) -> np.ndarray:
    return np.array([c.y for c in every()[name].curves])


def test_captions_of_figures_4_to_8() -> None:
    right, printed = curves("fig4")[:, -1]
    assert printed / right == pytest.approx(7.6, abs=0.05)
    assert right < 0.77e-3 < printed
    assert np.interp(7.73e-3, every()["fig5"].curves[0].x, curves("fig5")[0]) == pytest.approx(158.15, abs=0.05)
    assert np.interp(7.73e-3, every()["fig5"].curves[1].x, curves("fig5")[1]) == pytest.approx(113.7, abs=0.1)
    w = curves("fig6")[0]
    assert w[[0, 25, 50]] == pytest.approx([-500 * 2.37886e-7, 0, 1500 * 2.37886e-7], rel=1e-5, abs=1e-12)
    assert curves("fig8")[0, [0, -1]] == pytest.approx([165, 2211.9], rel=1e-4)


def test_caption_of_figure_9() -> None:
    free, unstretched = curves("fig9a")[0], curves("fig9b")[0]
    for y, peak in ((free, 151), (unstretched, 137)):
        assert F[y.argmax()] == peak
        assert (np.diff(y[: peak - 1]) > 0).all()
    assert unstretched[0] < free[0]
    fundamental, whole = curves("fig9a")
    assert (whole >= fundamental * (1 - 1e-9)).all()


def test_caption_of_figure_10() -> None:
    y = curves("fig10")
    assert y[2, 0] / y[0, 0] == pytest.approx(1 - 0.035, abs=0.001)
    assert "338 Hz" in every()["fig10"].caption
    assert (np.diff(y[4]) > 0).all()


def test_caption_of_figure_11() -> None:
    y = curves("fig11")
    assert all(abs(F[(row / y[0]).argmin()] - 158) <= 1 for row in y[1:])


def test_caption_of_figure_12() -> None:
    y = curves("fig12")
    assert (y[4] < y[3]).all()
    assert F[np.argmax(y[4] < 50e-6)] == 150
    assert (np.diff(y[3:], axis=1) < 0).all()


def test_thresholds_of_body_sites_follow_their_sources() -> None:
    thenar, forearm = SITES["thenar"], SITES["forearm"]
    assert thenar.amplitude_at([10.0, 40.0])[0] == thenar.amplitude_at([10.0, 40.0])[1]
    assert thenar.amplitude_at(80.0) / thenar.amplitude_at(160.0) == pytest.approx(10 ** (12 / 20))
    assert thenar.amplitude_at(250.0) == pytest.approx(0.2e-6)
    assert forearm.amplitude_at(55.0) / forearm.amplitude_at(110.0) == pytest.approx(10 ** (12 / 20))
    assert forearm.amplitude_at(440.0) / forearm.amplitude_at(220.0) == pytest.approx(10 ** (9 / 20))
    assert all(site.source for site in SITES.values())
    assert "UNPROVEN: the level" in thenar.description
    assert not SITES["abdomen"].unproven
    assert perception_margin(200.0, 1e-4, forearm) > perception_margin(200.0, 1e-4)
