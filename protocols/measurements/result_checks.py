"""Checks of results that several protocols share: signal to noise, drive read back, repeatability, masses on a line."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from model import Array, misfit_factor
from protocols.base import CheckResult, point_quality

SIGNAL_TO_NOISE_LIMIT = 20.0
"""Smallest ratio of a value to its standard error: an error of 5 %, the accuracy of the paper's comparisons. Below 5 there is no
response."""

DRIVE_LIMIT = 0.05
"""Largest relative deviation of the recorded amplitude from the commanded one: the amplifier's gain error and the source's
flatness together are below 2 %."""

COHERENCE_LIMIT = 0.95
"""Smallest coherence in the resonance's half-power width: below it a twentieth of the power does not follow the drive, and six
averages leave an error of 7 %."""

REPEATABILITY_LIMIT = 0.05
"""Largest standard deviation of repeats over their mean: creep and hysteresis of an MFC cause 1 to 3 %."""

MIN_REPEATS = 3
"""Fewest repeats for an estimate of their standard deviation."""

SIGNIFICANCE_SIGMAS = 5.0
"""Standard errors of a significant deviation."""

CABLE_REMEDY = (
    "check the cable from the generator to the amplifier and to the card, and the source's load setting (High Z)"
)
NOISE_REMEDY = "check for vibration or light on the sensor, drive more, or average longer"


def usable_points(points: Sequence[Any]) -> list[Any]:
    """Return the points that fits may use."""
    return [point for point in points if point_quality(point).usable]


def signal_to_noise_check(name: str, pairs: Sequence[tuple[float, float]], detail: str = "") -> tuple[CheckResult, ...]:
    """Return the check of the smallest value over its standard error; none without errors."""
    ratios = [abs(value) / error for value, error in pairs if math.isfinite(value) and error > 0]
    if not ratios:
        return ()
    name = f"signal to noise, {name}"
    return (CheckResult(name, min(ratios), "1", SIGNAL_TO_NOISE_LIMIT, None, NOISE_REMEDY, detail=detail),)


def drive_ratio_check(seen_v: Sequence[float], commanded_v: float) -> tuple[CheckResult, ...]:
    """Return the check of the recorded amplitude that deviates most from the commanded one; none without a recorded amplitude."""
    ratios = [seen / commanded_v for seen in seen_v if math.isfinite(seen)]
    if not ratios:
        return ()
    worst = max(ratios, key=lambda ratio: abs(ratio - 1))
    low, high = 1 - DRIVE_LIMIT, 1 + DRIVE_LIMIT
    return (CheckResult("drive read back / commanded, worst", worst, "1", low, high, CABLE_REMEDY),)


def coherence_check(coherences: Sequence[float]) -> tuple[CheckResult, ...]:
    """Return the check of the lowest coherence; none without coherences."""
    finite = [coherence for coherence in coherences if math.isfinite(coherence)]
    if not finite:
        return ()
    remedy = "check for vibration, a loose clamp or a clipped sensor signal; average more periods"
    return (CheckResult("coherence at the resonance, lowest", min(finite), "1", COHERENCE_LIMIT, None, remedy),)


def repeatability_check(name: str, groups: Sequence[Sequence[float]], remedy: str) -> tuple[CheckResult, ...]:
    """Return the check of the pooled relative scatter of repeats; none with fewer than `MIN_REPEATS` in every group."""
    relative = [
        (float(np.var(group, ddof=1)) / float(np.mean(group)) ** 2, len(group) - 1)
        for group in groups
        if len(group) >= MIN_REPEATS and np.mean(group)
    ]
    if not relative:
        return ()
    pooled = math.sqrt(sum(v * n for v, n in relative) / sum(n for _, n in relative))
    return (CheckResult(f"repeatability, {name}", pooled, "1", None, REPEATABILITY_LIMIT, remedy),)


MIN_OTHER_MASSES = 2
"""Smallest number of other masses that identifies the wrong one: of two that disagree, either may be wrong."""

WEIGHT_DEVIATION_LIMIT = 0.1
"""Largest relative deviation of a weight's mass, by its deflection, from its label. Nonlinearity over the paper's weights is
below 2 %; the next weight of a set differs by a factor of 2."""


def labelled_weight_checks(
    groups: Mapping[float, Mapping[float, Sequence[tuple[float, float]]]],
) -> tuple[CheckResult, ...]:
    """Return the check of the weight whose deflections deviate most from the others of the run.

    A weight's compliance, mean over its repeats, is divided by the median over the other weights of that side; the ratio's mean
    over the sides times the label is the effective mass. Its error is from the scatter of repeats, or the points' own errors if
    these are larger.

    Args:
        groups: by mass (kg), then by side: compliance and its standard error of every repeat.
    """
    by_side: dict[float, dict[float, tuple[float, float]]] = {}
    for mass, sides in groups.items():
        for side, repeats in sides.items():
            if repeats:
                by_side.setdefault(side, {})[mass] = mean_with_error(repeats)
    ratios: dict[float, list[tuple[float, float]]] = {}
    for means in by_side.values():
        for mass, (value, error) in means.items():
            others = [other for each, (other, _) in means.items() if each != mass]
            if len(others) >= MIN_OTHER_MASSES and (middle := float(np.median(others))):
                ratios.setdefault(mass, []).append((value / middle, error / abs(middle)))
    if not ratios:
        return ()
    combined = {
        mass: (float(np.mean([r for r, _ in each])), math.sqrt(sum(e * e for _, e in each)) / len(each))
        for mass, each in ratios.items()
    }
    mass, (ratio, error) = max(combined.items(), key=lambda pair: abs(math.log(max(pair[1][0], 1e-9))))
    limit = max(WEIGHT_DEVIATION_LIMIT, SIGNIFICANCE_SIGMAS * error)
    label = f"weight labelled {1e3 * mass:.6g} g"
    name, remedy = (
        f"{label}, mass by its deflection against the other weights",
        f"weigh the {label}, and measure its points again",
    )
    return (CheckResult(name, ratio * mass, "kg", (1 - limit) * mass, (1 + limit) * mass, remedy),)


MASS_LIMIT_KG = 3e-4
MASS_LIMIT_SHARE = 0.05
"""Largest deviation of an added mass from the line through the others, absolute or as a share of it: the paper's masses are
1 g apart, and the model's line bends by less than 0.01 g."""

MIN_MASSES_ON_LINE = 4
"""Smallest number of masses that identifies the wrong one: of three, any may deviate from the line through the other two."""


def added_mass_checks(
    masses_kg: Sequence[float], frequency_hz: Sequence[float], errors_hz: Sequence[float]
) -> tuple[CheckResult, ...]:
    """Return the check of the added mass that fits the line of 1 / f^2 over mass through the others least.

    Without it the others lie best on a line (least squares), so that one wrong mass is not attributed to another.
    """
    if len(masses_kg) < MIN_MASSES_ON_LINE:
        return ()
    m, f = np.array(masses_kg), np.array(frequency_hz)
    y, error = f**-2.0, 2 * np.array(errors_hz) / f**3
    lines = [_line(np.delete(m, i), np.delete(y, i)) for i in range(m.size)]
    i = min(range(m.size), key=lambda k: lines[k][2])
    slope, start, _ = lines[i]
    if not slope > 0:
        return ()
    apparent, own = float((y[i] - start) / slope), float(error[i] / slope)
    limit = max(MASS_LIMIT_KG, MASS_LIMIT_SHARE * m[i], SIGNIFICANCE_SIGMAS * own)
    label = f"{1e3 * m[i]:.6g} g"
    remedy = f"weigh the added mass of {label} and check that it is fixed, then measure its point again"
    low, high = float(m[i] - limit), float(m[i] + limit)
    return (CheckResult(f"added mass of {label}, by the line through the others", apparent, "kg", low, high, remedy),)


def _line(x: Array, y: Array) -> tuple[float, float, float]:
    """Return slope and intercept of the least-squares line, and the sum of squared residuals."""
    at = x - x.mean()
    slope = float(at @ y / (at @ at))
    start = float(y.mean() - slope * x.mean())
    return slope, start, float(np.sum((y - start - slope * x) ** 2))


def mean_with_error(repeats: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Return the mean of values with standard uncertainties, and its own: of theirs, enlarged if the values scatter significantly."""
    values, errors = np.array(repeats).T
    left = (values - values.mean())[errors > 0] / errors[errors > 0]
    factor = misfit_factor(float(left @ left), left.size - 1)
    return float(values.mean()), factor * math.sqrt(float(errors @ errors)) / values.size


CALIBRATED_LIMITS = 0.8, 1.25
"""Response divided by the response of the specimen's calibration: drift and temperature cause a tenth; the slackest membrane
leaves 0.75 around the resonance."""

PAPER_LIMITS = 0.5, 2.0
"""Response divided by the response of the paper's tactor, for a specimen without a calibration: specimens of one design differ by tens of
per cent; a membrane stretched by 1.3 mm leaves a third."""

RESONANCE_BAND = 0.6, 1.5
"""Range of frequencies, as shares of the reference's resonance, in which a membrane changes the response most."""


def membrane_absent_check(ratios: Sequence[float], calibrated: bool, source: str) -> tuple[CheckResult, ...]:
    """Return the check that a free tactor responds like the reference; none without a point around its resonance."""
    if not ratios:
        return ()
    low, high = CALIBRATED_LIMITS if calibrated else PAPER_LIMITS
    remedy = "make sure that no membrane and nothing else touches the tactor, and that high voltage is on"
    remedy += (
        "; if the specimen has changed, calibrate it again"
        if calibrated
        else "; if the specimen is of another design, identify it and accept the calibration (tactor-bench identify --accept)"
    )
    name = f"response around the resonance / response of the free tactor by {source}"
    return (CheckResult(name, float(np.median(ratios)), "1", low, high, remedy),)


def group_values(points: Sequence[Any], key: Callable[[Any], Any], column: str) -> list[list[float]]:
    """Return the finite values of a column by group."""
    groups: dict[Any, list[float]] = {}
    for point in points:
        value = float(getattr(point, column))
        if math.isfinite(value):
            groups.setdefault(key(point), []).append(value)
    return list(groups.values())
