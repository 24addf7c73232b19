"""Step and onset response of the tactor, exact from its poles, and latency: rise, settling and time to threshold of both."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from annotated_types import Interval
from numpy.typing import ArrayLike

from model import AmplifierMap, Array, Complex, Mask, ParameterSpec, Skin, Tactor
from model.beam import ModalForm, receptance
from model.parameter_spec import PERIODIC_FREQUENCY_SPEC
from model.response.drive_spectrum import fourier_series
from model.response.harmonic_response import harmonic_orders, tactor_modal_form
from model.response.perception import THRESHOLD_M, THRESHOLD_SPEC

TIME_SPEC = ParameterSpec("time", "s", Interval(ge=0), "time since the drive began", None)


def step_response(
    tactor: Tactor,
    time_s: ArrayLike,
    volts: float = 1500.0,
    skin: Skin | None = None,
    n: int = 7,
    x: float | None = None,
) -> Array:
    """w(x, t), m, after a step of `volts` on the specimen at t = 0 from rest; shape of `time_s`.

    Raises:
        ParameterError: a time < 0, n not in 3..300, x outside 0..L.
    """
    return volts * unit_step(tactor_modal_form(tactor, skin, n, x), TIME_SPEC.check(time_s))


def unit_step(form: ModalForm, t: Array) -> Array:
    """sum_k r_k (exp(s_k t) - 1) / s_k for one output, shape of t."""
    s, r = form
    above = s.imag >= 0  # one pole of each conjugate pair suffices
    s, r = s[above], np.where(s.imag > 0, 2.0, 1.0)[above] * r[above]
    return np.asarray((np.expm1(np.multiply.outer(t, s)) @ (r / s)).real)


def onset_response(form: ModalForm, t: Array, frequency_hz: float, V: Complex) -> Complex:
    """Response to the drive Re sum_k V_k exp(i k w t) that begins at t = 0, complex before Re; shape of t.

    With one harmonic its modulus is the envelope, free of the start phase.
    """
    s, r = form
    k = 2j * np.pi * frequency_hz * np.arange(V.size)
    gain = V[:, None] * r / (k[:, None] - s)  # (K + 1, 2n)
    steady = np.exp(np.multiply.outer(t, k)) @ gain.sum(1)
    return np.asarray(steady - np.exp(np.multiply.outer(t, s)) @ gain.sum(0))


TOLERANCE_SPEC = ParameterSpec(
    "tolerance", "", Interval(gt=0, lt=1), "settling band as a fraction of the final value", 0.02
)
TIME_POINTS = 20_000


@dataclass(frozen=True, slots=True)
class Latency:
    """Times in s from the begin of the drive; None for an event that does not occur."""

    final_m: float
    """Static deflection after a step; steady peak amplitude of the fundamental after a sine's onset."""
    to_threshold_s: float | None
    rise_s: float | None
    """10 % to 90 % of `final_m`."""
    settling_s: float | None
    """Time after which the response stays within the tolerance of `final_m`."""
    overshoot: float
    """Largest excess over `final_m`, as a fraction of it."""


@dataclass(frozen=True, slots=True)
class PublishedLatency:
    """A published time of another kind of haptic actuator, in s, with its source.

    All of them are times to (nearly) the full vibration, not to 50 um: they compare with the rise of a sine's onset.
    """

    actuator: str
    low_s: float
    high_s: float
    meaning: str
    source: str

    @property
    def description(self) -> str:
        """The entry in a line."""
        low, high = (f"{1e3 * value:g}" for value in (self.low_s, self.high_s))
        span = f"below {high}" if not self.low_s else low if low == high else f"{low} to {high}"
        return f"{self.actuator}: {span} ms, {self.meaning} ({self.source})"


_MOUSER = (
    "Mouser Electronics with TDK, 'Piezoelectric Technology Enhances Haptics', https://resources.mouser.com/i/1532765"
)
_CLASS = f"{_MOUSER}, p. 12, Table 4"
_MEASURED = f"{_MOUSER}, p. 8, Table 1"
_MOTOR = "Precision Microdrives, https://www.precisionmicrodrives.com/new-testing-for-the-precision-haptic-erms"

PUBLISHED_LATENCIES = (
    PublishedLatency("LRA", 10e-3, 20e-3, "latency, a figure for the whole class", _CLASS),
    PublishedLatency("ERM", 50e-3, 100e-3, "latency, a figure for the whole class", _CLASS),
    PublishedLatency("ERM", 116e-3, 116e-3, "rise, measured by TDK on one motor", _MEASURED),
    PublishedLatency(
        "ERM", 180e-3, 180e-3, "to the largest amplitude at the rated voltage, measured by the maker, 5 mm motor 305-000", _MOTOR
    ),
    PublishedLatency("piezo", 0.0, 1e-3, "latency, a figure for the whole class", _CLASS),
    PublishedLatency("piezo", 0.0, 4e-3, "rise, TDK PiezoHapt", _MEASURED),
)  # fmt: skip
"""Linear resonant actuators (LRA), eccentric rotating masses (ERM) and piezo actuators."""


def step_latency(
    tactor: Tactor,
    volts: float = 1500.0,
    threshold_m: float = THRESHOLD_M,
    tolerance: float = 0.02,
    skin: Skin | None = None,
    n: int = 7,
) -> Latency:
    """Latency of the centre after a step of `volts` on the specimen.

    Raises:
        ParameterError: threshold <= 0, tolerance outside 0..1, n not in 3..300.
    """
    form = tactor_modal_form(tactor, skin, n)
    sign = 1.0 if volts * tactor.mu <= 0 else -1.0

    def w(t: Array) -> Array:
        return sign * volts * unit_step(form, t)

    final = float(sign * volts * -(form.residues / form.poles).sum().real)
    return _evaluate_latency(w, w, final, threshold_m, tolerance, form)


def sine_latency(
    tactor: Tactor,
    frequency_hz: float,
    amplitude_v: float = 2.5,
    offset_v: float = 2.5,
    threshold_m: float = THRESHOLD_M,
    tolerance: float = 0.02,
    skin: Skin | None = None,
    amplifier: AmplifierMap | None = None,
    n: int = 7,
) -> Latency:
    """Latency of the centre after the onset of a sine at the amplifier's input (volts, peak).

    The threshold is met by the deflection itself, with the amplifier's harmonics; rise, settling and overshoot refer to the
    fundamental's envelope.

    Raises:
        ParameterError: frequency <= 0, a drive outside the amplifier's range, threshold <= 0, tolerance outside 0..1.
    """
    f = float(PERIODIC_FREQUENCY_SPEC.check(frequency_hz))
    form = tactor_modal_form(tactor, skin, n)
    V = fourier_series("sine", amplitude_v, offset_v, amplifier or AmplifierMap(), harmonic_orders(np.array([f])))
    first = np.zeros(2, complex)
    first[1] = V[1]

    def deflection(t: Array) -> Array:
        return np.abs(onset_response(form, t, f, V).real)

    def envelope(t: Array) -> Array:
        return np.abs(onset_response(form, t, f, first))

    final = float(abs(V[1] * receptance(form, np.array([2 * np.pi * f]))[0]))
    return _evaluate_latency(deflection, envelope, final, threshold_m, tolerance, form, slowest_hz=f)


def _evaluate_latency(
    threshold_signal: Callable[[Array], Array],
    envelope: Callable[[Array], Array],
    final: float,
    threshold_m: float,
    tolerance: float,
    form: ModalForm,
    slowest_hz: float = np.inf,
) -> Latency:
    threshold, band = float(THRESHOLD_SPEC.check(threshold_m)), float(TOLERANCE_SPEC.check(tolerance))
    if final == 0:
        return Latency(0.0, None, None, None, 0.0)
    decay = float((-form.poles.real).min())
    slowest = float(np.abs(form.poles).min())
    # Without damping the response never settles: evaluate a hundred periods only.
    span = 12 / decay if decay > 1e-3 * slowest else 200 * np.pi / slowest
    t = np.linspace(0.0, max(span, 2 / slowest_hz), TIME_POINTS)
    e = envelope(t)
    low, high = (_first_crossing(envelope, t, e, share * final) for share in (0.1, 0.9))
    outside = np.abs(e - final) > band * final
    settled = None if outside[-1] else _last_crossing(lambda s: np.abs(envelope(s) - final), t, outside, band * final)
    rise = None if low is None or high is None else high - low
    over = max(0.0, float(e.max()) / final - 1)
    deflection = e if threshold_signal is envelope else threshold_signal(t)
    return Latency(final, _first_crossing(threshold_signal, t, deflection, threshold), rise, settled, over)


def _first_crossing(w: Callable[[Array], Array], t: Array, samples: Array, level: float) -> float | None:
    above = np.flatnonzero(samples >= level)
    if not above.size:
        return None
    i = int(above[0])
    return 0.0 if i == 0 else _bisect_crossing(w, t[i - 1], t[i], level)


def _last_crossing(w: Callable[[Array], Array], t: Array, outside: Mask, level: float) -> float:
    out = np.flatnonzero(outside)
    return 0.0 if not out.size else _bisect_crossing(w, t[out[-1]], t[out[-1] + 1], level)


def _bisect_crossing(w: Callable[[Array], Array], a: float, b: float, level: float) -> float:
    """Return the time at which w crosses `level` between a and b, by bisection to the relevant digits."""
    rising = w(np.array([b]))[0] >= level
    for _ in range(50):
        middle = (a + b) / 2
        a, b = (a, middle) if (w(np.array([middle]))[0] >= level) == rising else (middle, b)
    return float((a + b) / 2)
