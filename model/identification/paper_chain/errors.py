"""Errors of the paper's chain: all data's errors, shared ones included, carried through all steps.

Every step sets a weighted sum of (predicted - measured) to zero. All steps together are A (h(theta) - y) = 0, so that
d theta = (A dh/d theta)^-1 A dy: one evaluation of the model gives the covariance.
"""

from typing import Any

import numpy as np

from model import Array, EstimatedQuantity, ParameterError
from model.identification import observations as observed
from model.identification.forward_model import ForwardModel, modulus_prediction
from model.identification.paper_chain import chain
from model.identification.parameters import default_values, elongation_parameter, parameter_spec, parse_elongation


def linearized_errors(
    observations: observed.ObservationSet, options: chain.PaperChainOptions, result: chain.PaperChainResult
) -> tuple[tuple[EstimatedQuantity, ...], Array]:
    """Estimates with standard errors, and their covariance (E, E), of the result of `identify_by_paper_chain`; SI.

    Raises:
        ParameterError: the method neglects damping; its equations differ from the model's.
    """
    if options.damping != "counted":
        raise ParameterError("errors by derivatives need damping counted: set damping to 'counted'")
    line = ("c_s_0", "c_s_delta")
    names = tuple(n for n in result.values if n not in line)
    base = default_values(result.tactor, result.membrane, options.contact_length) | result.values
    forward = ForwardModel(observations, (*names, *observations.shared_errors), base, {}, options.amplifier, options.n)
    theta = np.array([*(result.values[n] for n in names), *np.zeros(len(observations.shared_errors))])
    y, spread, h, J, where = _linearize(observations, forward, theta)
    A = np.zeros((len(names), y.size))
    for i, name in enumerate(names):
        _write_step_weights(
            A[i], name, observations, options, where, y, h, J[:, names.index("k2")] if name == "k2" else y
        )
    P = len(names)
    M = np.linalg.inv(A @ J[:, :P]) @ A
    shared = J[:, P:] * np.array([e.standard_error for e in observations.shared_errors.values()])
    S = (M * spread**2) @ M.T + (M @ shared) @ (M @ shared).T
    T = _line_transform(names, result, line)
    S = T @ S @ T.T
    every = (*names, *(n for n in line if n in result.values))
    return _estimates(every, S, result), S


def _estimates(names: tuple[str, ...], S: Array, result: chain.PaperChainResult) -> tuple[EstimatedQuantity, ...]:
    """The chain's values by name with the standard errors of their covariance S."""
    sources = {n: step.runs for step in result.steps for n in step.values}
    return tuple(
        EstimatedQuantity(n, result.values[n], float(e), parameter_spec(n).unit, sources[n])
        for n, e in zip(names, np.sqrt(np.diag(S)), strict=True)
    )


def _linearize(
    campaign: observed.ObservationSet, forward: ForwardModel, theta: Array
) -> tuple[Array, Array, Array, Array, dict[str, slice]]:
    """Measured, error, predicted, slopes (rows, P) of all runs, responses as amplitudes; and the slice of each run."""
    ys, errors, hs, Js, where, start = [], [], [], [], {}, 0
    for run, got in zip(campaign.runs, forward.predict(theta), strict=True):
        y, error = observed.observed_values(run)
        h, J = got
        if np.iscomplexobj(y):
            y, (h, J) = np.abs(y), modulus_prediction(h, J)
        where[run.label] = slice(start, start + y.size)
        start += y.size
        ys.append(y)
        errors.append(error)
        hs.append(h)
        Js.append(J.T)
    return np.concatenate(ys), np.concatenate(errors), np.concatenate(hs), np.concatenate(Js), where


def _write_step_weights(
    a: Array,
    name: str,
    campaign: observed.ObservationSet,
    method: chain.PaperChainOptions,
    where: dict[str, slice],
    y: Array,
    h: Array,
    slope: Array,
) -> None:
    """Write the weights of one step into `a` (rows,)."""
    responses = campaign.of_type(observed.FrequencyResponseObservation)
    free = [r for r in responses if r.elongation_m is None and r.added_mass_kg is None]
    match name:
        case "k2":
            kinds: tuple[list[Any], list[Any]] = (
                campaign.of_type(observed.StaticLoadingObservation),
                campaign.of_type(observed.MassResonanceObservation),
            )
            shares = (method.static_weight, 1 - method.static_weight) if all(kinds) else (1.0, 1.0)
            for runs, share in zip(kinds, shares, strict=True):
                rows = [np.arange(where[r.label].start, where[r.label].stop) for r in runs]
                if rows:
                    at_rows = np.concatenate(rows)
                    a[at_rows] = share * slope[at_rows] / (y[at_rows] @ y[at_rows])
        case "mu":
            for r in campaign.of_type(observed.VoltageStepsObservation):
                a[where[r.label]] = method.amplifier.specimen_v(r.input_v[r.usable])
        case "m_add" | "c0":
            part, order = where[free[0].label], np.argsort(free[0].frequency_hz[free[0].usable])
            f, A = chain.measured_amplitudes(free[0], False)
            top = int(A.argmax())
            three = slice(top - 1, top + 2)
            a[part.start + order[three]] = _vertex_derivatives(f[three], A[three])[0 if name == "m_add" else 1]
        case "E_m":
            for sag in campaign.of_type(observed.MembraneSagObservation):
                part = where[sag.label]
                a[part] = 1 / (part.stop - part.start)
        case _:
            elongation = parse_elongation(name)
            (run,) = [
                r
                for r in responses
                if r.elongation_m is not None and elongation_parameter("c_s", r.elongation_m) == name
            ][-1:]
            part, f = where[run.label], run.frequency_hz[run.usable]
            inside = np.flatnonzero((f >= 100) & (f <= 250))
            assert elongation is not None
            a[part.start + inside[h[part][inside].argmax()]] = 1.0


def _vertex_derivatives(f: Array, A: Array) -> Array:
    """(2, 3): slopes of the vertex's frequency and height to the three amplitudes."""
    step = 1e-6 * A.max()
    moves = [
        np.subtract(chain.parabola_vertex(f, A + d), chain.parabola_vertex(f, A - d)) / (2 * step)
        for d in step * np.eye(3)
    ]
    return np.array(moves).T


def _line_transform(names: tuple[str, ...], result: chain.PaperChainResult, line: tuple[str, ...]) -> Array:
    """Matrix from the steps' parameters to the same parameters and the line's intercept and slope."""
    extra = [n for n in line if n in result.values]
    T = np.vstack((np.eye(len(names)), np.zeros((len(extra), len(names)))))
    if not extra:
        return T
    delta = {n: (parse_elongation(n) or 0.0) / result.membrane.L_m for n in names if parse_elongation(n) is not None}
    zero = names.index(elongation_parameter("c_s", 0.0))
    T[len(names), zero] = 1.0
    if len(extra) > 1:
        square = sum(d * d for d in delta.values())
        for n, d in delta.items():
            T[-1, names.index(n)] += d / square
            T[-1, zero] -= d / square
    return T
