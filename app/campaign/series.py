"""Series of a campaign: one item that repeats a protocol for each value of one of its parameters, with its results as curves."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from app.archive import RunSummary
from app.campaign.plan import CampaignItem
from app.campaign.status import HAS_VALID_RUN, Basis, ItemState, ItemStatus, NextAction, evaluate_item
from app.common import UnitError, field_label, read_numbers, unit_of
from model import Array, format_with_uncertainty, shown_unit
from protocols import PROTOCOLS
from protocols.aspects import ONE_TEMPERATURE_K
from protocols.base import EstimatedQuantity, Protocol, RunFigure, Series, SeriesAxis
from protocols.signals import weighted_fit

SERIES = "series"
AIR_TEMPERATURE = "air_temperature_c"


def evaluate_series(
    folder: Path,
    item: CampaignItem,
    title: str,
    runs: Sequence[RunSummary],
    previous: Mapping[str, ItemState],
    based_on: Mapping[str, Basis],
) -> ItemState:
    """Return the state of a series from the states of its values: it is done when all of them are.

    Arguments as in `evaluate_items`, for one item.
    """
    steps = tuple(
        evaluate_item(
            folder,
            step,
            title,
            [run for run in runs if run.requested_parameters.get(item.varied) == value],
            previous,
            based_on,
        )
        for step, value in zip(item.steps, item.values, strict=True)
    )
    measured = [step for step in steps if step.status in HAS_VALID_RUN]
    following = next((step for step in steps if step.is_ready), None)
    newest = max(measured, key=lambda step: step.started_at, default=None)
    running = next((run.name for run in reversed(runs) if run.running), "")
    status, reason, do = _series_status(item, steps, running, following)
    run, started_at = (None, "") if newest is None else (newest.run, newest.started_at)
    resumed, step = (None, None) if following is None else (following.resumed_run, following.item)
    return ItemState(
        item,
        title,
        status,
        reason,
        do,
        run,
        started_at,
        tuple(_named_estimates(item, measured)),
        resumed,
        next((step.candidate for step in steps if step.candidate is not None), None),
        tuple(sorted((run for step in steps for run in step.results), key=lambda run: (run.start_time, run.name))),
        None if do is NextAction.WAIT else step,
        steps,
    )


def _series_status(
    item: CampaignItem, steps: Sequence[ItemState], running: str, following: ItemState | None
) -> tuple[ItemStatus, str, NextAction]:
    """Return status, reason and next action of a series; `running` names the run that is being written, `following` the value that is next."""
    missing = [step for step in steps if step.status not in HAS_VALID_RUN]
    count = f"{len(steps) - len(missing)} of {len(steps)} values"
    if item.skipped:
        return ItemStatus.SKIPPED, item.skipped, NextAction.NONE
    if running:
        return ItemStatus.RUNNING, f"{running} is being written; {count}", NextAction.WAIT
    if following is None and missing:
        return missing[0].status, f"{count}; {missing[0].reason}", NextAction.WAIT
    if following is None:
        return ItemStatus.DONE, f"{count} of {varied_label(item)}", NextAction.NONE
    unfinished = ItemStatus.UNFINISHED if following.next_action is NextAction.RESUME else following.status
    reason = f"{count}; next {value_text(item, _value_of(item, following))}: {following.reason}"
    return unfinished if missing else ItemStatus.STALE, reason, following.next_action


def series_curves(state: ItemState) -> tuple[Series, ...]:
    """Return each figure of the runs of a series over the varied parameter, with its standard errors; the first figure is the last curve.

    Values without a result, and figures of fewer than two values, are left out. A series over temperatures is over the measured ones,
    and the label of each curve has its coefficient.
    """
    item, figures = state.item, dict[tuple[str, str], list[tuple[float, float, RunFigure]]]()
    for step in state.steps:
        summary = next((run for run in step.results if step.run is not None and run.name == step.run.name), None)
        if step.status in HAS_VALID_RUN and summary is not None:
            at, error = _abscissa(item, step, summary)
            for figure in summary.figures:
                figures.setdefault((figure.name, figure.unit), []).append((at, error, figure))
    curves = []
    for (name, unit), pairs in figures.items():
        if len(pairs) < 2:
            continue
        pairs.sort(key=lambda pair: pair[0])
        x, x_errors, y, errors, totals = (
            np.array(column, float)
            for column in zip(
                *((value, error, f.value, f.statistical, f.total) for value, error, f in pairs), strict=True
            )
        )
        axes = (
            SeriesAxis(item.varied, varied_unit(item), "varied parameter"),
            SeriesAxis(name, unit, "figure of the run"),
        )
        curve = Series(x, y, errors, totals, x_axis=axes[0], y_axis=axes[1], name=SERIES)
        if item.varied == AIR_TEMPERATURE and not name.startswith("air_"):
            coefficient = temperature_coefficient(curve, x_errors)
            curve = replace(curve, label="" if coefficient is None else coefficient_text(coefficient))
        curves.append(curve)
    return tuple(reversed(curves))


def _abscissa(item: CampaignItem, step: ItemState, summary: RunSummary) -> tuple[float, float]:
    """Return the value of a run in its series and its standard uncertainty: of a series over temperatures, the measured ones."""
    record = summary.record
    if item.varied != AIR_TEMPERATURE or record.conditions.temperature_c is None:
        return _value_of(item, step), 0.0
    errors = [each.standard_error for each in record.estimates if each.name == "air_temperature"]
    return record.conditions.temperature_c, errors[0] if errors else 0.0


def temperature_coefficient(curve: Series, x_errors: Array) -> RunFigure | None:
    """Return the relative change of a figure per kelvin at the mean temperature, by a weighted line through its values.

    Its statistical uncertainty is of the values' errors, or of their scatter about the line if that is larger; the total one also of the
    temperatures' errors `x_errors`, (N,), as independent. A factor common to all values, such as the sensor's gain, cancels. None for fewer
    than two different temperatures, and without errors.
    """
    x, y, errors = curve.x - curve.x.mean(), curve.y.real, curve.errors
    if errors is None or not (errors > 0).all() or np.ptp(x) < ONE_TEMPERATURE_K or not np.isfinite(y).all():
        return None
    columns = x, np.ones(x.size)
    (slope, at_mean), by_noise = weighted_fit(columns, y, 1 / errors)
    _, with_temperatures = weighted_fit(columns, y, 1 / np.hypot(errors, slope * x_errors))
    variances = np.array([by_noise[0, 0], max(with_temperatures[0, 0], by_noise[0, 0])])
    noise, total = np.sqrt(variances) / abs(at_mean)
    return RunFigure(curve.y_axis.name, slope / at_mean, noise, total, "1/K")


def coefficient_text(coefficient: RunFigure) -> str:
    """Return a temperature coefficient with both uncertainties as text."""
    value, *errors = (100 * each for each in (coefficient.value, coefficient.statistical, coefficient.total))
    by_noise, in_total = (format_with_uncertainty(value, error) for error in errors)
    return f"{by_noise} % per kelvin by noise, {in_total} in total"


def varied_unit(item: CampaignItem) -> str:
    """Return the unit of the varied parameter; `1` for none."""
    kind = PROTOCOLS.get(item.protocol)
    return (unit_of(kind, item.varied) if kind is not None and item.varied in kind.model_fields else None) or "1"


def series_parameters(kind: type[Protocol]) -> tuple[str, ...]:
    """Return the parameters of a protocol that a series can vary: single numbers."""
    return tuple(
        name for name, field in kind.model_fields.items() if field.annotation in (float, int) and unit_of(kind, name)
    )


def read_series_values(
    kind: type[Protocol], name: str, text: str, shown: tuple[float, str] = (1.0, "")
) -> tuple[float, ...]:
    """Return the values of a series from a list with ranges; `shown`: factor from SI to the unit of numbers without one, and that unit.

    Raises:
        UnitError: the text cannot be read, or has fewer than two different values.
    """
    values = read_numbers(text, unit_of(kind, name) or "1", shown)
    if len(values) < 2 or len(set(values)) < len(values):
        raise UnitError("give at least two values, each once")
    whole = kind.model_fields[name].annotation is int
    return tuple(int(value) if whole and value.is_integer() else value for value in values)


def value_text(item: CampaignItem, value: float) -> str:
    """Return a value of the varied parameter as text."""
    factor, unit = shown_unit(varied_unit(item))
    return f"{varied_label(item)} {factor * value:.6g} {unit}".rstrip()


def varied_label(item: CampaignItem) -> str:
    """Return the varied parameter in words."""
    kind = PROTOCOLS.get(item.protocol)
    return item.varied if kind is None else field_label(kind, item.varied)


def _value_of(item: CampaignItem, step: ItemState) -> float:
    return float(step.item.settings[item.varied])


def _named_estimates(item: CampaignItem, steps: Sequence[ItemState]) -> list[EstimatedQuantity]:
    return [
        replace(estimate, name=f"{estimate.name}, at {value_text(item, _value_of(item, step))}")
        for step in steps
        for estimate in step.estimates
    ]


def evaluate_items(
    folder: Path,
    items: Sequence[CampaignItem],
    titles: Mapping[str, str],
    runs: Mapping[str, Sequence[RunSummary]],
    based_on: Mapping[str, Basis],
) -> tuple[ItemState, ...]:
    """Return the state of every item, in order.

    Args:
        folder: of the runs.
        items: of the campaign; each after its dependencies.
        titles: of the protocols, by their names.
        runs: of each item by its name, oldest first.
        based_on: basis of each run by file name; none for runs made outside the campaign.
    """
    states: dict[str, ItemState] = {}
    for item in items:
        title = titles.get(item.protocol, item.protocol)
        evaluate = evaluate_series if item.varied else evaluate_item
        states[item.name] = evaluate(folder, item, title, runs.get(item.name, ()), states, based_on)
    return tuple(states.values())
