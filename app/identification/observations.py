"""Observations for an identification: the points of run files, by protocol.

Flagged points are kept but not usable. The gain error of a sensor is shared by all its values; it is named by the serial
number, so that runs with the same sensor share it and runs with different sensors do not.
"""

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, cast

import numpy as np

from app.identification.drive_histories import history_of_levels, history_of_loads
from app.identification.duplicates import DuplicateFinder
from app.identification.response_lines import response_lines
from model import GRAVITY, AmplifierMap, Array, Complex, Mask, ParameterError
from model.identification import (
    DecayPoleObservation,
    ErrorTarget,
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
from model.response.lag import loop_share
from protocols.base import usable_mask
from protocols.measurements.membrane_sag import MembraneSag as SagProtocol
from protocols.measurements.sweep import Sweep
from protocols.resume import protocol_of_run
from protocols.runfile.reader import Run, RunReadError, translate_read_errors

CARD_READBACK_MARGIN_V = 0.02
"""How far a recorded drive may lie beyond the amplifier's range."""

DEFAULT_SHAPE_COUNT = 20
"""Shape functions for a real tactor; for a simulated one, the number of the simulation."""

EARLIER_CREEP_AGES_S = (1.0, 10.0, 100.0)
"""Before the beginning of a run, when something was driven or laid on that still creeps: any time from seconds to minutes."""

MAX_SWEPT_CYCLES = 2000
"""Cycles of a period at the highest frequency up to which the loops of a sweep are computed in time: it takes 1 us a sample."""

LINE_TOLERANCE = 0.01
"""Of the distance of lines: how far an excited line, an odd multiple of one over the period, may seem to lie from it."""

SAMPLES_PER_CYCLE = 64
"""Of such a sweep at its highest frequency: turning points are missed by 0.1 % of the amplitude at most."""

MAX_INPUT_ERRORS = 100
"""Errors of single inputs, such as masses or levels, that a fit takes from one run."""

INSTRUMENT_ERRORS: dict[str, tuple[ErrorTarget, ...]] = {
    "sine-dwell": ("displacement", "delay", "volts"),
    "sweep": ("displacement", "delay", "volts"),
    "free-decay": (),
    "membrane-series": ("displacement", "delay", "volts"),
    "voltage-steps": ("displacement", "volts"),
}
"""What the errors of sensor and amplifier act on in a protocol; otherwise the sensor's gain alone."""

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
    finder = DuplicateFinder()
    for path in paths:
        try:
            with open_run(path) as run:
                specimens.setdefault(run.specimen, path)
                with translate_read_errors(run.path):
                    duplicate, message = finder.duplicates(run)
                taken = _read_run_observations(run, duplicate)
        except ParameterError as error:
            raise ObservationError(f"{path}: {error}") from error
        except RunReadError as error:
            raise ObservationError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
        usable = [run for run in taken if run.usable.any()]
        found += usable
        if message:
            left_out.append(message)
        elif not usable:
            left_out.append(f"{path.name} has no information on the model and is left out")
    if len(specimens) > 1:
        names = " and ".join(f"{name!r} ({path.name})" for name, path in specimens.items())
        raise ObservationError(f"these runs are of several specimens, {names}: identify one at a time")
    if not found:
        raise ObservationError("none of these runs has a usable point with information on the model")
    try:
        return next(iter(specimens)), ObservationSet(tuple(found)), left_out
    except ParameterError as error:
        raise ObservationError(str(error)) from error


def _read_run_observations(run: Run, duplicate: Mask) -> list[Observation]:
    """Return the observations of a run without its duplicates; a value that is not physical is a ParameterError."""
    unphysical: ParameterError | None = None
    with translate_read_errors(run.path):
        try:
            return list(run_observations(run, duplicate))
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


def run_observations(run: Run, duplicate: Mask | None = None) -> Iterator[Observation]:
    """Yield the observations of a run; none for protocols that do not concern the model.

    Args:
        run: an open run.
        duplicate: points that another run has, too, which are not usable; see `DuplicateFinder`.
    """
    observe = OBSERVATION_READERS.get(run.protocol)
    if observe is not None:
        columns = run.points()
        if len(columns["entry"]):
            good = usable_mask(columns["quality"])
            yield from observe(run, columns, good if duplicate is None else good & ~duplicate)


def _common_arguments(run: Run) -> dict[str, Any]:
    """Return the errors of sensor and amplifier, which all values of a run share, and whether it is simulated."""
    sensor, bench = run.sensor, run.configuration
    amplifier = bench.get("amplifier", {})
    label = f"{sensor.name} {sensor.serial}".strip()
    slopes = f"slopes of {amplifier.get('name', 'the amplifier')} {amplifier.get('serial', '')}".strip()
    stated: tuple[tuple[str, ErrorTarget, float], ...] = (
        (f"gain of {label}", "displacement", sensor.gain_relative_uncertainty),
        (f"delay of {label}", "delay", float(bench.get("sensor", {}).get("delay_uncertainty_s", 0.0))),
        (slopes, "volts", float(amplifier.get("slope_relative_uncertainty", 0.0))),
    )
    acting = INSTRUMENT_ERRORS.get(run.protocol, ("displacement",))
    errors = tuple(SharedError(name, on, size) for name, on, size in stated if size > 0 and on in acting)
    return {"shared_errors": errors, "simulated": run.simulated}


def _input_errors(
    columns: Columns,
    inputs: tuple[str, ErrorTarget],
    good: Mask,
    name: str,
    values: Array | None = None,
) -> tuple[SharedError, ...]:
    """Return an error for each different value of an input whose uncertainty a table states, such as each mass.

    Args:
        columns: of the run.
        inputs: column of the input, and what its error acts on.
        good: usable points.
        name: of the error, with {} for the value.
        values: the input as the model takes it, if not the column.
    """
    column, target = inputs
    stated = columns.get(f"{column}_errors")
    if stated is None:
        return ()
    at = columns[column] if values is None else values
    counts = good & np.isfinite(at) & np.isfinite(stated) & (stated > 0)
    found = []
    for value in np.unique(at[counts]).tolist():
        error = float(np.sqrt(np.mean(stated[counts & (at == value)] ** 2)))
        relative = error / abs(value) if target == "load" else error
        found.append(SharedError(name.format(f"{value:.9g}"), target, float(f"{relative:.6g}"), at=value))
    if len(found) > MAX_INPUT_ERRORS:
        raise ParameterError(
            f"{column} has {len(found)} different values with an uncertainty of their own, the limit is {MAX_INPUT_ERRORS}: "
            "add it to the uncertainty of what was measured, and leave this one away"
        )
    return tuple(found)


def _weight_errors(columns: Columns, good: Mask) -> tuple[SharedError, ...]:
    """Return the error of each weight: the same in every repeat, on both sides and in all runs with it."""
    grams = 1e3 * columns["load"] / GRAVITY if np.isnan(columns["mass"]).any() else 1e3 * columns["mass"]
    found = []
    for error in _input_errors(columns, ("load", "load"), good & (columns["load"] > 0), "{}"):
        weight = float(grams[columns["load"] == error.at][0])
        label = f"weight of {weight:.6g} g (load {error.at:.9g} N ± {100 * error.standard_error:.6g} %)"
        found.append(replace(error, name=label))
    return tuple(found)


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
        size, errors = columns["fundamental"], columns["fundamental_errors"]
        phase_errors = columns["phase_errors"]
        told = np.isfinite(phase[good]).all()
        if run.imported and told and (phase_errors[good] > 0).all():
            known["phase_errors_rad"] = phase_errors
        elif not run.imported:  # the phase has the noise of the drive channel, too, which the ratio to the drive shares
            known["harmonic_errors_m"] = errors
            errors = np.fmax(errors, size * phase_errors)
        known |= {"fundamental_m": size * (np.exp(1j * phase) if told else 1.0), "errors_m": errors}
    if width[good].all():
        known |= {
            "peak_to_peak_m": columns["peak_to_peak"],
            "peak_to_peak_errors_m": columns["peak_to_peak_errors"],
        }
    if np.isfinite(columns["harmonics"]).any():
        known["harmonics_m"] = columns["harmonics"]
    common = _common_arguments(run)
    common["shared_errors"] += _input_errors(columns, ("frequency", "frequency"), good, f"{label}, {{}} Hz")
    if elongation_m is not None:
        common["shared_errors"] += _input_errors(columns, ("elongation", "elongation"), good, f"{label}, {{}} m")
    return FrequencyResponseObservation(
        label,
        columns["frequency"],
        drive_amplitude_v=amplitude_v,
        drive_offset_v=offset_v,
        elongation_m=elongation_m,
        good=good,
        **known,
        **common,
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


def _sweep(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    """Yield the lines of each sweep as sines of the sweep's amplitude.

    The amplifier's two slopes are their mean and an even part; the sweep is played both ways up, so that only the mean is in
    its lines, as in the fundamental of a sine.
    """
    map_ = run.amplifier_map
    curves = {curve.entry: curve for curve in run.curves() if curve.name == "frequency response"}
    for i in np.flatnonzero(good).tolist():
        curve = curves.get(int(columns["entry"][i]))
        if curve is None:
            continue
        lines = response_lines(curve, bool(run.imported))
        amplitude_v = float(min(columns["drive_amplitude"][i], map_.high_v - map_.rest_v, map_.rest_v - map_.low_v))
        if lines.frequency_hz.size and amplitude_v > 0:
            yield FrequencyResponseObservation(
                f"{run.path.stem} {curve.label}".strip(),
                lines.frequency_hz,
                lines.response * amplitude_v,
                lines.errors * amplitude_v,
                drive_amplitude_v=amplitude_v,
                drive_offset_v=map_.rest_v,
                swept=True,
                loop_share=None if run.imported else _loop_share(run, lines.frequency_hz),
                **_common_arguments(run),
            )


def _loop_share(run: Run, frequency_hz: Array) -> Complex | None:
    """Return what a hysteresis of 1 adds at the lines of a sweep, (F,): its loops are no sine's where it begins and turns.

    None, as under sines, for a long sweep, for one in pieces, whose bands overlap, and for lines that are averages of others.
    """
    protocol, amplifier = protocol_of_run(run, run.path.name), run.amplifier_map
    drives = protocol.drives(amplifier.rest_v) if isinstance(protocol, Sweep) else ()
    if len(drives) != 1 or drives[0].period_s * drives[0].stop_hz > MAX_SWEPT_CYCLES:
        return None
    drive = drives[0]
    lines = np.rint(frequency_hz * drive.period_s).astype(int)
    if np.any(lines % 2 == 0) or not np.allclose(lines, frequency_hz * drive.period_s, rtol=0, atol=LINE_TOLERANCE):
        return None
    samples = math.ceil(SAMPLES_PER_CYCLE * drive.period_s * drive.stop_hz)
    volts = drive.volts(np.arange(samples) * drive.period_s / samples)
    return loop_share(np.clip(volts, amplifier.low_v, amplifier.high_v), lines, amplifier)


def _free_decay(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    names = ("resonance", "resonance_errors", "damping", "damping_errors")
    frequency, errors, damping, damping_errors = (columns[name] for name in names)
    good = good & np.isfinite(frequency) & np.isfinite(damping) & (errors > 0) & (damping_errors > 0) & (damping < 1)
    if good.any():
        yield DecayPoleObservation(
            run.path.stem,
            *(np.where(good, column, 0.5) for column in (frequency, errors, damping, damping_errors)),
            good=good,
            **_common_arguments(run),
        )


def _mass_resonance(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    peak = "frequency" if np.isfinite(columns["frequency"]).any() else "resonance"  # a table may have the latter only
    frequency, errors = columns[peak], columns[f"{peak}_errors"]
    good = good & (errors > 0) & np.isfinite(frequency)
    yield MassResonanceObservation(
        run.path.stem,
        columns["mass"],
        frequency,
        errors,
        meaning="peak" if peak == "frequency" else "undamped",
        good=good,
        shared_errors=_input_errors(columns, ("mass", "mass"), good, f"{run.path.stem}, mass of {{}} kg"),
        simulated=run.simulated,
    )


def _voltage_steps(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    errors = columns["deflection_errors"]
    direction = np.nan_to_num(columns["direction"])
    time = columns["read_time"]
    input_v = np.where(np.isfinite(columns["drive"]), columns["drive"], columns["level"])
    common = _common_arguments(run)
    common["shared_errors"] += _input_errors(
        columns, ("level", "level"), good & (errors > 0), f"{run.path.stem}, level of {{}} V", input_v
    )
    history = history_of_levels(run, columns)
    if history is not None:
        common["shared_errors"] += _rest_errors(run, columns["zero"][good])
    yield VoltageStepsObservation(
        run.path.stem,
        input_v,
        columns["deflection"],
        errors,
        rising=direction > 0 if (direction != 0).all() else None,
        time_s=time if np.isfinite(time).all() else None,
        history=history,
        good=good & (errors > 0),
        **common,
    )


def _rest_errors(run: Run, zero_m: Array) -> tuple[SharedError, ...]:
    """Return the drifts at rest by creep of what was before the run, which is unknown: each at most what the zeros moved."""
    moved = float(np.ptp(zero_m)) if zero_m.size and np.isfinite(zero_m).all() else 0.0
    if moved == 0:
        return ()
    return tuple(
        SharedError(f"{run.path.stem}, creep of {age:g} s before it", "rest", moved, at=age)
        for age in EARLIER_CREEP_AGES_S
    )


def _static_loading(run: Run, columns: Columns, good: Mask) -> Iterator[Observation]:
    """Yield each side separately; pushing is positive for any sensor sign. An unknown side is the mean of both."""
    history = history_of_loads(run, columns)
    sides: tuple[tuple[float, Side], ...] = ((1.0, "mfc"), (-1.0, "aluminium"), (np.nan, "both"))
    for side, name in sides:
        at = np.isnan(columns["side"]) if np.isnan(side) else columns["side"] == side
        if not good[at].any():
            continue
        deflection = columns["deflection"][at]
        down = np.sign(np.median(deflection[good[at]])) or 1.0
        errors = columns["deflection_errors"][at]
        common = _common_arguments(run)
        common["shared_errors"] += _weight_errors(columns, good & at)
        yield StaticLoadingObservation(
            f"{run.path.stem} {name}",
            columns["load"][at],
            down * deflection,
            errors,
            side=name,
            history=None if history is None else history.take(at),
            good=good[at] & (errors > 0),
            **common,
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
    "sweep": _sweep,
    "free-decay": _free_decay,
    "mass-resonance": _mass_resonance,
    "voltage-steps": _voltage_steps,
    "static-loading": _static_loading,
    "membrane-sag": _membrane_sag,
}
