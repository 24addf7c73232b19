"""What the Explore page asks of the model, answered piece by piece in the order in which a person looks. No Qt."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from app.explore.state import Kept, Setting

Array = NDArray[np.float64]

FREQUENCIES = 300
LOWEST_HZ = 1.0
PHASES = 48
ALONG = 49
MOST_KEPT_IN_MIND = 200


@dataclass(frozen=True, slots=True)
class Question:
    """One state of the page."""

    setting: Setting
    kept: tuple[Kept, ...]
    top_hz: float
    at_hz: float


@dataclass(frozen=True, slots=True)
class Line:
    """One curve over frequency: amplitudes in m, phase in rad."""

    frequency_hz: Array
    peak_to_peak: Array
    twice_fundamental: Array
    phase: Array


@dataclass(frozen=True, slots=True)
class Shape:
    """The half beam in motion: `deflection` (phases, X) in m at `x` (X,) in m."""

    x: Array
    deflection: Array
    L1: float
    L2: float


@dataclass(frozen=True, slots=True)
class Picture:
    """What is known by now."""

    line: Line
    bands: tuple[tuple[float, float], ...]
    """Where max - min is above the threshold of the skin, Hz."""
    kept: tuple[Line, ...] | None = None
    shape: Shape | None = None


class Answerer:
    """Computes pictures; curves once computed are kept in mind, so that kept ones cost nothing."""

    def __init__(self) -> None:
        self._known: dict[tuple[str, float], Line] = {}

    def pictures(self, question: Question) -> Iterator[Picture]:
        """The curve first, then the kept ones, then the motion.

        Raises:
            ParameterError, LinAlgError: the model has no answer.
        """
        from model.response.perception import usable_bands

        line = self._line(question.setting, question.top_hz)
        picture = Picture(line, usable_bands(line.frequency_hz, line.peak_to_peak))
        yield picture
        picture = replace(picture, kept=tuple(self._line(kept.setting, question.top_hz) for kept in question.kept))
        yield picture
        yield replace(picture, shape=_shape(question))

    def _line(self, setting: Setting, top_hz: float) -> Line:
        from model.response.fast_response import curve

        name = (repr((sorted(setting.values.items()), setting.on_skin, setting.peak_to_peak_v)), top_hz)
        if name not in self._known:
            if len(self._known) >= MOST_KEPT_IN_MIND:
                self._known.pop(next(iter(self._known)))
            f = np.linspace(LOWEST_HZ, top_hz, FREQUENCIES)
            got = curve(setting.specimen, f, setting.peak_to_peak_v / 2)
            phase = np.unwrap(np.angle(got.fundamental))
            self._known[name] = Line(f, got.peak_to_peak, 2 * np.abs(got.fundamental), phase)
        return self._known[name]


def _shape(question: Question) -> Shape:
    from model.response.fast_response import motion

    specimen = question.setting.specimen
    t = specimen.tactor
    x = np.linspace(0, t.L, ALONG)
    w = motion(specimen, question.at_hz, x, PHASES, question.setting.peak_to_peak_v / 2)
    return Shape(x, w, t.L1, t.L2)
