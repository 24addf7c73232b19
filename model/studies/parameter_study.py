"""Parameter studies: any variables over any values, one or several together, in chunks of bounded memory.

A study is a description; `chunks` computes it chunk by chunk, in process or on any `concurrent.futures.Executor` (a Dask
client's `get_executor()` is one). Figs. 10, 11 and 12 of the paper are presets.
"""

import csv
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Executor, Future
from dataclasses import dataclass, field
from itertools import islice
from math import prod
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from model import AmplifierMap, Membrane, ParameterError, Specimen, Tactor, response, specimen_record, variable_specs
from model.beam import check_shape_count, gram, hermite_gram, matrices, modal_form, receptance

Measure = Literal["fundamental", "peak_to_peak", "receptance"]
MEASURE_UNITS: Mapping[Measure, str] = {"fundamental": "m", "peak_to_peak": "m", "receptance": "m/V"}


@dataclass(frozen=True, slots=True)
class Axis:
    """One named axis of a result."""

    name: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class StudyResult:
    """Values over named, unit-bearing axes; the last axis is frequency."""

    measure: Measure
    unit: str
    axes: tuple[Axis, ...]
    values: NDArray[Any]

    def to_csv(self, path: str | Path) -> None:
        """One row per point: the axes, then the value (real and imaginary part if it is complex), units in the header."""
        parts = ("re", "im") if np.iscomplexobj(self.values) else ("",)
        header = [f"{a.name} [{a.unit}]" for a in self.axes]
        header += [f"{self.measure}{'_' if p else ''}{p} [{self.unit}]" for p in parts]
        with Path(path).open("w", newline="", encoding="utf-8") as file:
            rows = csv.writer(file)
            rows.writerow(header)
            for index in np.ndindex(self.values.shape):
                z = self.values[index]
                numbers = (z.real, z.imag) if len(parts) == 2 else (z,)
                rows.writerow(
                    [repr(a.values[i]) for a, i in zip(self.axes, index, strict=True)]
                    + [repr(float(v)) for v in numbers]
                )


CACHED_MB = 8.0
"""Size of the intermediate arrays of one computation; larger arrays exceed the processor's cache and take 1.3 times as long."""


@dataclass(frozen=True, slots=True)
class Study:
    """Response of `specimen` at `frequency_hz` for every combination of the values of `vary`.

    `measure` is the fundamental (twice its peak amplitude, m), the paper's max - min (m), or the complex receptance (m per
    volt on the specimen); the first two under a sine at the amplifier's input.

    Raises:
        ParameterError: an unknown variable, a value that is not physical, no values, n not in 3..300, a frequency < 0, a drive
            outside the amplifier's range.
    """

    vary: Mapping[str, tuple[float, ...]]
    frequency_hz: tuple[float, ...]
    specimen: Specimen = field(default_factory=Specimen)
    measure: Measure = "fundamental"
    amplitude_v: float = 2.5
    offset_v: float = 2.5
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    n: int = 7
    """Number of the paper's shape functions, or of the unknowns of Hermite elements."""
    hermite: bool = False
    """Whether the beam is made of Hermite elements instead of the paper's shape functions."""
    memory_mb: float = 64.0

    def __post_init__(self) -> None:
        f = response.check_frequency(self.frequency_hz)
        check_shape_count(self.n)
        response.fourier_series("sine", self.amplitude_v, self.offset_v, self.amplifier, 1)
        if self.measure == "peak_to_peak" and (f == 0).any():
            raise ParameterError("frequency is 0 Hz: a periodic drive needs a frequency greater than 0; leave 0 out")
        for name, values in self.vary.items():
            self.specimen.coefficients({name: values})
            if not len(values):
                raise ParameterError(f"{name} has no values: give the study at least one")
        if not self.memory_mb > 0:
            raise ParameterError(f"memory_mb is {self.memory_mb}: it must be greater than 0 MB")

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each variable."""
        return tuple(len(v) for v in self.vary.values())

    @property
    def axes(self) -> tuple[Axis, ...]:
        """The variables, then frequency."""
        specs = variable_specs()
        named = (Axis(name, specs[name].unit, tuple(values)) for name, values in self.vary.items())
        return (*named, Axis("frequency", "Hz", self.frequency_hz))

    @property
    def title(self) -> str:
        """Definition of a study."""
        quantity = {"fundamental": "2 x fundamental", "peak_to_peak": "max - min", "receptance": "receptance"}[
            self.measure
        ]
        return f"{quantity} of the centre over {', '.join(axis.name for axis in self.axes)}"

    @property
    def fixed(self) -> dict[str, float]:
        """Fixed parameters by name, SI, without parameters that a variable determines."""
        specimen, follows = self.specimen, set()
        if specimen.membrane is not None:
            follows = {name for name in ("k_s", "c_s") if getattr(specimen, name) is None}
        if specimen.contact_length is None and {"L", "L2"} & self.vary.keys():
            follows.add("contact_length")
        return {n: v for n, v in specimen_record(specimen).items() if n not in follows and n not in self.vary}

    @property
    def chunk_size(self) -> int:
        """Number of parameter sets per computation whose intermediate arrays stay below `memory_mb`."""
        points = len(self.frequency_hz)
        samples = 0
        if self.measure == "peak_to_peak":
            orders = response.harmonic_orders(np.asarray(self.frequency_hz))
            samples, points = points * response.samples_per_period(orders + 1), points * (orders + 1)
        per_set = 8 * (3 * self.n + 8) * points + 32 * samples + 200 * self.n**2
        return max(1, int(self.memory_mb * 1e6 / per_set))

    def chunks(self, executor: Executor | None = None, in_flight: int = 8) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield (index of the first set, values (sets, F)) in order, each computed on demand.

        With an executor at most `in_flight` chunks are submitted in advance; closing the iterator cancels them.
        """
        total = prod(self.shape)
        starts = iter(range(0, total, self.chunk_size))
        if executor is None:
            for start in starts:
                yield start, _compute_chunk(self, start, min(start + self.chunk_size, total))
            return
        waiting: deque[tuple[int, Future[NDArray[Any]]]] = deque()
        try:
            while True:
                for first in islice(starts, in_flight - len(waiting)):
                    waiting.append(
                        (first, executor.submit(_compute_chunk, self, first, min(first + self.chunk_size, total)))
                    )
                if not waiting:
                    return
                start, future = waiting.popleft()
                yield start, future.result()
        finally:
            for _, future in waiting:
                future.cancel()

    def run(self, executor: Executor | None = None) -> StudyResult:
        """All blocks as one array over `axes`."""
        values = np.empty(
            (prod(self.shape), len(self.frequency_hz)), complex if self.measure == "receptance" else float
        )
        for start, block in self.chunks(executor):
            values[start : start + len(block)] = block
        return StudyResult(self.measure, MEASURE_UNITS[self.measure], self.axes, values.reshape(*self.shape, -1))


def _compute_chunk(study: Study, start: int, stop: int) -> NDArray[Any]:
    """Sets start..stop of a study; a module function, so that it can be sent to another process."""
    index = np.unravel_index(np.arange(start, stop), study.shape or (1,))
    values = {name: np.asarray(v, float)[i] for (name, v), i in zip(study.vary.items(), index, strict=False)}
    at_once = max(1, int(study.chunk_size * CACHED_MB / study.memory_mb))
    parts = [
        study_responses(study, {name: v[at : at + at_once] for name, v in values.items()})
        for at in range(0, stop - start, at_once)
    ]
    return parts[0] if len(parts) == 1 else np.concatenate(parts)


def study_responses(study: Study, values: Mapping[str, ArrayLike]) -> NDArray[Any]:
    """The study's measure for sets of values, arrays of one length P, instead of its own grid; shape (P, F)."""
    f = response.check_frequency(study.frequency_hz)
    beam, k_s, c_s = study.specimen.coefficients(values)
    M, C, K, B, B_F = matrices(beam, k_s, c_s, study.n, hermite_gram if study.hermite else gram)
    sets = max((np.size(v) for v in values.values()), default=1)
    form = modal_form(M, C, K, B, 2 * B_F)
    hysteresis, creep = (values.get(name, getattr(study.specimen, name)) for name in ("hysteresis", "creep"))
    drive = study.amplitude_v, study.offset_v, study.amplifier
    lag = np.abs(response.lag_factor(hysteresis, creep, f, *drive)) if np.any(hysteresis) or np.any(creep) else 1.0
    match study.measure:
        case "receptance":
            out: NDArray[Any] = receptance(form, 2 * np.pi * f)
        case "fundamental":
            V = response.fourier_series("sine", study.amplitude_v, study.offset_v, study.amplifier, 1)
            out = 2 * abs(V[1]) * np.abs(receptance(form, 2 * np.pi * f)) * lag
        case "peak_to_peak":
            orders = response.harmonic_orders(f)
            V = response.fourier_series("sine", study.amplitude_v, study.offset_v, study.amplifier, orders)
            H = receptance(form, np.outer(2 * np.pi * f, np.arange(orders + 1)).ravel())
            out = response.peak_to_peak(H.reshape(*H.shape[:-1], f.size, orders + 1) * V) * lag
    return np.broadcast_to(out, (sets, f.size))


FIGURE_FREQUENCIES_HZ = tuple(float(f) for f in range(1, 251))


def fig10_study(tactor: Tactor | None = None, membrane: Membrane | None = None) -> Study:
    """Effect of skin stiffness: E_m over six decades at 1 mm elongation, no skin damping (Sec. V-A)."""
    membrane = membrane or Membrane()
    on = Specimen(tactor or Tactor(), membrane, delta=1e-3 / membrane.L_m, c_s=0.0)
    return Study({"E_m": (1e3, 1e6, 1e7, 1e8, 1e9)}, FIGURE_FREQUENCIES_HZ, on)


def fig11_study(tactor: Tactor | None = None, membrane: Membrane | None = None) -> Study:
    """Effect of skin damping: c_s as multiples of c_bar, no pre-stretch (Sec. V-B)."""
    on = Specimen(tactor or Tactor(), membrane or Membrane())
    return Study({"c_s": tuple(m * on.tactor.c_bar for m in (1e-3, 1.0, 10.0, 25.0, 50.0))}, FIGURE_FREQUENCIES_HZ, on)


def fig12_study(tactor: Tactor | None = None, membrane: Membrane | None = None) -> Study:
    """Effect of pre-stretch on stiffness and damping together (Sec. V-C)."""
    on = Specimen(tactor or Tactor(), membrane or Membrane())
    return Study({"delta": (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)}, FIGURE_FREQUENCIES_HZ, on)


STUDY_PRESETS = {"fig10": fig10_study, "fig11": fig11_study, "fig12": fig12_study}
