"""The model's curve under the measured points, with its band: computed beside the window, never in its thread, and kept."""

import math
from collections.abc import Iterable, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from app.identification.active_model import PAPER, Believed, believed
from model.amplifier_map import AmplifierMap
from protocols.base.protocol import Protocol

if TYPE_CHECKING:
    from model.specimen import Specimen
    from model.studies.uncertainty import Estimates

Array = NDArray[np.float64]

LOWEST_HZ = 5.0
"""Below this the response is quasi-static, and the curve needs ever more harmonics."""

PARTS_HZ = (15.0, 60.0)
"""Where the frequencies are divided: a seventh of the time, and within 2e-5 of the whole."""

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
    elongations_m: tuple[float, ...] = ()
    """Of the membrane: the curves that are wanted besides the free tactor's."""


@dataclass(frozen=True, slots=True)
class Band:
    """Where the curve lies with a probability of `COVERAGE`, given the errors of the calibration; all (F,), m."""

    peak_to_peak: tuple[Array, Array]
    fundamental: tuple[Array, Array]


def question_of(protocol: Protocol, folder: Path | None = None, specimen: str = "") -> Question:
    """The curve that belongs to a protocol's points on a specimen."""
    frequencies = getattr(protocol, "frequencies_hz", (getattr(protocol, "stop_hz", 250.0),))
    top_hz = 25.0 * math.ceil(1.04 * max(frequencies) / 25.0)
    elongations = tuple(sorted(set(getattr(protocol, "elongations_m", ()))))
    return Question(top_hz, getattr(protocol, "peak_to_peak_v", 5.0) / 2, folder, specimen, elongations)


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
    elongation_m: float | None = None
    """Of the membrane under the tactor; None is the free tactor."""
    on: tuple["Curve", ...] = ()
    """The same on the membrane, at the elongations that were asked for; one that the model cannot answer is left out."""

    def at(self, elongation_m: float | None) -> "Curve | None":
        """The curve at an elongation; None or NaN is the free tactor's. None where there is none."""
        if elongation_m is None or math.isnan(elongation_m):
            return self
        return next((curve for curve in self.on if _same(curve.elongation_m, elongation_m)), None)


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
        name = (question.top_hz, question.amplitude_v, question.elongations_m, of.stamp, of.words, of.trouble)
        if name not in self._known:
            if len(self._known) >= KEPT:
                self._known.pop(next(iter(self._known)))
            self._known[name] = self._computed(question, of)
        return self._known[name]

    def close(self) -> None:
        """End the thread."""
        self._pool.shutdown(wait=True, cancel_futures=True)

    def _computed(self, question: Question, of: Believed) -> Curve:
        from model.parameter_spec import ParameterError
        from model.specimen import Specimen

        free = self._drawn(question, of, Specimen(of.tactor))
        on = []
        for elongation_m in question.elongations_m:
            alone = next((c_s for at, c_s in of.damping if _same(at, elongation_m)), None)
            try:
                pressed = Specimen(of.tactor, of.membrane, elongation_m / of.membrane.L_m, c_s=alone)
                on.append(replace(self._drawn(question, of, pressed), elongation_m=elongation_m))
            except ParameterError:  # as a damping below zero: of this elongation there is no curve
                continue
        return replace(free, on=tuple(on))

    def _drawn(self, question: Question, of: Believed, specimen: "Specimen") -> Curve:
        from model.response.frequency_response import (  # scipy.linalg takes a quarter of a second, and nobody waits here
            amplifier_response,
        )

        frequency = np.linspace(LOWEST_HZ, max(question.top_hz, 2 * LOWEST_HZ), FREQUENCIES)
        amplitude_v, amplifier = question.amplitude_v, self._amplifier
        # The harmonics that matter reach up to the same frequency: low ones need many, so they go by themselves.
        driven = [
            amplifier_response(specimen.tactor, part, amplitude_v, amplifier.rest_v, amplifier, skin=specimen.skin)
            for part in np.split(frequency, np.searchsorted(frequency, PARTS_HZ))
            if part.size
        ]
        peak_to_peak = np.concatenate([part.peak_to_peak for part in driven])
        motion = np.concatenate([part.fundamental for part in driven])
        fundamental, phase = np.abs(motion), np.angle(motion)
        estimates = of.estimates if specimen.membrane is None else of.on_membrane
        band = None
        if estimates is not None:
            reach = self._reach(question, estimates, specimen, frequency)
            band = Band(*((y - r, y + r) for y, r in zip((peak_to_peak, fundamental), reach, strict=True)))
        return Curve(question, frequency, peak_to_peak, fundamental, phase, of, band)

    def _reach(
        self, question: Question, estimates: "Estimates", specimen: "Specimen", frequency: Array
    ) -> tuple[Array, Array]:
        """Half the band of either series; its derivatives are those of the quick curve, 0.01 % from the thorough one."""
        from model.response.fast_response import curve
        from model.studies.uncertainty import linear_band

        def both(values: tuple[float, ...]) -> Array:
            given = dict(zip(estimates.names, values, strict=True))
            got = curve(_with(specimen, given), frequency, question.amplitude_v, self._amplifier)
            return np.concatenate((got.peak_to_peak, np.abs(got.fundamental)))

        band = linear_band(
            lambda values: np.array([both(row) for row in zip(*values.values(), strict=True)]), estimates, COVERAGE
        )
        reach = band.upper - band.centre
        return reach[: frequency.size], reach[frequency.size :]


def elongations_of(points: Iterable[Any]) -> tuple[float, ...]:
    """The elongations of the membrane at which points were measured, rising; none for those of the free tactor."""
    found = {float(getattr(point, "elongation", math.nan)) for point in points}
    return tuple(sorted(elongation for elongation in found if not math.isnan(elongation)))


def _same(one_m: float | None, other_m: float) -> bool:
    return one_m is not None and math.isclose(one_m, other_m, rel_tol=1e-5, abs_tol=1e-8)


def _with(specimen: "Specimen", given: Mapping[str, float]) -> "Specimen":
    """Another tactor, and another membrane where there is one."""
    tactor, membrane = specimen.tactor, specimen.membrane
    names = {field.name for field in fields(tactor)}
    tactor = replace(tactor, **{name: value for name, value in given.items() if name in names})
    if membrane is not None:
        membrane = replace(membrane, **{name: value for name, value in given.items() if name not in names})
    return replace(specimen, tactor=tactor, membrane=membrane)
