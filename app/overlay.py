"""The model's curve under the measured points, with its band: computed beside the window, never in its thread, and kept."""

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from app.believed import PAPER, Believed, believed
from model.amplifier import AmplifierMap
from protocols.protocol import Protocol

Array = NDArray[np.float64]

LOWEST_HZ = 5.0
"""Below this the response is quasi-static, and the curve needs ever more harmonics."""

KEPT = 64
FREQUENCIES = 400
COVERAGE = 0.95


@dataclass(frozen=True, slots=True)
class Question:
    """Which curve is wanted: up to what frequency, for which peak amplitude at the amplifier's input, and of what.

    The specimen's active calibration is looked for in `folder`; without one the curve is that of the paper's values.
    """

    top_hz: float
    amplitude_v: float
    folder: Path | None = None
    specimen: str = ""


@dataclass(frozen=True, slots=True)
class Band:
    """Where the curve lies with a probability of `COVERAGE`, given the errors of the calibration; all (F,), m."""

    peak_to_peak: tuple[Array, Array]
    fundamental: tuple[Array, Array]


def question_of(protocol: Protocol, folder: Path | None = None, specimen: str = "") -> Question:
    """The curve that belongs to a protocol's points on a specimen."""
    frequencies = getattr(protocol, "frequencies_hz", (getattr(protocol, "stop_hz", 250.0),))
    top_hz = 25.0 * math.ceil(1.04 * max(frequencies) / 25.0)
    return Question(top_hz, getattr(protocol, "peak_to_peak_v", 5.0) / 2, folder, specimen)


@dataclass(frozen=True, slots=True)
class Curve:
    """The model over frequency, (F,), SI: `peak_to_peak` is max - min, `fundamental` a peak amplitude, `phase` its own."""

    question: Question
    frequency_hz: Array
    peak_to_peak: Array
    fundamental: Array
    phase: Array
    believed: Believed = PAPER
    """Whose curve it is."""
    band: Band | None = None
    """None where nothing is known of the errors: the paper's values have none."""


class Overlay:
    """Answers questions for specimens on one amplifier, in a thread of its own; the newest question wins."""

    def __init__(self, amplifier: AmplifierMap | None = None) -> None:
        self._amplifier = amplifier or AmplifierMap()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="overlay")
        self._known: dict[tuple[object, ...], Curve] = {}
        self._believed = PAPER
        self._wanted: Question | None = None
        self._future: Future[Curve] | None = None
        self._curve: Curve | None = None

    @property
    def amplifier(self) -> AmplifierMap:
        """Through which the tactor is driven."""
        return self._amplifier

    def ask(self, question: Question) -> None:
        """Want a curve; returns at once. `ready` gives it when it is there."""
        if question == self._wanted:
            return
        self._wanted, self._curve = question, None
        if self._future is not None:
            self._future.cancel()
        self._future = self._pool.submit(self.curve, question)

    def look_again(self) -> None:
        """See whether the specimen has another calibration by now; returns at once."""
        if self._future is None and self._wanted is not None and self._wanted.folder is not None:
            self._future = self._pool.submit(self.curve, self._wanted)

    def ready(self) -> Curve | None:
        """The curve last asked for, None while it is being computed.

        Raises:
            ParameterError: the model cannot answer this question.
        """
        if self._future is not None and self._future.done():
            future, self._future = self._future, None
            self._curve = future.result()
        return self._curve

    def curve(self, question: Question) -> Curve:
        """Compute a curve here and now; one that was computed before is given again."""
        self._believed = of = believed(question.folder, question.specimen, self._believed)
        name = (question.top_hz, question.amplitude_v, of.stamp, of.words, of.trouble)
        if name not in self._known:
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[name] = self._computed(question, of)
        return self._known[name]

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _computed(self, question: Question, of: Believed) -> Curve:
        from model.response import amplifier_response  # scipy.linalg takes a quarter of a second, and nobody waits here

        frequency = np.linspace(LOWEST_HZ, max(question.top_hz, 2 * LOWEST_HZ), FREQUENCIES)
        driven = amplifier_response(of.tactor, frequency, question.amplitude_v, self._amplifier.rest_v, self._amplifier)
        peak_to_peak, fundamental = driven.peak_to_peak, np.abs(driven.fundamental)
        band = None
        if of.estimates is not None:
            reach = self._reach(question, of, frequency)
            band = Band(*((y - r, y + r) for y, r in zip((peak_to_peak, fundamental), reach, strict=True)))
        return Curve(question, frequency, peak_to_peak, fundamental, np.angle(driven.fundamental), of, band)

    def _reach(self, question: Question, of: Believed, frequency: Array) -> tuple[Array, Array]:
        """Half the band of either series; its derivatives are those of the quick curve, 0.01 % from the thorough one."""
        from dataclasses import replace

        from model.curve import curve
        from model.specimen import Specimen
        from model.uncertainty import linear_band

        assert of.estimates is not None

        def both(tactor_values: tuple[float, ...]) -> Array:
            tactor = replace(of.tactor, **dict(zip(names, tactor_values, strict=True)))
            got = curve(Specimen(tactor), frequency, question.amplitude_v, self._amplifier)
            return np.concatenate((got.peak_to_peak, np.abs(got.fundamental)))

        names = of.estimates.names
        band = linear_band(
            lambda values: np.array([both(row) for row in zip(*values.values(), strict=True)]), of.estimates, COVERAGE
        )
        reach = band.upper - band.centre
        return reach[: frequency.size], reach[frequency.size :]
