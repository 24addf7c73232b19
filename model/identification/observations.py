"""Observations of one specimen: one frozen record per run, with values, standard errors and shared errors.

Every record carries the `label` of its run, a mask `good` (None: all points), the `shared_errors` of its instruments, and
whether it is `simulated`. Points that are not good stay in the record and are left out of every fit.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import pairwise
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from model import Array, Complex, Mask, Membrane, ParameterError, weight_per_length
from model.drive_history import DriveHistory

Side = Literal["mfc", "aluminium", "both"]
ErrorTarget = Literal[
    "displacement",
    "volts",
    "load",
    "mass",
    "delay",
    "level",
    "elongation",
    "frequency",
    "rest",
    "clamp",
    "damping",
    "clock",
    "reading",
]
SHARED_ERROR_UNITS: dict[ErrorTarget, str] = {
    "displacement": "1",
    "volts": "1",
    "load": "1",
    "mass": "kg",
    "delay": "s",
    "level": "V",
    "elongation": "m",
    "frequency": "Hz",
    "rest": "m",
    "clamp": "1",
    "damping": "1",
    "clock": "1",
    "reading": "1",
}
SAME_INPUT = 1e-9
"""Largest relative difference of equal inputs: the same weight, mass, level or frequency."""


@dataclass(frozen=True, slots=True)
class SharedError:
    """An unknown error common to all values taken with one instrument.

    It is estimated with the other parameters, with a normal prior of `standard_error` around 0. Records with the same error share
    it. On displacement, volts (on the specimen) and load it is a relative error of the gain; on mass an offset in kg, of the stated
    masses or of m_add; on clamp a flexibility of the clamp beyond `clamp_flexibility`, e.g. of one mounting; on damping a relative error of c0; on clock a relative
    error of all frequencies of a run; on reading a relative error of the prediction times the run's shape over the points
    (`shapes`); on delay an uncorrected delay of the displacement in the phases, in s; on level (volts at the amplifier's input),
    elongation and frequency an offset. With `at` it acts only at this load (N), mass, level, elongation or frequency: the error of
    one weight among several. On rest it is a drift of the displacement at rest, in m from first to last zero of the run, that decays
    as if it had begun `at` seconds before the run.
    """

    name: str
    acts_on: ErrorTarget
    standard_error: float
    at: float | None = None
    source: str = ""
    """Source in an uncertainty budget of this error and similar ones; empty: its name."""

    def __post_init__(self) -> None:
        if self.acts_on not in get_args(ErrorTarget):
            raise ParameterError(
                f"common error {self.name!r} acts on {self.acts_on!r}: choose {', '.join(SHARED_ERROR_UNITS)}"
            )
        if not (np.isfinite(self.standard_error) and self.standard_error > 0):
            raise ParameterError(
                f"common error {self.name!r} has a standard error of {self.standard_error:g}: it must be positive; "
                "leave the error out if the instrument is perfect"
            )
        if self.acts_on == "rest" and not (self.at is not None and self.at > 0):
            raise ParameterError(f"common error {self.name!r} of rest needs the seconds before the run when it began")
        everywhere = ("displacement", "volts", "delay", "clamp", "damping", "clock", "reading")
        if self.at is not None and (self.acts_on in everywhere or not np.isfinite(self.at)):
            raise ParameterError(f"common error {self.name!r} of {self.acts_on} cannot act at {self.at:g} only")

    def acts_at(self, inputs: Array) -> Mask:
        """Return the mask of points with these loads, masses, levels, elongations or frequencies on which it acts."""
        if self.at is None:
            return np.ones(np.shape(inputs), bool)
        return np.asarray(np.abs(inputs - self.at) <= SAME_INPUT * abs(self.at))


@dataclass(frozen=True, eq=False)
class _ObservationBase:
    label: str
    good: Mask | None = field(default=None, kw_only=True)
    """(F,): mask of the points that a fit may use; None: all."""
    shared_errors: tuple[SharedError, ...] = field(default=(), kw_only=True)
    simulated: bool = field(default=False, kw_only=True)
    mountings: Mapping[str, str] = field(default_factory=dict, kw_only=True)
    """By part of the set-up: time of its last mounting, ISO 8601; a part without one was mounted at an unknown time."""
    temperature_c: float | None = field(default=None, kw_only=True)
    """Of the air, degrees Celsius; None if not known."""
    shapes: Mapping[str, Complex | Array] = field(default_factory=dict, kw_only=True)
    """By name of a shared error of the reading: its shape over the points, (F,)."""

    @property
    def usable(self) -> Mask:
        """(F,): the usable points."""
        return np.asarray(self.good)

    def _validate_columns(self, kind: str, columns: Sequence[str], errors: Sequence[str], x: str) -> None:
        """Turn the named fields into read-only columns of one length and check them."""
        size = np.atleast_1d(np.asarray(getattr(self, x))).shape
        if len(size) != 1 or not size[0]:
            raise ParameterError(f"{kind} {self.label!r}: {x} has shape {size}; give at least one value, in one row")
        good = np.ones(size, bool) if self.good is None else np.atleast_1d(np.asarray(self.good))
        if good.shape != size or good.dtype != bool:
            raise ParameterError(f"{kind} {self.label!r}: good must be {size[0]} times true or false")
        for name in columns:
            value = getattr(self, name)
            if value is None:
                continue
            try:
                v = np.asarray(value)
                v = v.astype(complex if v.dtype.kind == "c" else float)
            except (TypeError, ValueError):
                raise ParameterError(f"{kind} {self.label!r}: {name} is not a row of numbers") from None
            v = np.broadcast_to(v, size).copy() if v.ndim == 0 else v.copy()
            if v.shape[:1] != size or (v.ndim != 1 and name != "harmonics_m"):
                raise ParameterError(
                    f"{kind} {self.label!r}: {name} has shape {v.shape} for {size[0]} values of {x}; give one each"
                )
            usable = v[good] if v.ndim == 1 else np.zeros(1)
            if not np.isfinite(usable).all():
                raise ParameterError(
                    f"{kind} {self.label!r}: {name} is not finite at a point that counts as good; flag it"
                )
            if name in errors and not (usable > 0).all():
                raise ParameterError(
                    f"{kind} {self.label!r}: {name} holds {usable.min():g}; a standard error must be positive"
                )
            v.setflags(write=False)
            object.__setattr__(self, name, v)
        good.setflags(write=False)
        object.__setattr__(self, "good", good)
        history = getattr(self, "history", None)
        if history is not None and history.read_s.shape != size:
            raise ParameterError(
                f"{kind} {self.label!r}: its history has {history.read_s.size} readings for {size[0]} points"
            )


@dataclass(frozen=True, eq=False)
class StaticLoadingObservation(_ObservationBase):
    """Deflection of the centre under a load at the centre, electrodes shorted; both positive in the direction of the push."""

    load_n: Array
    deflection_m: Array
    errors_m: Array
    side: Side = "both"
    """Loaded side; "both" for averages over the sides."""
    history: DriveHistory | None = None
    """History of the loads; None if unknown."""

    def __post_init__(self) -> None:
        if self.side not in get_args(Side):
            raise ParameterError(f"static loading {self.label!r}: side is {self.side!r}; choose mfc, aluminium or both")
        self._validate_columns("static loading", ("load_n", "deflection_m", "errors_m"), ("errors_m",), "load_n")


@dataclass(frozen=True, eq=False)
class MassResonanceObservation(_ObservationBase):
    """Resonance frequency for each mass added in the cylinder.

    `meaning` is the definition of the frequency: the "peak" of the displacement's spectrum under a constant voltage, or the
    "undamped" natural frequency, as from a fit of the pole. At a damping ratio of 0.21 they differ by 5 %.
    """

    mass_kg: Array
    frequency_hz: Array
    errors_hz: Array
    meaning: Literal["peak", "undamped"] = "peak"

    def __post_init__(self) -> None:
        if self.meaning not in ("peak", "undamped"):
            raise ParameterError(f"mass resonance {self.label!r}: meaning is {self.meaning!r}; choose peak or undamped")
        self._validate_columns("mass resonance", ("mass_kg", "frequency_hz", "errors_hz"), ("errors_hz",), "mass_kg")


@dataclass(frozen=True, eq=False)
class VoltageStepsObservation(_ObservationBase):
    """Deflection against rest for constant volts at the amplifier's input."""

    input_v: Array
    deflection_m: Array
    errors_m: Array
    rising: Mask | None = None
    """Whether the level is reached from below (True) or above; None if unknown."""
    time_s: Array | None = None
    """Time from reaching each level to its reading."""
    history: DriveHistory | None = None
    """History of levels and rests; None: in the order of the points, as a staircase with `rising`, otherwise each from rest."""

    def __post_init__(self) -> None:
        self._validate_columns(
            "voltage steps", ("input_v", "deflection_m", "errors_m", "time_s"), ("errors_m",), "input_v"
        )
        if self.rising is not None:
            rising = np.asarray(self.rising)
            if rising.dtype != bool or rising.shape != np.shape(self.input_v):
                raise ParameterError(f"voltage steps {self.label!r}: rising must be true or false for each level")
            object.__setattr__(self, "rising", rising)


@dataclass(frozen=True, eq=False)
class FrequencyResponseObservation(_ObservationBase):
    """Response to a sine around rest, at single frequencies.

    `fundamental_m` is the result of a sine fit, (F,): complex, |F| sin(w t + arg F) with the phase against the sine at the
    amplifier's input; real for an amplitude without phase; None for max - min alone. `errors_m` is the standard error of each of
    its two components.
    """

    frequency_hz: Array
    fundamental_m: Complex | Array | None = None
    errors_m: Array | None = None
    drive_amplitude_v: Array | float = 2.5
    """Peak amplitude at the amplifier's input."""
    drive_offset_v: Array | float = 2.5
    elongation_m: float | None = None
    """Elongation of the membrane; None: the free tactor."""
    added_mass_kg: float | None = None
    """Mass in the cylinder; None: the effective mass `m_add`, which is identified."""
    peak_to_peak_m: Array | None = None
    peak_to_peak_errors_m: Array | None = None
    harmonics_m: Array | None = None
    """(F, K): peak amplitudes of orders 1..K, NaN where unknown."""
    harmonic_errors_m: Array | None = None
    """Standard error of each component of a harmonic: the sensor's noise, without repeatability; None: `errors_m`."""
    phase_errors_rad: Array | None = None
    """Standard error of the phase, if different from the amplitude's; `errors_m` then refers to the amplitude."""
    swept: bool = False
    """Whether these are the lines of one sweep instead of single dwells."""
    loop_share: Complex | None = None
    """Addition of a hysteresis of 1 to the volts on the specimen, as a share of them, (F,); None: as under a sine."""
    order: Array | float | None = None
    """Time of the measurement (any clock), or of each point, (F,): the first and the last of a kind show drift."""

    def __post_init__(self) -> None:
        kind = "frequency response"
        for value, error in (("fundamental_m", "errors_m"), ("peak_to_peak_m", "peak_to_peak_errors_m")):
            if (getattr(self, value) is None) != (getattr(self, error) is None):
                raise ParameterError(f"{kind} {self.label!r}: {value} and {error} go together; give both or neither")
        if self.fundamental_m is None and self.peak_to_peak_m is None:
            raise ParameterError(f"{kind} {self.label!r}: give the fundamental, or max - min, with its errors")
        columns = ("frequency_hz", "fundamental_m", "errors_m", "drive_amplitude_v", "drive_offset_v")
        more = ("peak_to_peak_m", "peak_to_peak_errors_m", "harmonics_m", "harmonic_errors_m", "phase_errors_rad")
        self._validate_columns(
            kind,
            (*columns, *more, "loop_share"),
            ("errors_m", "peak_to_peak_errors_m", "harmonic_errors_m", "phase_errors_rad", "frequency_hz"),
            "frequency_hz",
        )
        if self.elongation_m is not None and not self.elongation_m >= 0:
            raise ParameterError(f"{kind} {self.label!r}: elongation is {self.elongation_m} m; it must be at least 0")


@dataclass(frozen=True, eq=False)
class DecayPoleObservation(_ObservationBase):
    """First pole of the free tactor, from its free decay: undamped natural frequency and damping ratio.

    A fit takes them as one complex number, `pole_hz`: its modulus is the frequency, its angle beyond 90 degrees gives the damping.
    """

    frequency_hz: Array
    errors_hz: Array
    damping: Array
    damping_errors: Array
    pole_hz: Complex = field(init=False)
    """The pole over 2 pi, (F,), in the upper half plane."""
    phase_errors_rad: Array = field(init=False)

    def __post_init__(self) -> None:
        kind, columns = "free decay", ("frequency_hz", "errors_hz", "damping", "damping_errors")
        self._validate_columns(kind, columns, ("frequency_hz", "errors_hz", "damping_errors"), "frequency_hz")
        if not ((np.abs(self.damping[self.usable]) < 1).all()):
            raise ParameterError(f"{kind} {self.label!r}: a damping ratio is not below 1; such a motion does not ring")
        damping = np.clip(self.damping, -0.999, 0.999)
        object.__setattr__(self, "pole_hz", 1j * self.frequency_hz * np.exp(1j * np.arcsin(damping)))
        object.__setattr__(self, "phase_errors_rad", self.damping_errors / np.sqrt(1 - damping**2))

    def with_pole(self, pole_hz: Complex) -> "DecayPoleObservation":
        """Return the run with other poles, (F,)."""
        return replace(self, frequency_hz=np.abs(pole_hz), damping=-np.real(pole_hz) / np.abs(pole_hz))


@dataclass(frozen=True, eq=False)
class MembraneSagObservation(_ObservationBase):
    """Sag of the membrane's centre under a uniform load, its own weight by default."""

    deflection_m: Array
    errors_m: Array
    geometry: Membrane | None = None
    """Geometry of the hanging strip; None: the specimen's membrane. Its E_m is ignored."""
    load_n_per_m: float | None = None
    delta: float = 0.0

    def __post_init__(self) -> None:
        self._validate_columns("membrane sag", ("deflection_m", "errors_m"), ("errors_m",), "deflection_m")

    def load_per_length(self, membrane: Membrane) -> float:
        """N/m: the given load, or the weight of rubber."""
        return weight_per_length(self.geometry or membrane) if self.load_n_per_m is None else self.load_n_per_m


ObservationT = TypeVar("ObservationT", bound=_ObservationBase)
Observation = (
    StaticLoadingObservation
    | MassResonanceObservation
    | VoltageStepsObservation
    | FrequencyResponseObservation
    | DecayPoleObservation
    | MembraneSagObservation
)


@dataclass(frozen=True, eq=False)
class ObservationSet:
    """All runs of one specimen that an identification uses.

    Raises:
        ParameterError: no run, a run without a usable point, two runs of one label, or different descriptions of one shared error.
    """

    runs: tuple[Observation, ...]
    shared_errors: dict[str, SharedError] = field(init=False)

    def __post_init__(self) -> None:
        if not self.runs:
            raise ParameterError("there is no run to identify anything from: choose at least one")
        labels = [run.label for run in self.runs]
        for label in labels:
            if labels.count(label) > 1:
                raise ParameterError(f"two runs are called {label!r}: give each its own label")
        common: dict[str, SharedError] = {}
        for run in self.runs:
            if not run.usable.any():
                raise ParameterError(f"run {run.label!r} has no usable point: leave it out, or measure it again")
            for error in run.shared_errors:
                if common.setdefault(error.name, error) != error:
                    raise ParameterError(f"the common error {error.name!r} is described in two ways: make them one")
        object.__setattr__(self, "shared_errors", common)

    def of_type(self, observation_type: type[ObservationT]) -> list[ObservationT]:
        """The runs of one kind, in order."""
        return [run for run in self.runs if isinstance(run, observation_type)]

    @cached_property
    def reference_c(self) -> float | None:
        """Temperature to which the results of a fit refer, degrees Celsius: the mean over the runs; None if no run states one."""
        known = [run.temperature_c for run in self.runs if run.temperature_c is not None]
        return sum(known) / len(known) if known else None

    @property
    def simulated(self) -> bool:
        """Whether a run is simulated."""
        return any(run.simulated for run in self.runs)


def observed_values(run: Observation) -> tuple[Any, Array]:
    """Observed values, real or complex, and their standard errors, both (F,): usable points only."""
    values, errors = _columns(run)
    return getattr(run, values)[run.usable], getattr(run, errors)[run.usable]


def over_errors(run: Observation, difference: Any) -> Array:
    """Return differences (..., F) to the observed values, or slopes, over their standard errors, in the form of a fit.

    Real values stay (..., F); complex values become (..., 2 F): real and then imaginary parts, or amplitudes and then phases if
    the phases have errors of their own.
    """
    y, error = observed_values(run)
    if not np.iscomplexobj(y):
        return np.asarray(difference / error)
    other = error
    if isinstance(run, FrequencyResponseObservation | DecayPoleObservation) and run.phase_errors_rad is not None:
        difference = difference * np.exp(-1j * np.angle(y))
        other = np.abs(y) * run.phase_errors_rad[run.usable]
    return np.concatenate((np.real(difference) / error, np.imag(difference) / other), axis=-1)


class ErrorRows:
    """Rows of all points of runs over their standard errors: `over_errors` of all runs at once.

    Attributes:
        parts: points of each run, usable ones only.
    """

    def __init__(self, runs: Sequence[Observation]) -> None:
        values = [observed_values(run) for run in runs]
        ends = np.cumsum([0, *(y.size for y, _ in values)]).tolist()
        self.parts = [slice(a, b) for a, b in pairwise(ends)]
        self.observed = np.concatenate([y for y, _ in values])
        self._error = np.concatenate([error for _, error in values])
        self._turn = np.ones(ends[-1], complex)
        self._other = self._error.copy()
        real: list[Array] = []
        imaginary: list[Array] = []
        self.row_count = 0
        for run, (y, _), part in zip(runs, values, self.parts, strict=True):
            real.append(np.arange(self.row_count, self.row_count + y.size))
            self.row_count += y.size
            imaginary.append(np.full(y.size, -1))
            if np.iscomplexobj(y):
                imaginary[-1] = real[-1] + y.size
                self.row_count += y.size
            if (
                isinstance(run, FrequencyResponseObservation | DecayPoleObservation)
                and run.phase_errors_rad is not None
            ):
                self._turn[part] = np.exp(-1j * np.angle(y))
                self._other[part] = np.abs(y) * run.phase_errors_rad[run.usable]
        self._real, every = np.concatenate(real), np.concatenate(imaginary)
        self._complex = np.flatnonzero(every >= 0)
        self._imaginary = every[self._complex]

    def of(self, difference: Any) -> Array:
        """Return differences (..., points) to the observed values, or slopes, in the rows of a fit, (..., rows)."""
        out = np.empty((*difference.shape[:-1], self.row_count))
        turned = difference * self._turn if self._complex.size else difference
        out[..., self._real] = turned.real / self._error
        if self._complex.size:
            out[..., self._imaginary] = turned.imag[..., self._complex] / self._other[self._complex]
        return out


def with_observed_values(run: Observation, values: Any) -> Observation:
    """The run with `values` (F,) in place of the observations at its usable points."""
    if isinstance(run, DecayPoleObservation):
        poles = run.pole_hz.copy()
        poles[run.usable] = values
        return run.with_pole(poles)
    name, _ = _columns(run)
    column = np.array(getattr(run, name), dtype=np.result_type(getattr(run, name), values))
    column[run.usable] = values
    more: Any = {name: column}
    return replace(run, **more)


def _columns(run: Observation) -> tuple[str, str]:
    match run:
        case MassResonanceObservation():
            return "frequency_hz", "errors_hz"
        case DecayPoleObservation():
            return "pole_hz", "errors_hz"
        case FrequencyResponseObservation(fundamental_m=None):
            return "peak_to_peak_m", "peak_to_peak_errors_m"
        case FrequencyResponseObservation():
            return "fundamental_m", "errors_m"
    return "deflection_m", "errors_m"


@dataclass(frozen=True, eq=False)
class Condition:
    """One condition of dwells with a fundamental.

    Attributes:
        run: a run with every different point once; all are usable.
        places: by label of a run, the point of `run` for each of its usable points, (F,).
    """

    run: FrequencyResponseObservation
    places: dict[str, NDArray[np.intp]]


def conditions_of(observations: ObservationSet, effects: Sequence[str] = ()) -> list[Condition]:
    """Return the conditions of all dwells with a fundamental, in order.

    Points are equal if they have one frequency and drive, and one measured amplitude and time where the `effects` "stiffening" and
    "gain_drift" depend on them. Errors of a reading are no part of a condition.
    """
    same: dict[Any, list[FrequencyResponseObservation]] = {}
    for run in observations.of_type(FrequencyResponseObservation):
        if run.fundamental_m is not None:
            errors = tuple(e for e in run.shared_errors if e.acts_on != "reading")
            known = run.loop_share is None, run.order is None, np.iscomplexobj(run.fundamental_m)
            key = errors, run.elongation_m, run.added_mass_kg, run.temperature_c, known
            same.setdefault(key, []).append(run)
    return [_condition(runs, key[0], effects) for key, runs in same.items()]


def _condition(runs: list[FrequencyResponseObservation], errors: Any, effects: Sequence[str]) -> Condition:
    first = runs[0]
    stacked = {
        name: np.concatenate([getattr(run, name)[run.usable] for run in runs])
        for name in ("frequency_hz", "fundamental_m", "errors_m", "drive_amplitude_v", "drive_offset_v")
    }
    if first.loop_share is not None:
        stacked["loop_share"] = np.concatenate([np.asarray(run.loop_share)[run.usable] for run in runs])
    if first.order is not None:
        stacked["order"] = np.concatenate(
            [np.broadcast_to(np.asarray(run.order), run.usable.shape)[run.usable] for run in runs]
        )
    keys = [stacked[name] for name in ("frequency_hz", "drive_amplitude_v", "drive_offset_v")]
    if "loop_share" in stacked:
        keys += [stacked["loop_share"].real, stacked["loop_share"].imag]
    if "stiffening" in effects:
        keys.append(np.abs(stacked["fundamental_m"]))
    if "gain_drift" in effects and "order" in stacked:
        keys.append(stacked["order"])
    _, at, where = np.unique(np.stack(keys, axis=-1), axis=0, return_index=True, return_inverse=True)
    ends = np.cumsum([int(run.usable.sum()) for run in runs])[:-1]
    none = ("peak_to_peak_m", "peak_to_peak_errors_m", "harmonics_m", "harmonic_errors_m", "phase_errors_rad")
    changes: dict[str, Any] = dict.fromkeys(none) | {name: column[at] for name, column in stacked.items()}
    merged = replace(first, good=None, shared_errors=errors, shapes={}, **changes)
    places = np.split(where.ravel(), ends)
    return Condition(merged, {run.label: place for run, place in zip(runs, places, strict=True)})


def condensed(observations: ObservationSet, effects: Sequence[str]) -> tuple[ObservationSet, float]:
    """Return runs whose least squares have the same minimum, and the root of the part of chi-square that no parameter changes.

    Every point that several runs measured under one condition is replaced by its weighted mean; `effects` as in `conditions_of`.
    """
    runs: dict[str, Observation] = {run.label: run for run in observations.runs}
    plain = {
        run.label: run
        for run in observations.of_type(FrequencyResponseObservation)
        if run.phase_errors_rad is None and all(e.acts_on != "reading" for e in run.shared_errors)
    }
    constant = 0.0
    for condition in conditions_of(ObservationSet(tuple(plain.values())), effects) if plain else ():
        members = [plain[label] for label in condition.places]
        at = np.concatenate(list(condition.places.values()))
        y, error = (np.concatenate(each) for each in zip(*map(observed_values, members), strict=True))
        weight, total = np.zeros(condition.run.frequency_hz.size), np.zeros(condition.run.frequency_hz.size, y.dtype)
        np.add.at(weight, at, error**-2)
        np.add.at(total, at, y / error**2)
        mean = total / weight
        constant += float(np.sum(np.abs((y - mean[at]) / error) ** 2))
        runs[members[0].label] = replace(condition.run, fundamental_m=mean, errors_m=weight**-0.5)
        for r in members[1:]:
            del runs[r.label]
    return ObservationSet(tuple(runs.values())), float(np.sqrt(constant))
