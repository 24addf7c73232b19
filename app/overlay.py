"""The model's curve under the measured points: computed beside the window, never in its thread, and kept."""

import math
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from model.amplifier import AmplifierMap
from model.parameters import Tactor
from protocols.protocol import Protocol

Array = NDArray[np.float64]

LOWEST_HZ = 5.0
"""Below this the response is quasi-static, and the curve needs ever more harmonics."""

KEPT = 64
FREQUENCIES = 400


@dataclass(frozen=True, slots=True)
class Question:
    """Which curve is wanted: up to what frequency, and for which peak amplitude at the amplifier's input."""

    top_hz: float
    amplitude_v: float


def question_of(protocol: Protocol) -> Question:
    """The curve that belongs to a protocol's points."""
    frequencies = getattr(protocol, "frequencies_hz", (250.0,))
    top_hz = 25.0 * math.ceil(1.04 * max(frequencies) / 25.0)
    return Question(top_hz, getattr(protocol, "peak_to_peak_v", 5.0) / 2)


@dataclass(frozen=True, slots=True)
class Curve:
    """The model over frequency, (F,), SI: `peak_to_peak` is max - min, `fundamental` a peak amplitude, `phase` its own."""

    question: Question
    frequency_hz: Array
    peak_to_peak: Array
    fundamental: Array
    phase: Array


class Overlay:
    """Answers questions for one tactor on one amplifier, in a thread of its own; the newest question wins.

    Args:
        tactor: what the curve is drawn for; the paper's Table I where nothing better is known.
    """

    def __init__(self, tactor: Tactor | None = None, amplifier: AmplifierMap | None = None) -> None:
        self._tactor, self._amplifier = tactor or Tactor(), amplifier or AmplifierMap()
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="overlay")
        self._known: dict[Question, Curve] = {}
        self._wanted: Question | None = None
        self._future: Future[Curve] | None = None

    @property
    def amplifier(self) -> AmplifierMap:
        """Through which the tactor is driven."""
        return self._amplifier

    def ask(self, question: Question) -> None:
        """Want a curve; returns at once. `ready` gives it when it is there."""
        if question == self._wanted:
            return
        self._wanted = question
        if self._future is not None:
            self._future.cancel()
        self._future = None if question in self._known else self._pool.submit(self.curve, question)

    def ready(self) -> Curve | None:
        """The curve last asked for, None while it is being computed.

        Raises:
            ParameterError: the model cannot answer this question.
        """
        if self._future is not None and self._future.done():
            future, self._future = self._future, None
            curve = future.result()
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[curve.question] = curve
        return self._known.get(self._wanted) if self._wanted is not None else None

    def curve(self, question: Question) -> Curve:
        """Compute a curve here and now."""
        from model.response import amplifier_response  # scipy.linalg takes a quarter of a second, and nobody waits here

        frequency = np.linspace(LOWEST_HZ, max(question.top_hz, 2 * LOWEST_HZ), FREQUENCIES)
        driven = amplifier_response(
            self._tactor, frequency, question.amplitude_v, self._amplifier.rest_v, self._amplifier
        )
        return Curve(question, frequency, driven.peak_to_peak, np.abs(driven.fundamental), np.angle(driven.fundamental))

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)
