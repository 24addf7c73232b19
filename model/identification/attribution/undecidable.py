"""Errors that a set of runs cannot show because the fit absorbs them, and the independent measurement that can."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from model.identification.attribution.evidence import Evidence
from model.identification.nonidealities import DEFAULTS as NONIDEAL_DEFAULTS

UNSEEN_ERROR = 0.1
"""Standard error of a relative scale error above which these runs do not show it."""
MIN_MOVE = 0.2
"""Relative change of a parameter, divided by the change of the scale, above which the parameter is named."""

CHECKS = {
    "sensor_gain": (
        "the scale of the displacements",
        "moving the sensor by a micrometer or a gauge block, or loads together with masses fixed at the centre,",
    ),
    "load_gain": (
        "the scale of the loads or a clamp that gives under them",
        "weighing one of the weights on another balance",
    ),
    "mass_fraction": (
        "the share of the added masses that acts",
        "a static loading with known weights, or weighing the masses and fixing them at the centre,",
    ),
}
"""Scale errors: affected quantity, and the measurement that can show it."""
VOLTS = "the volts on the specimen", "measuring them at the amplifier's output with a probe of known ratio"


@dataclass(frozen=True)
class UndecidableError:
    """A scale error that the runs cannot show."""

    name: str
    moves: Mapping[str, float]
    """Relative change of each parameter divided by the scale's."""
    text: str


def undecidable_errors(evidence: Evidence) -> tuple[UndecidableError, ...]:
    """Return the scale errors that the fit absorbs."""
    return tuple(_found(evidence))


def _found(evidence: Evidence) -> Iterator[UndecidableError]:
    fit = evidence.fit
    data = fit.run_slices[-1].stop
    scale = fit.parameter_scale
    J = fit.jacobian[:data] * scale
    own = [i for i, name in enumerate(fit.names) if name in fit.free_parameters]
    scales = {c.name: (c, size) for c in evidence.causes if c.kind == "parameter" for _, size in c.parameters.values()}
    for name, (quantity, remedy) in CHECKS.items():
        if name not in scales:
            continue
        cause, size = scales[name]
        d = evidence.effect(cause)[:data, 0] / size
        shares = np.linalg.lstsq(J[:, own], d, rcond=1e-7)[0]
        rest = d - J[:, own] @ shares
        if not np.any(d) or float(rest @ rest) * UNSEEN_ERROR**2 > 1:
            continue
        moves = {fit.names[i]: float(-s * scale[i] / fit.theta[i]) for i, s in zip(own, shares, strict=True)}
        yield _undecidable(name, quantity, remedy, moves)
    if "mu" in fit.free_parameters:
        yield _undecidable("volts", *VOLTS, {"mu": -1.0})


def _undecidable(name: str, quantity: str, remedy: str, moves: Mapping[str, float]) -> UndecidableError:
    # A relative change of a value near zero has no meaning.
    named = {n: m for n, m in moves.items() if abs(m) > MIN_MOVE and NONIDEAL_DEFAULTS.get(n) != 0.0}
    text = ", ".join(f"{n} by {abs(m):.2g} %" for n, m in named.items())
    moved = f": 1 % would move {text}" if text else ""
    return UndecidableError(name, named, f"these runs cannot show an error of {quantity}{moved}; {remedy} would")
