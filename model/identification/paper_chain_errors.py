"""Errors of the paper's chain: all data's errors, shared ones included, carried through all steps.

Every step sets a weighted sum of (predicted - measured) to zero. All steps together are A (h(theta) - y) = 0, so that
d theta = (A dh/d theta)^-1 A dy: one evaluation of the model gives the covariance. `drawn_errors` repeats the whole chain on
redrawn data instead; it holds for large errors and for peaks that change their place too, and takes a thousand times as long.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model.identification.calibration import Estimate
from model.identification.fit_options import FitCancelled
from model.identification.forward_model import Forward
from model.identification.observations import (
    Campaign,
    FrequencyResponse,
    MassResonance,
    MembraneSag,
    StaticLoading,
    VoltageSteps,
    observed,
    redrawn,
)
from model.identification.paper_chain import Chain, ChainError, ChainMethod, chain, measured, vertex
from model.identification.parameters import at, defaults, elongation_of, quantity
from model.parameter_spec import ParameterError

Array = NDArray[np.float64]


def chain_errors(campaign: Campaign, method: ChainMethod, found: Chain) -> tuple[tuple[Estimate, ...], Array]:
    """Estimates with standard errors, and their covariance (E, E), of what `chain` found; SI.

    Raises:
        ParameterError: the method neglects damping; its equations are not those of the model, so use `drawn_errors`.
    """
    if method.damping != "counted":
        raise ParameterError(
            "errors by derivatives need damping counted: take drawn_errors for the paper's literal chain"
        )
    line = ("c_s_0", "c_s_delta")
    names = tuple(n for n in found.values if n not in line)
    base = defaults(found.tactor, found.membrane, method.contact_length) | found.values
    forward = Forward(campaign, (*names, *campaign.common), base, {}, method.amplifier, method.n)
    theta = np.array([*(found.values[n] for n in names), *np.zeros(len(campaign.common))])
    y, spread, h, J, where = _rows(campaign, forward, theta)
    A = np.zeros((len(names), y.size))
    for i, name in enumerate(names):
        _equation(A[i], name, campaign, method, where, y, h, J[:, names.index("k2")] if name == "k2" else y)
    P = len(names)
    M = np.linalg.inv(A @ J[:, :P]) @ A
    shared = J[:, P:] * np.array([e.standard_error for e in campaign.common.values()])
    S = (M * spread**2) @ M.T + (M @ shared) @ (M @ shared).T
    T = _line(names, found, line)
    S = T @ S @ T.T
    every = (*names, *(n for n in line if n in found.values))
    sources = {n: step.runs for step in found.steps for n in step.values}
    errors = np.sqrt(np.diag(S))
    return tuple(
        Estimate(n, found.values[n], float(e), quantity(n).unit, sources[n]) for n, e in zip(every, errors, strict=True)
    ), S


def _rows(campaign: Campaign, forward: Forward, theta: Array) -> tuple[Array, Array, Array, Array, dict[str, slice]]:
    """Measured, error, predicted, slopes (rows, P) of all runs, responses as amplitudes; and where each run is."""
    ys, errors, hs, Js, where, start = [], [], [], [], {}, 0
    for run, got in zip(campaign.runs, forward.predict(theta), strict=True):
        y, error = observed(run)
        h, J = got
        if np.iscomplexobj(y):
            size = np.abs(h)
            y, h, J = np.abs(y), size, (h.conj() * J).real / size
        where[run.label] = slice(start, start + y.size)
        start += y.size
        ys.append(y)
        errors.append(error)
        hs.append(h)
        Js.append(J.T)
    return np.concatenate(ys), np.concatenate(errors), np.concatenate(hs), np.concatenate(Js), where


def _equation(
    a: Array,
    name: str,
    campaign: Campaign,
    method: ChainMethod,
    where: dict[str, slice],
    y: Array,
    h: Array,
    slope: Array,
) -> None:
    """Write into `a` (rows,) what one step weighs each row with."""
    responses = campaign.of(FrequencyResponse)
    free = [r for r in responses if r.elongation_m is None and r.added_mass_kg is None]
    match name:
        case "k2":
            kinds: tuple[list[Any], list[Any]] = (campaign.of(StaticLoading), campaign.of(MassResonance))
            shares = (method.static_weight, 1 - method.static_weight) if all(kinds) else (1.0, 1.0)
            for runs, share in zip(kinds, shares, strict=True):
                rows = [np.arange(where[r.label].start, where[r.label].stop) for r in runs]
                if rows:
                    at_rows = np.concatenate(rows)
                    a[at_rows] = share * slope[at_rows] / (y[at_rows] @ y[at_rows])
        case "mu":
            for r in campaign.of(VoltageSteps):
                a[where[r.label]] = method.amplifier.specimen_v(r.input_v[r.use])
        case "m_add" | "c0":
            part, order = where[free[0].label], np.argsort(free[0].frequency_hz[free[0].use])
            f, A = measured(free[0], False)
            top = int(A.argmax())
            three = slice(top - 1, top + 2)
            a[part.start + order[three]] = _slopes_of_vertex(f[three], A[three])[0 if name == "m_add" else 1]
        case "E_m":
            for sag in campaign.of(MembraneSag):
                part = where[sag.label]
                a[part] = 1 / (part.stop - part.start)
        case _:
            elongation = elongation_of(name)
            (run,) = [r for r in responses if r.elongation_m is not None and at("c_s", r.elongation_m) == name][-1:]
            part, f = where[run.label], run.frequency_hz[run.use]
            inside = np.flatnonzero((f >= 100) & (f <= 250))
            assert elongation is not None
            a[part.start + inside[h[part][inside].argmax()]] = 1.0


def _slopes_of_vertex(f: Array, A: Array) -> Array:
    """(2, 3): slopes of the vertex's frequency and height to the three amplitudes."""
    step = 1e-6 * A.max()
    moves = [np.subtract(vertex(f, A + d), vertex(f, A - d)) / (2 * step) for d in step * np.eye(3)]
    return np.array(moves).T


def _line(names: tuple[str, ...], found: Chain, line: tuple[str, ...]) -> Array:
    """Takes the steps' parameters to themselves and to the line's intercept and slope."""
    extra = [n for n in line if n in found.values]
    T = np.vstack((np.eye(len(names)), np.zeros((len(extra), len(names)))))
    if not extra:
        return T
    delta = {n: (elongation_of(n) or 0.0) / found.membrane.L_m for n in names if elongation_of(n) is not None}
    zero = names.index(at("c_s", 0.0))
    T[len(names), zero] = 1.0
    if len(extra) > 1:
        square = sum(d * d for d in delta.values())
        for n, d in delta.items():
            T[-1, names.index(n)] += d / square
            T[-1, zero] -= d / square
    return T


def drawn_errors(
    campaign: Campaign,
    method: ChainMethod,
    found: Chain,
    draws: int = 100,
    seed: int = 1,
    progress: Callable[[int, int], None] | None = None,
    cancelled: Callable[[], bool] | None = None,
) -> tuple[tuple[Estimate, ...], Array]:
    """As `chain_errors`, from the spread of the whole chain over redrawn data; any method.

    Raises:
        ChainError: more than half of the draws cannot be identified.
        FitCancelled: `cancelled` said so.
    """
    names = tuple(found.values)
    rows = []
    for i in range(draws):
        if cancelled is not None and cancelled():
            raise FitCancelled("the chain's errors were stopped on request")
        try:
            values = chain(redrawn(campaign, np.random.default_rng((seed, i)))[0], method).values
            rows.append([values[n] for n in names])
        except (ChainError, KeyError):
            pass
        if progress is not None:
            progress(i + 1, draws)
    if len(rows) < max(draws / 2, 2):
        raise ChainError(
            f"{draws - len(rows)} of {draws} redrawn campaigns cannot be identified: the data are too noisy"
        )
    S = np.atleast_2d(np.cov(np.array(rows).T))
    sources = {n: step.runs for step in found.steps for n in step.values}
    errors = np.sqrt(np.diag(S))
    return tuple(
        Estimate(n, found.values[n], float(e), quantity(n).unit, sources[n]) for n, e in zip(names, errors, strict=True)
    ), S
