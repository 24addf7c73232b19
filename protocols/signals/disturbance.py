"""Disturbance: whether a recording agrees with itself, with its drive and with the noise at rest from its begin to its end.

Every scan is predicted from the scans before it, the drive and the drive's distance from rest, because the amplifier has two
slopes: linear prediction with exogenous inputs (Ljung, System Identification, 2nd ed., sec. 4.2), fitted anew in each stretch, so
that slow changes such as creep, hysteresis and the chirp of a sweep do not count. The errors of the prediction are the sensor's noise. A
sensor that jumps, drops out, moves or sticks in motion makes an error beyond the noise, one that sticks at a level has no noise. Under a
steady drive the residuals beside its harmonics are tested, too: a cycle that differs from the others, e.g. one cut off at a limit
of the sensor.

The scale of the errors is their own, by the median, so that noise other than at rest does not count below `NOISE_RATIO`.
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from statistics import NormalDist

import numpy as np

from drivers import Hold, PeriodicSweep, Sine, SquareWave, Steps
from model import Array
from protocols.base import Quality, Recording
from protocols.signals.extremes import smallest_step
from protocols.signals.interference import SEPARATION_BINS, remove_lines
from protocols.signals.sine import NYQUIST_SHARE, fit_frequency, fit_sine, fitted_samples

FALSE_ALARM = 1e-5
"""Probability that one test flags a sound recording with normal noise; three to four tests are made of each."""

STUCK_FALSE_ALARM = 1e-9
"""The same of the test for too little noise; a sensor that sticks has a twentieth."""

NOISE_RATIO = 10.0
"""Smallest noise, divided by the noise at rest, that is a fault."""

RESPONSE_SHARE = 0.02
"""Smallest disturbance, as a share of the recording's max - min, that has to be found."""

MISFIT_SHARE = RESPONSE_SHARE / 40
"""Errors of a prediction as a share of max - min that no linear prediction of a real specimen is without."""

SWEPT_MISFIT_SHARE = RESPONSE_SHARE / 12
"""The same under a periodic sweep, whose frequency jumps where it begins anew; the simulated tactor then has errors up to 0.65 %."""

VELOCITY_MISFIT_SHARE = RESPONSE_SHARE / 6
"""The same of a vibrometer, in whose velocity the kink of the amplifier's slopes is sharper; the simulated one has up to 0.8 %."""

DRIVE_TOLERANCE, DRIVE_NOISE_V = 0.05, 0.01
"""Largest deviation of the recorded drive and of its swing from the commanded ones, as a share of the swing, and the noise of the
extremes."""

STRAY_SHARE = 0.05
"""Longest time in which a drive that begins in the recording deviates, as a share of its duration: the begins of both are compared by
one scan."""

MAX_COMPARED_CYCLES = 100
"""Longest sine that is compared by its begin: over 100 cycles, clocks that differ by 100 ppm shift it by 6 % of its amplitude."""

ORDER = 24
"""Number of earlier scans of the displacement, and of the drive, that predict a scan."""

STRETCH_SCANS = 4096
"""Number of scans with one prediction."""

SCANS_PER_UNKNOWN = 10
"""Fewest scans for each coefficient of a prediction."""

LEAST_SHARE = 1e-24
"""Smallest mean square of a scan of the windows that counts, as a share of the largest: below it are roundings."""

AVERAGED = 4
MIN_AVERAGED_RATE_HZ = 5000.0
"""Scans averaged for another test with half the noise, and its lowest rate under a drive that moves."""

WINDOW_SCANS = 64
"""Scans of a window whose noise is compared with the others'."""

MAX_ORDERS = 100
"""Largest number of harmonics that describe a cycle."""

MIN_STEADY_CYCLES = 3

_ROBUST = 1 / NormalDist().inv_cdf(0.75)
"""Standard deviation of normal values divided by their median modulus."""


def judge_recording(recording: Recording) -> Quality:
    """Return the flags of a recording: its own, `DISTURBED` and `DRIVE_OFF`. One too short for the tests of the sensor is not judged.

    The swing of a moving drive is tested, and its whole course if it is short and begins in the recording; the protocols that hold
    levels state how exact they have to be.
    """
    quality, parts = recording.quality, recording.parts()
    if len(parts) == 1 and _strays(parts[0]):
        quality |= Quality.DRIVE_OFF
    for part in parts:
        moved, drive_v = np.asarray(part.displacement_m, float), part.drive_v
        commanded_v = part.drive.high_v - part.drive.low_v
        if (
            commanded_v
            and not abs(float(np.ptp(drive_v)) - commanded_v) <= DRIVE_TOLERANCE * commanded_v + DRIVE_NOISE_V
        ):
            quality |= Quality.DRIVE_OFF
        if _is_disturbed(moved, drive_v, part):
            quality |= Quality.DISTURBED
    return quality


def _strays(recording: Recording) -> bool:
    """Whether the recorded drive leaves the course of a sine or of steps that begin in the recording: something else was played."""
    drive, rate, seen_v = recording.drive, recording.rate_hz, recording.drive_v
    if isinstance(drive, Sine) and drive.cycles <= MAX_COMPARED_CYCLES:
        quiet = math.ceil(0.5 * rate / drive.frequency_hz)
    elif isinstance(drive, Steps):
        quiet = 1
    else:
        return False
    swing_v, idle_v = drive.high_v - drive.low_v, drive.end_levels_v[0]
    commanded_v = drive.volts(np.arange(math.ceil(drive.duration_s * rate)) / rate)
    seen_at, begins_at = (np.flatnonzero(np.abs(volts - idle_v) > 0.1 * swing_v)[:1] for volts in (seen_v, commanded_v))
    if not (seen_at.size and begins_at.size) or seen_at[0] < quiet:
        return False  # the swing tells a missing drive
    scans = np.arange(seen_v.size) - seen_at[0] + begins_at[0]
    nearest = (np.abs(seen_v - drive.volts((scans + shift) / rate)) for shift in (-1.0, -0.5, 0.0, 0.5, 1.0))
    limit_v = DRIVE_TOLERANCE * swing_v + DRIVE_NOISE_V
    return min(int((error > limit_v).sum()) for error in nearest) > max(STRAY_SHARE * commanded_v.size, 2)


def prediction_noise(displacement_m: Array) -> float:
    """Return the standard deviation of the sensor's noise at rest by the errors of its prediction, in metres; NaN of too few scans."""
    errors = _prediction_errors(np.asarray(displacement_m, float), np.zeros(len(displacement_m)))
    return _scale(errors) if errors.size else math.nan


def _is_disturbed(moved: Array, drive_v: Array, recording: Recording) -> bool:
    if not (np.isfinite(moved).all() and np.isfinite(drive_v).all()):
        return True
    misfit = SWEPT_MISFIT_SHARE if isinstance(recording.drive, PeriodicSweep) else MISFIT_SHARE
    is_velocity = recording.velocity_corner_hz is not None
    misfit = VELOCITY_MISFIT_SHARE if is_velocity else misfit
    floor = max(smallest_step(moved) / math.sqrt(12), misfit * float(np.ptp(moved)))
    steady = _beside_harmonics(moved, drive_v, recording)
    left = moved if steady is None else steady[0]
    errors = _prediction_errors(left, drive_v)
    if not errors.size:
        return False
    noise = _scale(errors)
    largest = max(NOISE_RATIO * recording.rest_noise_m, RESPONSE_SHARE * float(np.ptp(moved)))
    tests = [(errors, noise, 0.0)]
    if isinstance(recording.drive, Hold) or recording.rate_hz >= AVERAGED * MIN_AVERAGED_RATE_HZ:
        averaged = _prediction_errors(_averaged(left), _averaged(drive_v))
        if averaged.size:
            tests.append((averaged, _scale(averaged), 0.0))
    if steady is not None:
        tests.append((steady[0], noise, steady[1]))
    return (
        _sticks(
            errors, recording.rest_noise_m if is_velocity else max(noise, recording.rest_noise_m), smallest_step(moved)
        )
        or noise > largest
        or any(_exceeds(values, math.hypot(scale, floor), allowed) for values, scale, allowed in tests)
    )


def _exceeds(values: Array, scale: float, allowed: float) -> bool:
    """Return whether the largest of normal values is beyond the limit of the false alarms."""
    limit = NormalDist().inv_cdf(1 - 0.5 * FALSE_ALARM / values.size)
    return float(np.abs(values).max()) > limit * scale + allowed


def _sticks(errors: Array, noise: float, step: float) -> bool:
    """Return whether the noise of a window is below the limit of the false alarms; steps of the converter may hide the noise."""
    if errors.size < WINDOW_SCANS or not noise > step:
        return False
    sums = np.cumsum(np.pad(np.stack((errors, errors**2)), ((0, 0), (1, 0))), axis=1)
    mean, square = (sums[:, WINDOW_SCANS:] - sums[:, :-WINDOW_SCANS]) / WINDOW_SCANS
    spread = 2 / (9 * WINDOW_SCANS)  # chi square over its degrees of freedom (Wilson and Hilferty)
    least = (1 - spread + NormalDist().inv_cdf(STUCK_FALSE_ALARM / errors.size) * math.sqrt(spread)) ** 3
    return float((square - mean**2).min()) < least * noise**2


def _scale(errors: Array) -> float:
    """Return the standard deviation of normal values by their median modulus, which few large values do not change."""
    return _ROBUST * float(np.median(np.abs(errors)))


def _averaged(samples: Array) -> Array:
    return np.asarray(samples[: samples.size // AVERAGED * AVERAGED].reshape(-1, AVERAGED).mean(1))


def _beside_harmonics(moved: Array, drive_v: Array, recording: Recording) -> tuple[Array, float] | None:
    """Return the residuals beside the harmonics of a steady drive, (N,), and the largest amplitude of interference in them; None of other drives."""
    drive, rate = recording.drive, recording.rate_hz
    if not isinstance(drive, Sine | SquareWave):
        return None
    cycle = math.ceil(rate / drive.frequency_hz)
    if moved.size < MIN_STEADY_CYCLES * cycle:
        return None
    ends = np.array([drive_v[:cycle].std(), drive_v[-cycle:].std()])
    if not ends.min() > 0.9 * drive_v.std() > 0:  # it begins or ends in the recording
        return None
    frequency = fit_frequency(drive_v, rate, drive.frequency_hz)
    most = int(NYQUIST_SHARE * rate / frequency)
    orders = min(most, MAX_ORDERS, moved.size // SCANS_PER_UNKNOWN)
    clean, coincident = remove_lines(moved, rate, frequency, recording.interference)
    line, waveform = fitted_samples(fit_sine(clean, rate, frequency, orders), moved.size, rate)
    left = clean - line - waveform
    if isinstance(drive, SquareWave):
        # The harmonics of its edges bias the frequency of a single sine; beyond the fitted ones they repeat with the phase.
        slope = np.gradient(waveform) * np.linspace(-0.5, 0.5, moved.size) * moved.size
        frequency *= 1 + float(slope @ left) / float(slope @ slope)
        line, waveform = fitted_samples(fit_sine(clean, rate, frequency, orders), moved.size, rate)
        left = clean - line - waveform
        places = round(rate / frequency)
        phase = np.rint(np.arange(left.size) * (frequency / rate) * places).astype(int) % places
        left = left - (np.bincount(phase, left) / np.maximum(np.bincount(phase), 1))[phase]
    return left, math.pi * SEPARATION_BINS * sum(coincident.values())


def _prediction_errors(samples: Array, drive_v: Array) -> Array:
    """Return the errors of the prediction of samples (N,) from earlier ones and the drive, (N - order,); empty of too few samples."""
    order = min(ORDER, samples.size // (3 * SCANS_PER_UNKNOWN))
    if order < 2:
        return np.empty(0)
    driven = drive_v - float(np.median(drive_v[: 2 * ORDER]))
    return np.concatenate(list(_stretch_errors(samples - samples[0], driven, order)))


def _stretch_errors(samples: Array, driven: Array, order: int) -> Iterator[Array]:
    """Yield the errors of each stretch, from its normal equations: those of windows follow from correlations and the windows' ends."""
    total = samples.size - order
    signals = samples[:-1], driven[1:], np.abs(driven[1:])
    count = max(round(total / STRETCH_SCANS), 1)
    ends = [total * i // count for i in range(count + 1)]
    for first, stop in itertools.pairwise(ends):
        scans = stop - first
        parts = [np.ascontiguousarray(signal[first : stop + order - 1]) for signal in signals]
        target = samples[order + first : order + stop]
        gram = _normal_matrix(parts, order)
        along = np.concatenate([*(np.correlate(part, target, "valid") for part in parts), [target.sum()]])
        mean_square = gram.diagonal() / scans
        scale = np.sqrt(np.maximum(mean_square, LEAST_SHARE * mean_square.max()))
        gram = gram / scale / scale[:, None]
        gram[np.diag_indices_from(gram)] += 1e-11 * scans  # columns of a constant drive are alike
        weights = np.linalg.solve(gram, along / scale) / scale
        errors = target - weights[-1]
        for part, weight in zip(parts, weights[:-1].reshape(-1, order), strict=True):
            errors -= np.correlate(part, weight, "valid")
        yield errors


def _normal_matrix(parts: Sequence[Array], order: int) -> Array:
    """Return the products, summed over all windows of `order` scans, of the scans of windows of each signal and 1, (k order + 1,) * 2."""
    size, scans = len(parts) * order + 1, parts[0].size - order + 1
    out = np.empty((size, size))
    for i, a in enumerate(parts):
        rows = slice(i * order, (i + 1) * order)
        out[rows, -1] = out[-1, rows] = np.cumsum([a[:scans].sum(), *(a[scans:] - a[: order - 1])])
        for j, b in enumerate(parts[: i + 1]):
            columns = slice(j * order, (j + 1) * order)
            out[rows, columns] = _window_products(a, b, order)
            out[columns, rows] = out[rows, columns].T
    out[-1, -1] = scans
    return out


def _window_products(a: Array, b: Array, order: int) -> Array:
    """Return the products of two signals' windows of `order` scans, summed over all windows, (order, order)."""
    scans = a.size - order + 1
    out = np.empty((order, order))
    out[0] = np.correlate(b, a[:scans], "valid")
    out[:, 0] = out[0] if a is b else np.correlate(a, b[:scans], "valid")
    step = np.multiply.outer(a[scans:], b[scans:]) - np.multiply.outer(a[: order - 1], b[: order - 1])
    for i in range(order - 1):
        out[i + 1, 1:] = out[i, :-1] + step[i]
    return out
