"""Nonidealities of a real specimen and its instruments, as parameters of the fit: effects outside the beam model.

Their defaults have no effect. Each can be free, fixed or have a prior, like a parameter of the model.
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
from annotated_types import Interval

from model import CLAMP_FLEXIBILITY, CREEP, HYSTERESIS, AmplifierMap, Array, Complex, ParameterSpec
from model.drive_history import DriveHistory, rayleigh_response
from model.identification import observations as observed
from model.response import REFERENCE_S, crept_response, loop_harmonics, sine_harmonics
from model.specimen import flexible_clamp_lengths

Values = Mapping[str, Any]

NONIDEALITIES = {
    spec.name: spec
    for spec in (
        ParameterSpec.listed("mass_fraction", Interval(gt=0, le=1), 1.0),
        ParameterSpec.listed("mass_offset", Interval(), 0.0),
        ParameterSpec.listed("mass_put_in", Interval(ge=0), 0.0),
        ParameterSpec.listed("load_gain", Interval(gt=-1), 0.0),
        ParameterSpec.listed("sensor_gain", Interval(gt=-1), 0.0),
        ParameterSpec.listed("load_offset", Interval(), 0.0),
        ParameterSpec.listed("zero_drift", Interval(), 0.0),
        CLAMP_FLEXIBILITY,
        CREEP,
        HYSTERESIS,
        ParameterSpec.listed("stiffening", Interval(), 0.0),
        ParameterSpec.listed("gain_below_rest", Interval(gt=-1), 0.0),
        ParameterSpec.listed("gain_above_rest", Interval(gt=-1), 0.0),
        ParameterSpec.listed("delay", Interval(), 0.0),
        ParameterSpec.listed("gain_drift", Interval(gt=-1), 0.0),
        ParameterSpec.listed("elongation_offset", Interval(), 0.0),
        ParameterSpec.listed("k2_per_kelvin", Interval(), 0.0),
        ParameterSpec.listed("mu_per_kelvin", Interval(), 0.0),
        ParameterSpec.listed("c0_per_kelvin", Interval(), 0.0),
        ParameterSpec.listed("elongation_slip", Interval(ge=0, lt=1), 0.0),
    )
}
TEMPERATURE_DEPENDENT = ("k2", "mu", "c0")
LOADING_TIME_S = 10.0
STEP_TIME_S = 1.0
"""Assumed time from a weight, or a level, to its reading, s, for a run that does not state it."""
SLOPE_STEP = 1e-3
"""Relative step of the amplifier's slopes: loops and creep of earlier levels depend on them, too."""
KEPT_RUNS = 8192
"""Largest number of remembered harmonics: of each run up to nine, by order and slopes of the amplifier."""
DRIVES_AT_ONCE = 64
"""Drives whose periods are in memory at a time."""
STIFFENING_M = 1e-3
"""Deflection of a relative growth of the stiffness by `stiffening`, m."""
TYPICAL_SIZES = {"kg": 1e-2, "m": 1e-3, "s": 1e-3, "N": 1.0, "1": 1.0, "1/K": 0.1}
"""One hundred percent of a nonideality by unit: a scale of the fit, far above its size in a laboratory."""
DEFAULTS: dict[str, Any] = {name: spec.default for name, spec in NONIDEALITIES.items()}


def specimen_harmonic(run: observed.FrequencyResponseObservation, amplifier: AmplifierMap, order: int = 1) -> Complex:
    """Return V_k of the volts on the specimen at each usable point of a run, (F,)."""
    return np.asarray(_sine_harmonics(amplifier, *_drives(run))[:, order])


def loop_harmonic(run: observed.FrequencyResponseObservation, amplifier: AmplifierMap, order: int = 1) -> Complex:
    """Return V_k of the addition of a `hysteresis` of 1 to the volts on the specimen at each usable point of a run, (F,)."""
    return np.asarray(_loop_harmonics(amplifier, *_drives(run))[:, order])


def _drives(run: observed.FrequencyResponseObservation) -> tuple[bytes, bytes]:
    """Return amplitudes and offsets of the usable points of a run as bytes, the keys of the cached harmonics."""
    amplitude, offset = (np.broadcast_to(a, run.usable.shape) for a in (run.drive_amplitude_v, run.drive_offset_v))
    return amplitude[run.usable].astype(float).tobytes(), offset[run.usable].astype(float).tobytes()


@lru_cache(maxsize=KEPT_RUNS)
def _sine_harmonics(amplifier: AmplifierMap, amplitude_v: bytes, offset_v: bytes) -> Complex:
    return sine_harmonics(np.frombuffer(amplitude_v), np.frombuffer(offset_v), amplifier, 0, 5)


@lru_cache(maxsize=KEPT_RUNS)
def _loop_harmonics(amplifier: AmplifierMap, amplitude_v: bytes, offset_v: bytes) -> Complex:
    amplitude, offset = np.frombuffer(amplitude_v), np.frombuffer(offset_v)
    starts = range(0, amplitude.size, DRIVES_AT_ONCE)
    parts = [
        loop_harmonics(amplifier, amplitude[at : at + DRIVES_AT_ONCE], offset[at : at + DRIVES_AT_ONCE])
        for at in starts
    ]
    return np.concatenate(parts)


def crept_tilt(creep: Any, omega: Any) -> tuple[Any, Any]:
    """Return first and second derivative over omega of the logarithm of |`crept_response`|, s/rad and s^2/rad^2."""
    share = creep / np.log(10)
    real = 1 - share * (np.log(omega * REFERENCE_S) + np.euler_gamma)
    square = real**2 + (share * np.pi / 2) ** 2
    return -share * real / (omega * square), share * (share + real - 2 * real**2 * share / square) / (omega**2 * square)


def acting_mass(v: Values, mass_kg: Any) -> Any:
    """Return the acting mass at the centre, kg, of a mass in the cylinder: a number, or (S,) for S sets."""
    return v["mass_fraction"] * mass_kg + v["mass_offset"]


def acting_masses(v: Values, mass_kg: Array) -> Array:
    """Return the acting masses, (S, F), of masses in the cylinder, (S, F)."""
    return np.asarray(np.reshape(v["mass_fraction"], (-1, 1)) * mass_kg + np.reshape(v["mass_offset"], (-1, 1)))


def with_acting_mass(v: Values) -> Values:
    """Return the parameters with the m_add that follows from a known `mass_put_in`."""
    return {**v, "m_add": acting_mass(v, v["mass_put_in"])} if np.any(v["mass_put_in"]) else v


def values_of_run(v: Values, run: observed.Observation, reference_c: float | None = None) -> Values:
    """Return the parameters of a run.

    They include its errors of added mass, clamp and damping, the effective lengths of a flexible clamp, and the change from the temperature
    `reference_c` to the temperature of the run, if both are known.
    """
    own = {e.name: e.acts_on for e in run.shared_errors if e.acts_on in ("clamp", "mass", "damping") and e.name in v}
    flexibility = sum((v[name] for name, on in own.items() if on == "clamp"), start=v["clamp_flexibility"])
    changed = flexible_clamp_lengths(v, flexibility) if np.any(flexibility) else {}
    masses = [v[name] for name, on in own.items() if on == "mass"]
    if masses and not isinstance(run, observed.MassResonanceObservation):
        changed["m_add"] = sum(masses, start=v["m_add"])
    if damping := [v[name] for name, on in own.items() if on == "damping"]:
        changed["c0"] = v["c0"] * sum(damping, start=1.0)
    if run.temperature_c is not None and reference_c is not None and run.temperature_c != reference_c:
        warmer = run.temperature_c - reference_c
        changed |= {n: changed.get(n, v[n]) * (1 + v[f"{n}_per_kelvin"] * warmer) for n in TEMPERATURE_DEPENDENT}
    return {**v, **changed} if changed else v


class NonidealResponse:
    """Effects of the nonidealities on the predictions of a campaign.

    Args:
        observations: the runs.
        amplifier: map of the amplifier without errors.
    """

    def __init__(self, observations: observed.ObservationSet, amplifier: AmplifierMap) -> None:
        self._amplifier = amplifier
        orders = [r.order for r in observations.of_type(observed.FrequencyResponseObservation) if r.order is not None]
        self._first, self._last = (
            (float(np.min(np.hstack(orders))), float(np.max(np.hstack(orders)))) if orders else (0.0, 0.0)
        )
        self._kept: dict[tuple[str, str], Any] = {}
        steps = observations.of_type(observed.VoltageStepsObservation)
        self._histories = {run.label: run.history or _usual_history(run, amplifier) for run in steps}

    def factor(self, run: observed.Observation, v: Values) -> Any:
        """Return the factor of the predictions at a run's usable points, of a shape that broadcasts to (S, F)."""
        factor = self._factor(run, v)
        if np.any(v["sensor_gain"]) and not isinstance(run, observed.MassResonanceObservation):
            factor = factor * (1 + _column(v["sensor_gain"]))
        return factor

    def _factor(self, run: observed.Observation, v: Values) -> Any:
        match run:
            case observed.FrequencyResponseObservation():
                return self._dwell_factor(run, v)
            case observed.StaticLoadingObservation():
                decades = self._keep(run.label, "decades", lambda: _loading_decades(run))
                return self._static_factor(v, decades, run.deflection_m[run.usable])
            case observed.VoltageStepsObservation():
                decades = self._histories[run.label].decades(REFERENCE_S)[run.usable]
                return self._static_factor(v, decades, run.deflection_m[run.usable])
        return 1.0

    def _static_factor(self, v: Values, decades: Array, deflection_m: Array) -> Any:
        factor: Any = 1.0
        if np.any(v["creep"]):
            factor = factor * (1 + _column(v["creep"]) * decades)
        if np.any(v["stiffening"]):
            factor = factor / (1 + _column(v["stiffening"]) * (deflection_m / STIFFENING_M) ** 2)
        return factor

    def _dwell_factor(self, run: observed.FrequencyResponseObservation, v: Values) -> Any:
        f = run.frequency_hz[run.usable]
        factor: Any = 1.0
        if np.any(v["creep"]):
            factor = factor * crept_response(_column(v["creep"]), 2 * np.pi * f)
        if np.any(v["hysteresis"]):
            late: Any = run.loop_share
            late = self._with_slopes(v, run.label, partial(_loop_share, run)) if late is None else late[run.usable]
            factor = factor * (1 + _column(v["hysteresis"]) * late)
        if np.any(v["delay"]):
            factor = factor * np.exp(-2j * np.pi * f * _column(v["delay"]))
        if np.any(v["gain_drift"]) and run.order is not None and self._last > self._first:
            factor = factor * (1 + _column(v["gain_drift"]) * (run.order - self._first) / (self._last - self._first))
        below, above = v["gain_below_rest"], v["gain_above_rest"]
        if np.any(below) or np.any(above):
            share = self._keep(run.label, "share", lambda: _share_below(run, self._amplifier))
            factor = factor * (1 + _column(below) * share + _column(above) * (1 - share))
        return factor

    def volts(self, run: observed.VoltageStepsObservation, v: Values, volts: Array) -> Array:
        """Return the acting volts on the specimen, (S, F), from the volts by the amplifier's map and the history before each reading."""
        if np.any(v["gain_below_rest"]) or np.any(v["gain_above_rest"]):
            below, above = _column(v["gain_below_rest"]), _column(v["gain_above_rest"])
            volts = volts * (1 + np.where(volts < 0, below, above))
        if not np.any(v["hysteresis"]) and not np.any(v["creep"]):
            return volts
        history = self._histories[run.label]
        creep, hysteresis = _column(v["creep"]), _column(v["hysteresis"])
        decades = history.decades(REFERENCE_S)
        loop, left, late = self._with_slopes(v, run.label, partial(_memory, history))
        volts = volts + hysteresis * loop[..., run.usable]
        volts = volts + creep * (left + hysteresis * late)[..., run.usable] / (1 + creep * decades[run.usable])
        return np.asarray(volts)

    def _with_slopes(self, v: Values, label: str, function: Callable[[AmplifierMap], Any]) -> Any:
        """Return a function of the amplifier's map for a run with the errors of its slopes, to first order, (..., S or 1, F)."""
        nominal = self._amplifier
        at_nominal = self._keep(label, "nominal", lambda: function(nominal))
        out = at_nominal[..., None, :]
        for name, field in (("gain_below_rest", "slope_below"), ("gain_above_rest", "slope_above")):
            if np.any(v[name]):
                steeper = replace(nominal, **{field: getattr(nominal, field) * (1 + SLOPE_STEP)})
                slope = self._keep(label, field, partial(_slope, function, steeper, at_nominal))
                out = out + _column(v[name]) * slope[..., None, :]
        return out

    def _keep(self, label: str, name: str, function: Callable[[], Any]) -> Any:
        """Return what is computed once for a run, because it does not depend on the parameters."""
        if (label, name) not in self._kept:
            self._kept[label, name] = function()
        return self._kept[label, name]

    def loop_share(self, run: observed.VoltageStepsObservation) -> Array:
        """Return what a `hysteresis` of 1 adds to the volts of each usable point, as a share of the largest, (F,)."""
        loop = _memory(self._histories[run.label], self._amplifier)[0]
        volts = np.abs(self._amplifier.specimen_v(run.input_v[run.usable]))
        return np.asarray(loop[run.usable] / (volts.max() or 1.0))

    def drift(self, run: observed.StaticLoadingObservation, v: Values) -> Any:
        """Return the drift of the zero at each usable point, (S, F): in the order of the rows."""
        return _column(v["zero_drift"]) * np.linspace(0, 1, run.usable.size)[run.usable]

    def stiffness_gain(self, run: observed.FrequencyResponseObservation, v: Values, sets: int) -> Array:
        """Return the relative growth of the bending stiffness at each usable point, (S, F), by harmonic balance."""
        y = run.peak_to_peak_m if run.fundamental_m is None else np.abs(run.fundamental_m)
        amplitude = np.zeros(1) if y is None else y[run.usable]
        return np.broadcast_to(
            0.75 * _column(v["stiffening"]) * (amplitude / STIFFENING_M) ** 2, (sets, int(run.usable.sum()))
        )


def _slope(function: Callable[[AmplifierMap], Any], steeper: AmplifierMap, at_nominal: Any) -> Any:
    return (function(steeper) - at_nominal) / SLOPE_STEP


def _loading_decades(run: observed.StaticLoadingObservation) -> Array:
    """Return the decades of creep at each usable point of a static loading, (F,) or (1,), with the creep of earlier loads if known."""
    if run.history is None:
        return np.log10(np.full(1, LOADING_TIME_S) / REFERENCE_S)
    loads = run.history.drive
    return np.asarray((run.history.crept(loads, REFERENCE_S) / run.history.steps(loads))[run.usable])


def _share_below(run: observed.FrequencyResponseObservation, amplifier: AmplifierMap) -> Array:
    """Return the share of the slope below rest in the fundamental of the volts at each usable point of a run, (F,)."""
    low = AmplifierMap(amplifier.rest_v, amplifier.low_v, amplifier.high_v, amplifier.slope_below, 1e-9)
    return np.asarray((specimen_harmonic(run, low) / specimen_harmonic(run, amplifier)).real)


def _usual_history(run: observed.VoltageStepsObservation, amplifier: AmplifierMap) -> DriveHistory:
    """Return the history of levels whose times are unknown: a staircase where they rise and fall, otherwise each from rest."""
    held_s = np.full(run.input_v.size, STEP_TIME_S) if run.time_s is None else np.nan_to_num(run.time_s)
    return DriveHistory.of_levels(run.input_v, amplifier.rest_v, held_s, staircase=run.rising is not None)


def _loop_share(run: observed.FrequencyResponseObservation, amplifier: AmplifierMap) -> Complex:
    return np.asarray(loop_harmonic(run, amplifier) / specimen_harmonic(run, amplifier))


@lru_cache(maxsize=64)
def _memory(history: DriveHistory, amplifier: AmplifierMap) -> Array:
    """Return the contribution of hysteresis to the volts of each reading per unit of it, and of earlier drives by creep, per decade, (3, F).

    The factor of the creep includes the step's own. The last factor is the creep of the hysteresis.
    """
    low, high = amplifier.specimen_v([amplifier.low_v, amplifier.high_v]).tolist()
    driven = amplifier.specimen_v(history.drive)
    loop = rayleigh_response(driven, low, high) / ((high - low) / 2)
    steps, decades = history.steps(loop), history.decades(REFERENCE_S)
    left = history.crept(driven, REFERENCE_S) - decades * history.steps(driven)
    return np.array([steps, left, history.crept(loop, REFERENCE_S) - decades * steps])


def _column(value: Any) -> Any:
    """Return a parameter as a column, (S, 1) or (1, 1)."""
    return np.reshape(value, (-1, 1))
