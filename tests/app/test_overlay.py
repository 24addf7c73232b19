"""The curve under the points is the model's, comes without waiting, and is computed once."""

import time
from collections.abc import Iterator

import numpy as np
import pytest

from app.overlay import Curve, Overlay, Question
from model.quantity import ParameterError


@pytest.fixture
def overlay() -> Iterator[Overlay]:
    made = Overlay()
    yield made
    made.close()


def wait_for(overlay: Overlay) -> Curve:
    deadline = time.monotonic() + 10
    while (curve := overlay.ready()) is None:
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
    curve = overlay.curve(Question(275.0, 2.5))
    drawn = np.interp(frequency_hz, curve.frequency_hz, curve.peak_to_peak)
    fundamental = np.interp(frequency_hz, curve.frequency_hz, curve.fundamental)
    assert 1e6 * drawn == pytest.approx(peak_to_peak_um, rel=2e-3)
    assert 2e6 * fundamental == pytest.approx(twice_fundamental_um, rel=2e-3)


def test_asking_returns_at_once_and_the_answer_comes(overlay: Overlay) -> None:
    assert overlay.ready() is None
    overlay.ask(Question(275.0, 2.5))
    assert wait_for(overlay).question == Question(275.0, 2.5)


def test_the_newest_question_wins(overlay: Overlay) -> None:
    for amplitude in (0.5, 1.0, 1.5, 2.0):
        overlay.ask(Question(275.0, amplitude))
    assert wait_for(overlay).question.amplitude_v == 2.0


def test_a_known_curve_is_not_computed_again(overlay: Overlay) -> None:
    overlay.ask(Question(275.0, 2.5))
    first = wait_for(overlay)
    overlay.ask(Question(275.0, 1.0))
    wait_for(overlay)
    overlay.ask(Question(275.0, 2.5))
    assert overlay.ready() is first


def test_a_question_the_model_refuses_is_told_once(overlay: Overlay) -> None:
    overlay.ask(Question(275.0, 99.0))
    with pytest.raises(ParameterError, match="amplifier"):
        wait_for(overlay)
    assert overlay.ready() is None
