"""Model discrepancies: possible differences between specimen and model, as additions to the predictions.

A discrepancy is a direction in the space of all weighted residuals, scaled so that its size is a meaningful share: of the
deflection, of the frequency, of the loop. `adequacy` estimates how much of each is in the residuals.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from model import Array, format_with_uncertainty
from model.identification import observations as observed
from model.identification.fit_result import JointFit
from model.identification.residuals import LeastSquaresProblem

WORD_PAIR = re.compile(r"<([^<>|]*)\|([^<>|]*)>")


@dataclass(frozen=True)
class Discrepancy:
    """One possible difference; `direction` (rows,) is the addition of one hundred percent of it to the residuals."""

    kind: str
    """Kind: gain, bend, loop, creep, tuning, lag, damping, amplitude, drift or clamp."""
    runs: tuple[str, ...]
    description: str
    """Meaning, with {} for its size in percent and error, and <one|other> for texts of a positive and a negative size."""
    direction: Array

    def describe(self, size: float, error: float) -> str:
        """Return the meaning of a discrepancy of this size; the text expresses the sign, the number has none."""
        template = WORD_PAIR.sub(lambda pair: pair[1 if size >= 0 else 2], self.description)
        return template.format(format_with_uncertainty(100 * abs(size), 100 * error))


def possible_discrepancies(fit: JointFit) -> tuple[Discrepancy, ...]:
    """Return every discrepancy that the runs of this fit can show."""
    labels = [run.label for run in fit.observations.runs]
    place = dict(zip(labels, fit.run_slices, strict=True))
    predictions = fit.problem.forward_model.predict(fit.theta)
    y = {label: p.values for label, p in zip(labels, predictions, strict=True)}

    def direction(parts: dict[str, Any]) -> Array:
        d = np.zeros(fit.weighted_residuals.size)
        for run in fit.observations.runs:
            if run.label in parts:
                complex_run = np.iscomplexobj(observed.observed_values(run)[0])
                d[place[run.label]] = observed.over_errors(
                    run, parts[run.label] if complex_run else np.real(parts[run.label])
                )
        return d

    discrepancies = (*_run_discrepancies(fit, y), *_dwell_discrepancies(fit, y))
    return tuple(Discrepancy(kind, tuple(parts), message, direction(parts)) for kind, message, parts in discrepancies)


def clamp_discrepancy(fit: JointFit, effect: Array) -> Discrepancy:
    """Return the discrepancy of a clamp that rotates, from the effect of its flexibility on the weighted residuals."""
    runs = [run.label for run, part in zip(fit.observations.runs, fit.run_slices, strict=True) if np.any(effect[part])]
    description = "the clamp <turns by|holds more than rigidly, by> {} % of what the bare plate bends: it is not <rigid|the model's>"
    return Discrepancy("clamp", tuple(runs), description, effect)


DiscrepancyParts = tuple[str, str, dict[str, Any]]


def _run_discrepancies(fit: JointFit, y: dict[str, Any]) -> Iterator[DiscrepancyParts]:
    tuned = _frequency_stretch_derivatives(fit)
    others = "the other runs state" if len(fit.observations.runs) > 1 else "the parameters that are held allow"
    for run in fit.observations.runs:
        p = y[run.label]
        match run:
            case observed.StaticLoadingObservation():
                load = np.abs(run.load_n[run.usable])
                yield "gain", f"{run.label} deflects {{}} % <more|less> than {others}", {run.label: p}
                if np.ptp(load) > 0:
                    message = (
                        f"{run.label} is {{}} % <softer|stiffer> at its largest load than at none: it is not linear"
                    )
                    yield "bend", message, {run.label: p * load / load.max()}
            case observed.MassResonanceObservation():
                yield "gain", f"{run.label} resonates {{}} % <higher|lower> than {others}", {run.label: p}
                mass = run.mass_kg[run.usable]
                if np.ptp(mass) > 0:
                    message = (
                        f"{run.label} is {{}} % <stiffer|softer> in frequency with its largest mass than with its least"
                    )
                    yield "bend", message, {run.label: p * (mass - mass.min()) / np.ptp(mass)}
            case observed.VoltageStepsObservation():
                yield from _voltage_step_discrepancies(
                    run, p, others, fit.problem.forward_model.nonideal.loop_share(run)
                )
            case observed.DecayPoleObservation():
                yield "gain", f"{run.label} rings {{}} % <higher|lower> than {others}", {run.label: p}
                damped = f"{run.label} is damped by {{}} % of the critical damping <more|less> than {others}"
                yield "damping", damped, {run.label: 1j * p / np.sqrt(1 - (p.real / np.abs(p)) ** 2)}
            case observed.FrequencyResponseObservation():
                yield "gain", f"{run.label} vibrates {{}} % <more|less> than {others}", {run.label: p}
                yield (
                    "tuning",
                    f"{run.label} is tuned {{}} % <higher|lower> than the model",
                    {run.label: tuned[run.label]},
                )
                if np.iscomplexobj(p):
                    message = f"{run.label} <lags|leads> the model by {{}} % of a radian"
                    yield "lag", message, {run.label: -1j * p}
            case observed.MembraneSagObservation():
                pass


def _voltage_step_discrepancies(
    run: observed.VoltageStepsObservation, p: Array, others: str, loop: Array
) -> Iterator[DiscrepancyParts]:
    yield "gain", f"{run.label} deflect {{}} % <more|less> than {others}", {run.label: p}
    share = np.abs(p) / np.abs(p).max() if np.any(p) else np.zeros_like(p)
    if np.ptp(share) > 0:
        message = (
            f"{run.label} gain {{}} % <more|less> a volt at the largest deflection than near rest: it is not linear"
        )
        yield "bend", message, {run.label: p * share}
    if run.rising is not None and 0 < run.rising[run.usable].sum() < run.usable.sum():
        message = f"{run.label}: {{}} % of the deflection at full drive comes <late|early>: hysteresis"
        yield "loop", message, {run.label: np.abs(p).max() * loop}
    if run.time_s is not None and np.ptp(run.time_s[run.usable]) > 0:
        decades = np.log10(np.maximum(run.time_s[run.usable], 1e-6))
        yield (
            "creep",
            f"{run.label} creep <on|back> by {{}} % a decade of time",
            {run.label: p * (decades - decades.mean())},
        )


def _dwell_discrepancies(fit: JointFit, y: dict[str, Any]) -> Iterator[DiscrepancyParts]:
    """Yield discrepancies that only several runs together show."""
    dwells = fit.observations.of_type(observed.FrequencyResponseObservation)
    with_phase = [r for r in dwells if np.iscomplexobj(y[r.label])]
    spread = [r for r in with_phase if np.ptp(r.frequency_hz[r.usable]) > 0]
    if spread:
        # creep in log time: a compliance that falls with log frequency has a constant loss angle
        late = {
            r.label: -y[r.label] * (np.log10(r.frequency_hz[r.usable] / 100) + 1j * np.pi / 2 / np.log(10))
            for r in spread
        }
        yield "creep", "the dwells <lose|gain> {} % a decade of frequency, with the lag that belongs to it: creep", late
    drives = {r.label: np.asarray(r.drive_amplitude_v)[r.usable] for r in with_phase}
    yield from _amplitude_discrepancies(drives, y)
    yield from _drift_discrepancies([r for r in dwells if r.order is not None], y)


def _amplitude_discrepancies(drives: dict[str, Array], y: dict[str, Any]) -> Iterator[DiscrepancyParts]:
    """Yield the discrepancies of dwells with different drives, by the amplitudes at their points."""
    every = np.concatenate([*drives.values(), np.zeros(0)])
    if not every.size or np.ptp(every) <= 0.1 * every.max():
        return
    share = {label: (a - every.mean()) / every.max() for label, a in drives.items()}
    message = "at full drive the dwells give {} % <more|less> a volt than at none: the response is not linear"
    yield "amplitude", message, {label: y[label] * s for label, s in share.items()}
    message = "at full drive the dwells lag {} % of a radian <more|less> than at none: hysteresis"
    yield "amplitude", message, {label: -1j * y[label] * s for label, s in share.items()}


def _drift_discrepancies(
    dwells: list[observed.FrequencyResponseObservation], y: dict[str, Any]
) -> Iterator[DiscrepancyParts]:
    """Yield the discrepancies of dwells in a known order."""
    ordered = sorted(dwells, key=lambda r: float(r.order or 0))
    if len(ordered) > 1 and ordered[0].order != ordered[-1].order:
        first, last = float(ordered[0].order or 0), float(ordered[-1].order or 0)
        parts = {r.label: y[r.label] * ((float(r.order or 0) - first) / (last - first) - 0.5) for r in ordered}
        yield "drift", "the dwells <grew|shrank> by {} % from the first to the last", parts
    for a, b in _repeated_settings(ordered):
        message = f"{b.label} vibrates {{}} % <more|less> than {a.label}, the same setting before it"
        yield "drift", message, {a.label: -y[a.label] / 2, b.label: y[b.label] / 2}


def _repeated_settings(
    ordered: list[observed.FrequencyResponseObservation],
) -> Iterator[tuple[observed.FrequencyResponseObservation, observed.FrequencyResponseObservation]]:
    """Return the first and the last dwell of each repeated setting."""
    settings: dict[Any, list[observed.FrequencyResponseObservation]] = {}
    for r in ordered:
        drive = float(np.round(np.mean(r.drive_amplitude_v), 2))
        settings.setdefault((r.elongation_m, r.added_mass_kg, drive), []).append(r)
    for same in settings.values():
        if len(same) > 1:
            yield same[0], same[-1]


def _frequency_stretch_derivatives(fit: JointFit) -> dict[str, Any]:
    """Return the slope of each dwell's prediction to a stretch of the frequency axis: a resonance a hundred percent higher."""
    step = 1e-4
    dwells = fit.observations.of_type(observed.FrequencyResponseObservation)
    if not dwells:
        return {}
    ends = []
    for factor in (1 - step, 1 + step):
        moved = observed.ObservationSet(tuple(replace(run, frequency_hz=run.frequency_hz * factor) for run in dwells))
        problem = LeastSquaresProblem(moved, replace(fit.options, free=fit.free_parameters))
        theta = np.array([fit.theta[fit.names.index(n)] for n in problem.names])
        ends.append([p.values for p in problem.forward_model.predict(theta)])
    return {run.label: (low - high) / (2 * step) for run, low, high in zip(dwells, *ends, strict=True)}
