"""Aspects of the protocol `static-loading`."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from model import GRAVITY, Array, DriveHistory, Mask, SeriesAxis, identification
from protocols import measurements
from protocols.base import (
    DISPLACEMENT_RANGE_M,
    REPEAT_ALIASES,
    Aspects,
    Figure,
    ImportColumn,
    ImportedTable,
    ImportForm,
    ModelState,
    PromptAnswered,
)

if TYPE_CHECKING:
    from model.identification import Observation, SharedError, Side
    from protocols.aspects.run_points import RunPoints

SIDES = {"mfc": 1.0, "mfcup": 1.0, "mfcside": 1.0, "+1": 1.0, "aluminium": -1.0, "aluminum": -1.0, "al": -1.0}
SIDES |= {"aluminiumup": -1.0, "aluminumup": -1.0, "aluminiumside": -1.0}
"""Texts of the column `side`, besides 1 and -1."""

SEEN = "seen by the laser"
SIDE_LABELS: dict[Side, str] = {"mfc": "MFC side", "aluminium": "aluminium side", "both": "both sides"}
MAX_ANSWER_S = 0.5
"""Longest time from the answer to a prompt to the following recording."""


MOMENT_S = 1e-3
"""Assumed time from a zero to the weight, and from the reading to the end of the load, for a table that does not state it."""
TIME_COLUMNS = ("zero_before_time", "placed", "read", "lifted", "zero_after_time")


class StaticLoadingAspects(Aspects):
    """Static loading beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("load", "N", "force on the centre", ("force", "f", "kraft", "weight"), (1e-3, 20.0)),
            ImportColumn("mass", "kg", "mass of the weight on the centre", ("m", "weightmass", "load", "weight"), (1e-4, 2.0), 0.0),
            ImportColumn("deflection", "m", "displacement under the load against no load", ("displacement", "w", "durchbiegung"), DISPLACEMENT_RANGE_M),
            ImportColumn("side", "1", "which side was pushed", ("seite",), codes=SIDES, code_hint="write 'MFC' or 1 where the MFC is up, otherwise 'aluminium' or -1"),
            ImportColumn("repeat", "1", "which repeat", REPEAT_ALIASES),
        ),
        required=(("load", "mass"), ("deflection",)),
        input_uncertainties={"mass": "kg"},
    )  # fmt: skip

    def complete_table(self, table: ImportedTable) -> None:
        values, parameters = table.values, table.parameters
        gravity = float(parameters.get("gravity_m_per_s2", GRAVITY))
        if "load" not in values:
            values["load"] = gravity * values["mass"]
        if "mass_errors" in values:
            if "load_errors" in values:
                raise table.refusal(": the uncertainty of the weights is given twice, for mass and load; omit one")
            values["load_errors"] = gravity * values.pop("mass_errors")
        values.setdefault("mass", values["load"] / gravity)
        if "side" not in values:
            side = {"MFC up": 1.0, "aluminium up": -1.0}.get(str(parameters.get("sides", "")), np.nan)
            values["side"] = np.full(table.rows, side)
            if np.isnan(side):
                table.warnings.append(
                    'no column states which side was loaded: taken as the mean of both (otherwise give --set "sides=MFC up")'
                )

        if {"placed", "read"} <= values.keys():
            values.setdefault("lifted", values["read"] + MOMENT_S)
            zeros = values.setdefault("zero_before_time", values["placed"] - MOMENT_S)
            last = 2 * values["lifted"][-1:] - values["placed"][-1:]
            values.setdefault("zero_after_time", np.concatenate((zeros[1:], last)))

    short_name = "loading"

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield the deflection under a load for each side; the model has one stiffness for both."""
        x, y = SeriesAxis("load", "N", "load at the centre"), SeriesAxis("deflection", "m")
        sides = tuple(
            points.series(x, y, SIDE_LABELS[name], at, deflection) for name, at, deflection in _pushed_sides(points)
        )
        grid = np.linspace(0, 1.05 * float(points.columns["load"].max(initial=0.0)), 40)
        caption = "Static loading, electrodes shorted; positive in the direction of the push; every reading."
        markers = {SIDE_LABELS["mfc"]: "o", SIDE_LABELS["aluminium"]: "s", SIDE_LABELS["both"]: "D"}
        title = "Fig. 4: deflection under a load"
        yield Figure(sides, title, caption, _deflection, grid, from_zero=True, markers=markers)

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        """Yield each side separately; pushing is positive for any sensor sign. An unknown side is the mean of both."""
        columns, good = points.columns, points.good
        history = history_of_loads(points)
        for name, at, deflection in _pushed_sides(points):
            errors = columns["deflection_errors"][at]
            common = points.common_arguments("displacement")
            common["shared_errors"] += _weight_errors(points, good & at, history is not None)
            yield identification.StaticLoadingObservation(
                f"{points.label} {name}",
                columns["load"][at],
                deflection[at],
                errors,
                side=name,
                history=None if history is None else history.take(at),
                good=good[at] & (errors > 0),
                **common,
            )


def _pushed_sides(points: RunPoints) -> Iterator[tuple[Side, Mask, Array]]:
    """Yield each side with usable points: its name, its points, and the deflections of all points, positive in the direction of the push."""
    side, deflection = points.columns["side"], points.columns["deflection"]
    names: tuple[tuple[Side, Mask], ...] = (("mfc", side == 1), ("aluminium", side == -1), ("both", np.isnan(side)))
    for name, at in names:
        if (points.good & at).any():
            yield name, at, (np.sign(np.median(deflection[points.good & at])) or 1.0) * deflection


def _deflection(state: ModelState, load_n: Array) -> Array:
    from model.response import load_compliance  # slow to import

    return np.asarray(
        load_compliance(state.specimen.acting_tactor) * load_n * state.crept(identification.LOADING_TIME_S)
    )


def _weight_errors(points: RunPoints, good: Mask, timed: bool) -> tuple[SharedError, ...]:
    """Return the error of each weight, shared by all repeats, both sides and all runs with it; `timed`: the run has the history of its loads."""
    load, mass = points.columns["load"], points.columns["mass"]
    grams = 1e3 * load / GRAVITY if np.isnan(mass).any() else 1e3 * mass
    errors = []
    for error in points.input_errors("load", "load", good & (load > 0), "{}"):
        weight = float(grams[load == error.at][0])
        label = f"weight of {weight:.6g} g (load {error.at:.9g} N, uncertainty {100 * error.standard_error:.6g} %)"
        errors.append(replace(error, name=label))
        crept = _crept_while_placing(points, points.good & (load == error.at)) if timed else 0.0
        if crept > 0:
            name = f"{points.label}, time of putting on {weight:.6g} g"
            errors.append(replace(error, name=name, standard_error=crept))
    return tuple(errors)


def _crept_while_placing(points: RunPoints, rows: Mask) -> float:
    """Return the creep under a weight within the uncertainty of the time at which it was put on, as a share of the deflection."""
    slope = points.columns.get("creep")
    if slope is None:
        return 0.0
    share = np.abs(slope[rows] / points.columns["deflection"][rows]) * measurements.PLACING_S
    return float(np.median(share)) if np.isfinite(share).all() else 0.0


def history_of_loads(points: RunPoints) -> DriveHistory | None:
    """Return the history of the loads; None if the file has neither recordings nor times of all of them."""
    load, columns = points.columns["load"], points.columns
    times = _recorded_times(points)
    if times is None:  # an import
        times = np.array([columns.get(name, np.full(load.size, np.nan)) for name in TIME_COLUMNS])
    if points.run.resumed_from is not None or not np.isfinite((*times, load)).all():
        return None
    zero_before, placed, read, lifted, zero_after = times
    load, none = np.where(columns["side"] < 0, -load, load), np.zeros(load.size)  # in the direction of bending
    return DriveHistory.of_points(
        np.stack((placed, placed, lifted, lifted), axis=1),
        np.stack((none, load, load, none), axis=1),
        placed,
        read,
        np.stack((zero_before, zero_after), axis=1),
    )


def _recorded_times(points: RunPoints) -> Array | None:
    """Return the times of `TIME_COLUMNS` from the recordings, (5, F); None if a point has fewer than three.

    A recording follows a weight detected by the laser by the hand's movement and the `record_s` of quiet samples. For a weight confirmed by a key, the
    time is halfway since the previous recording.
    """
    recordings = points.recording_times(3)
    if recordings is None:
        return None
    protocol = points.read_protocol()
    assert isinstance(protocol, measurements.StaticLoading)
    half, quiet_s = protocol.record_s / 2, protocol.record_s + measurements.PLACING_S
    answers = points.run.events(PromptAnswered.kind)
    seen_s = [answer.time_s for answer in answers if answer.fields.get("words") == SEEN]
    begins, ends = recordings[:, 1:, 0], recordings[:, :-1, 1]
    seen = np.abs(begins[..., None] - np.array([*seen_s, -np.inf])).min(axis=-1) < MAX_ANSWER_S
    placed, lifted = np.where(seen, np.maximum(begins - quiet_s, ends), (begins + ends) / 2).T
    zero_before, read, zero_after = (recordings[:, i, 1] - half for i in range(3))
    return np.array([zero_before, placed, read, lifted, zero_after])


ASPECTS = StaticLoadingAspects()
