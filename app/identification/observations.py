"""Observations for an identification: the points of run files, by protocol.

Flagged points are kept but not usable. The gain error of a sensor is shared by all its values; it is named by the serial
number, so that runs with the same sensor share it and runs with different sensors do not.
"""

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any, cast

import numpy as np

from model import AmplifierMap, Array, Mask, ParameterError
from model.identification import (
    FitOptions,
    FrequencyResponseObservation,
    MassResonanceObservation,
    MembraneSagObservation,
    Observation,
    ObservationSet,
    SharedError,
    Side,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from protocols.base import usable_mask
from protocols.measurements.membrane_sag import MembraneSag as SagProtocol
from protocols.resume import protocol_of_run
from protocols.runfile.reader import Run, RunReadError, translate_read_errors

CARD_READBACK_MARGIN_V = 0.02
"""How far a recorded drive may lie beyond the amplifier's range."""

DEFAULT_SHAPE_COUNT = 20
"""Shape functions for a real tactor; for a simulated one, the number of the simulation."""

Columns = dict[str, Array]


class ObservationError(Exception):
    """Runs cannot be identified together; the message gives runs and reason."""


def read_observations(
    paths: Iterable[Path], open_run: Callable[[Path], Run] = Run
) -> tuple[str, ObservationSet, list[str]]:
    """Return the specimen, its observations, and a message for each run without any; `open_run` may correct a run.

    Raises:
        ObservationError: a file is not a run, the runs are of several specimens, or no point is usable.
    """
    specimens: dict[str, Path] = {}
    found: list[Observation] = []
    left_out: list[str] = []
    for path in paths:
        try:
            with open_run(path) as run:
                specimens.setdefault(run.specimen, path)
                taken = _read_run_observations(run)
        except ParameterError as error:
            raise ObservationError(f"{path}: {error}") from error
        except RunReadError as error:
            raise ObservationError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
        usable = [run for run in taken if run.usable.any()]
        found += usable
        if not usable:
            left_out.append(f"{path.name} tells nothing about the model and is left out")
    if len(specimens) > 1:
        names = " and ".join(f"{name!r} ({path.name})" for name, path in specimens.items())
        raise ObservationError(f"these runs are of several specimens, {names}: identify one at a time")
    if not found:
        raise ObservationError("none of these runs has a usable point that tells about the model")
    try:
        return next(iter(specimens)), ObservationSet(tuple(found)), left_out
    except ParameterError as error:
        raise ObservationError(str(error)) from error


def _read_run_observations(run: Run) -> list[Observation]:
    """Return the observations of a run; a value that is not physical is a ParameterError."""
    unphysical: ParameterError | None = None
    with translate_read_errors(run.path):
        try:
            return list(run_observations(run))
        except ParameterError as error:
            unphysical = error
    raise unphysical


def amplifier_of(paths: Iterable[Path]) -> AmplifierMap:
    """Return the amplifier's map as it was in these runs: it is copied into every run file.

    Raises:
        RunReadError: a file is not a run.
        ObservationError: the runs were made with different maps.
    """
    maps = []
    for path in paths:
        with Run(path) as run:
            maps.append(run.amplifier_map)
    if any(each != maps[0] for each in maps):
        raise ObservationError(
            "these runs were made with differently configured amplifiers: identify them by themselves"
        )
    return maps[0] if maps else AmplifierMap()


def shape_count_of_file(path: Path) -> int:
    """Return the number of shape functions for a run: that of the simulation, or enough for a real tactor."""
    with Run(path) as run, translate_read_errors(path):
        return shape_count_of_run(run)


def shape_count_of_run(run: Run) -> int:
    """Return the number of shape functions for an open run."""
    if not run.simulated:
        return DEFAULT_SHAPE_COUNT
    return int(run.configuration.get("simulation", {}).get("modes", FitOptions.n))


def run_observations(run: Run) -> Iterator[Observation]:
    """Yield the observations of a run; none for protocols that do not concern the model."""
    observe = OBSERVATION_READERS.get(run.protocol)
    if observe is not None:
        columns = run.points()
        if len(columns["entry"]):
            yield from observe(run, columns, usable_mask(columns["quality"]))


def _common_arguments(run: Run) -> dict[str, Any]:
    """Return the gain error of the displacement sensor, which all its values share, and whether the run is simulated."""
    sensor, errors = run.sensor, tuple[SharedError, ...]()
    if sensor.gain_relative_uncertainty > 0:
        name = f"gain of {sensor.name} {sensor.serial}".strip()
        errors = (SharedError(name, "displacement", sensor.gain_relative_uncertainty),)
    return {"shared_errors": errors, "simulated": run.simulated}


def _response(
    run: Run, columns: Columns, good: Mask, label: str, elongation_m: float | None
) -> FrequencyResponseObservation:
    sine, width = (
        good & np.isfinite(columns[name]) & (columns[f"{name}_errors"] > 0) for name in ("fundamental", "peak_to_peak")
    )
    good = sine if sine.any() else width  # an imported table may have one of them only
    amplitude_v, offset_v = columns["drive_amplitude"], columns["drive_offset"]
    map_ = run.amplifier_map
    # No admitted drive leaves the amplifier's range; a recorded value beyond it is a measurement error of the card.
    room_v = np.minimum(offset_v - map_.low_v, map_.high_v - offset_v)
    amplitude_v = np.where(amplitude_v < room_v + CARD_READBACK_MARGIN_V, np.minimum(amplitude_v, room_v), amplitude_v)
    phase = columns["phase"]
    known: dict[str, Any] = {}
    if sine.any():
        turned = np.exp(1j * phase) if np.isfinite(phase[good]).all() else 1.0
        known |= {"fundamental_m": columns["fundamental"] * turned, "errors_m": columns["fundamental_errors"]}
    if width[good].all():
        known |= {
            "peak_to_peak_m": columns["peak_to_peak"],
            "peak_to_peak_errors_m": columns["peak_to_peak_errors"],
        }
    if np.isfinite(columns["harmonics"]).any():
        known["harmonics_m"] = columns["harmonics"]
    return FrequencyResponseObservation(
        label,
        columns["frequency"],
        drive_amplitude_v=amplitude_v,
        drive_offset_v=offset_v,
        elongation_m=elongation_m,
        good=good,
        **known,
        **_common_arguments(run),
    )


def _sine_dwell(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    yield _response(run, columns, good, run.path.stem, None)


def _membrane_series(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    """Yield one response for each elongation and each free reference."""
    for part in dict.fromkeys(columns["part"].tolist()):
        at = columns["part"] == part
        elongation = float(columns["elongation"][at][0])
        free = np.isnan(elongation)
        words = f"{part:.0f} free" if free else f"{part:.0f} at {1e3 * elongation:g} mm"
        mine = {name: column[at] for name, column in columns.items()}
        if good[at].any():
            yield _response(run, mine, good[at], f"{run.path.stem} {words}", None if free else elongation)


def _mass_resonance(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    peak = "frequency" if np.isfinite(columns["frequency"]).any() else "resonance"  # a table may have the latter only
    frequency, errors = columns[peak], columns[f"{peak}_errors"]
    yield MassResonanceObservation(
        run.path.stem,
        columns["mass"],
        frequency,
        errors,
        meaning="peak" if peak == "frequency" else "undamped",
        good=good & (errors > 0) & np.isfinite(frequency),
        simulated=run.simulated,
    )


def _voltage_steps(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    errors = columns["deflection_errors"]
    direction = np.nan_to_num(columns["direction"])
    time = columns["read_time"]
    yield VoltageStepsObservation(
        run.path.stem,
        np.where(np.isfinite(columns["drive"]), columns["drive"], columns["level"]),
        columns["deflection"],
        errors,
        rising=direction > 0 if (direction != 0).all() else None,
        time_s=time if np.isfinite(time).all() else None,
        good=good & (errors > 0),
        **_common_arguments(run),
    )


def _static_loading(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    """Yield each side separately; pushing is positive for any sensor sign. An unknown side is the mean of both."""
    sides: tuple[tuple[float, Side], ...] = ((1.0, "mfc"), (-1.0, "aluminium"), (np.nan, "both"))
    for side, name in sides:
        at = np.isnan(columns["side"]) if np.isnan(side) else columns["side"] == side
        if not good[at].any():
            continue
        deflection = columns["deflection"][at]
        down = np.sign(np.median(deflection[good[at]])) or 1.0
        # The load error is small compared with that of the deflection, and moves the point along the line.
        compliance = np.median(np.abs(deflection[good[at]]) / columns["load"][at][good[at]])
        errors = np.hypot(columns["deflection_errors"][at], compliance * np.nan_to_num(columns["load_errors"][at]))
        yield StaticLoadingObservation(
            f"{run.path.stem} {name}",
            columns["load"][at],
            down * deflection,
            errors,
            side=name,
            good=good[at] & (errors > 0),
            **_common_arguments(run),
        )


def _membrane_sag(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    """Yield the mean sag: errors common to the repeats (reference depth, geometry) do not average out."""
    if not good.any():
        return
    given = cast(SagProtocol, protocol_of_run(run, run.path.name))
    mean_m, error_m = given.mean_sag(columns["sag"][good], columns["sag_errors"][good])
    yield MembraneSagObservation(
        run.path.stem,
        np.array([mean_m]),
        np.array([given.combined_sag_error_m(mean_m, error_m)]),
        geometry=given.membrane,
        load_n_per_m=given.load_n_per_m,
        delta=given.elongation_m / given.length_m,
        **_common_arguments(run),
    )


OBSERVATION_READERS: dict[str, Callable[[Run, Columns, Mask], Iterator[Observation]]] = {
    "sine-dwell": _sine_dwell,
    "membrane-series": _membrane_series,
    "mass-resonance": _mass_resonance,
    "voltage-steps": _voltage_steps,
    "static-loading": _static_loading,
    "membrane-sag": _membrane_sag,
}
