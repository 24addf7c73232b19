"""Aspects of the protocol `sine-dwell`, and base of the aspects of dwells under a membrane."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from drivers import Sine
from model import AmplifierMap, Array, Membrane, SeriesAxis, identification
from protocols import measurements, signals
from protocols.base import (
    DISPLACEMENT_RANGE_M,
    Aspects,
    Figure,
    ImportColumn,
    ImportedSamples,
    ImportedTable,
    ImportForm,
    ModelState,
    Protocol,
    Quality,
    Recording,
    RunFigure,
    RunOfSamples,
)

if TYPE_CHECKING:
    from model.identification import Observation
    from protocols.aspects.run_points import RunPoints
    from protocols.measurements import SinePoint
    from protocols.runfile import RunRecord

CARD_READBACK_MARGIN_V = 0.02
"""Largest excess of a recorded drive over the amplifier's range."""

MEASURED_COLUMNS = ("peak_to_peak", "fundamental", "receptance")
INPUT_UNCERTAINTIES = {"frequency": "Hz", "elongation": "m"}

MIN_CYCLES = 3
"""Fewest cycles of a time series."""

MAX_NOISE_RATIO = 0.1
"""Residual of the sine fit relative to the amplitude above which a recorded drive is no single sine."""

SAME_FREQUENCY_HZ = 0.05
"""Largest distance between the frequencies of repeated time series."""


class SineDwellAspects(Aspects):
    """Sine dwell beside its measurement."""

    import_form = ImportForm(
        columns=(
            ImportColumn("frequency", "Hz", "frequency of the drive", ("f", "freq", "frequenz", "fhz", "omega", "angularfrequency"), (1.0, 2000.0), 0.0, True),
            ImportColumn("peak_to_peak", "m", "max - min of the displacement: the paper's amplitude", ("pp", "p2p", "pkpk", "pktopk", "maxmin", "peaktopeakamplitude", "peakpeak"), DISPLACEMENT_RANGE_M),
            ImportColumn("fundamental", "m", "peak amplitude of the fundamental", ("peakamplitude", "fundamentalamplitude", "sineamplitude"), DISPLACEMENT_RANGE_M),
            ImportColumn("receptance", "m/V", "peak amplitude of the fundamental divided by the drive's", ("frf", "frequencyresponse", "displacementpervolt"), (1e-10, 1e-2)),
            ImportColumn("receptance_errors", "m/V", "standard uncertainty of the receptance"),
            ImportColumn("phase", "rad", "phase of the fundamental against the drive", ("phi", "phaseangle"), (-7.0, 7.0)),
            ImportColumn("drive_amplitude", "V", "peak amplitude of the drive at the amplifier's input", ("drivepeak",), (0.01, 2.6)),
            ImportColumn("drive_peak_to_peak", "V", "drive at the amplifier's input, max - min", ("drivepp", "vpp", "drivemaxmin"), (0.02, 5.0)),
            ImportColumn("elongation", "m", "elongation of the membrane; empty for the free tactor", ("stretch", "membraneelongation"), (0.0, 0.05)),
        ),
        required=(("frequency",), MEASURED_COLUMNS),
        ambiguous={
            **dict.fromkeys(("amplitude", "displacement", "deflection", "a"), ("peak_to_peak", "fundamental")),
            "response": MEASURED_COLUMNS,
            **dict.fromkeys(("drive", "voltage", "drivevoltage"), ("drive_peak_to_peak", "drive_amplitude")),
        },
        input_uncertainties=INPUT_UNCERTAINTIES,
        rising=True,
        series=(
            ImportColumn("time", "s", "time of the sample", ("t", "zeit")),
            ImportColumn("drive", "V", "volts at the amplifier's input", ("input", "voltage", "u", "v"), (-0.5, 5.5)),
            ImportColumn("displacement", "m", "displacement of the centre", ("deflection", "w", "position", "x"), (-1e-2, 1e-2)),
        ),
    )  # fmt: skip

    short_name = "dwell"

    def observations(self, points: RunPoints) -> Iterator[Observation]:
        yield dwell_observation(points, points.label, None)

    def complete_table(self, table: ImportedTable) -> type[Protocol] | None:
        complete_dwell(table)
        return measurements.MembraneSeries if "elongation" in table.values else None

    def series_fault(self, series: ImportedSamples) -> str | None:
        if series.drive_v is None:
            return ""
        f = _largest_frequency(series.drive_v, series.rate_hz)
        fit = signals.fit_sine(series.drive_v, series.rate_hz, f)
        if fit.noise < MAX_NOISE_RATIO * abs(fit.fundamental):
            return ""
        return (
            f"the drive is not a single sine (besides {abs(fit.fundamental):.3g} V at {f:.4g} Hz there are {fit.noise:.3g} V of other signals); "
            "give one file for each frequency, or one with a single sweep up or down"
        )

    def series_runs(self, series: Sequence[ImportedSamples]) -> Iterator[RunOfSamples]:
        """Yield one run of all series, one point each."""
        points = [_series_point(each) for each in series]
        warnings = [f"{each.name} has no drive: its phase is unknown" for each in series if each.drive_v is None]
        for i, point in enumerate(points):
            same = (j for j in range(i) if abs(points[j].frequency - point.frequency) < SAME_FREQUENCY_HZ)
            if (j := next(same, None)) is not None:
                warnings.append(
                    f"{series[i].name} and {series[j].name} are both at {point.frequency:.4g} Hz: both are kept, as repeats"
                )
        yield RunOfSamples(
            series,
            tuple(points),
            tuple(
                replace(one, entry=entry)
                for entry, (each, point) in enumerate(zip(series, points, strict=True))
                for one in each.as_series(f"{point.frequency:.4g} Hz, {each.name}")
            ),
            {"peak_to_peak_v": 2 * max(p.drive_amplitude for p in points), **series[0].settings},
            tuple(warnings),
            has_phases=any(math.isfinite(point.phase) for point in points),
        )

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        yield amplitude_figure(points)

    def run_figures(self, run: RunRecord, estimates: Sequence[RunFigure]) -> Iterable[RunFigure]:
        """Yield the estimates, the largest max - min of the usable points, and its margin over the abdomen's threshold of perception."""
        from model.response import perception_margin  # slow to import

        yield from estimates
        if (top := run.largest) is None:
            return
        y, error, gain = top.peak_to_peak_m, top.error_m, run.sensor.gain_relative_uncertainty
        condition = f"{2 * top.median_drive_v:.2g} V"
        yield RunFigure.with_gain("amplitude_at_resonance", y, error, "m", gain, condition)
        margin = float(perception_margin(np.array([top.frequency_hz]), np.array([y]))[0])
        error = margin * error / y if y else math.nan
        yield RunFigure.with_gain("margin_at_resonance", margin, error, "1", gain, condition)._replace(
            frequency_hz=top.frequency_hz
        )


def amplitude_figure(points: RunPoints) -> Figure:
    """Return both amplitudes over frequency, on the curves of the free tactor under the run's drive."""
    x, displacement = SeriesAxis("frequency", "Hz"), "displacement of the centre"
    whole = points.series(x, SeriesAxis("peak_to_peak", "m", displacement), "max - min")
    half = points.series(x, SeriesAxis("fundamental", "m", displacement), "2 x fundamental")
    models = {whole.label: amplitude_model(points), half.label: amplitude_model(points, peak_to_peak=False)}
    grid = np.linspace(5.0, 1.05 * max(float(whole.x.max(initial=0.0)), 250.0), 500)
    series = (whole, half.scaled(1.0, 2.0))
    return Figure(series, models=models, grid=grid, from_zero=True, has_threshold=True)


def amplitude_model(
    points: RunPoints, elongation_m: float | None = None, peak_to_peak: bool = True
) -> Callable[[ModelState, Array], Array]:
    """Return the model of max - min, or of twice the fundamental, under the run's drive, free or at an elongation of the membrane."""
    amplitude_v = float(points.run.setup.parameters["peak_to_peak_v"]) / 2

    def amplitudes(state: ModelState, frequency_hz: Array) -> Array:
        from model.response import driven_amplitudes, lag_factor  # slow to import

        specimen, amplifier, skin = replace(state.specimen, membrane=None, delta=0.0), state.amplifier, None
        if elongation_m is not None:
            membrane = state.specimen.membrane or Membrane()
            specimen = replace(specimen, membrane=membrane, delta=elongation_m / membrane.L_m)
            skin = specimen.skin
        whole, fundamental = driven_amplitudes(specimen.acting_tactor, frequency_hz, amplitude_v, amplifier, skin)
        lag = lag_factor(specimen.hysteresis, specimen.creep, frequency_hz, amplitude_v, amplifier=amplifier)
        return np.abs(lag) * (whole if peak_to_peak else 2 * fundamental)

    return amplitudes


def dwell_observation(
    points: RunPoints, label: str, elongation_m: float | None
) -> identification.FrequencyResponseObservation:
    """Return the response to sines, free or under a membrane."""
    columns = points.columns
    foreign = (
        points.run.setup.imported and not np.isfinite(columns["harmonics"]).any()
    )  # exports of this program have harmonics
    sine, width = (
        points.good & np.isfinite(columns[name]) & (columns[f"{name}_errors"] > 0)
        for name in ("fundamental", "peak_to_peak")
    )
    good = sine if sine.any() else width  # an imported table may have only one of them
    phase = columns["phase"]
    measured: dict[str, Any] = {}
    if sine.any():
        size, errors = columns["fundamental"], columns["fundamental_errors"]
        phase_errors = columns["phase_errors"]
        has_phase = np.isfinite(phase[good]).all()
        if foreign and has_phase and (phase_errors[good] > 0).all():
            measured["phase_errors_rad"] = phase_errors
        elif not foreign:  # the phase includes the noise of the drive channel, which the ratio to the drive shares
            measured["harmonic_errors_m"] = errors
            errors = np.fmax(errors, size * phase_errors)
        measured |= {"fundamental_m": size * (np.exp(1j * phase) if has_phase else 1.0), "errors_m": errors}
    if width[good].all():
        measured["peak_to_peak_m"] = columns["peak_to_peak"]
        measured["peak_to_peak_errors_m"] = columns["peak_to_peak_errors"]
    if np.isfinite(columns["harmonics"]).any():
        measured["harmonics_m"] = columns["harmonics"]
    common = points.common_arguments("displacement", "delay", "volts")
    common["shared_errors"] += points.input_errors("frequency", "frequency", good, f"{label}, {{}} Hz")
    if elongation_m is not None:
        common["mountings"] |= {"membrane": points.run.setup.start_time}  # which the run itself puts on
        common["shared_errors"] += points.input_errors("elongation", "elongation", good, f"{label}, {{}} m")
    offset_v = columns["drive_offset"]
    return identification.FrequencyResponseObservation(
        label,
        columns["frequency"],
        drive_amplitude_v=_within_range(columns["drive_amplitude"], offset_v, points.run.setup.amplifier_map),
        drive_offset_v=offset_v,
        elongation_m=elongation_m,
        good=good,
        order=points.start_s + float(columns["part"][0] if "part" in columns else 0.0),
        **measured,
        **common,
    )


def _within_range(amplitude_v: Array, offset_v: Array, amplifier: AmplifierMap) -> Array:
    """Return the recorded amplitudes: no admitted drive leaves the amplifier's range, so that an excess is the card's error."""
    room_v = np.minimum(offset_v - amplifier.low_v, amplifier.high_v - offset_v)
    return np.where(amplitude_v < room_v + CARD_READBACK_MARGIN_V, np.minimum(amplitude_v, room_v), amplitude_v)


def complete_dwell(table: ImportedTable) -> None:
    """Add drive and elongation of the membrane to the points of a dwell.

    Raises:
        TableImportError: the drive is missing or leaves the amplifier's range, or a quantity is given twice.
    """
    _add_drive(table)
    values, amplifier = table.values, table.amplifier
    if "receptance" in values:
        if "fundamental" in values:
            raise table.refusal(" has both receptance and fundamental; name the one to omit with --column")
        values["fundamental"] = values.pop("receptance") * values["drive_amplitude"]
        if "receptance_errors" in values:
            values["fundamental_errors"] = values.pop("receptance_errors") * values["drive_amplitude"]
    table.parameters.setdefault("peak_to_peak_v", 2 * float(np.nanmax(values["drive_amplitude"])))
    if "drive_offset" not in values:
        values["drive_offset"] = np.full(table.rows, amplifier.rest_v)
        table.warnings.append(
            f"the drive is taken to swing around rest, {amplifier.rest_v:g} V at the amplifier's input"
        )
    if table.elongation_m is not None:
        if "elongation" in values:
            raise table.refusal(" has a column for the elongation: omit --membrane-elongation")
        values["elongation"] = np.full(table.rows, table.elongation_m)
    if "elongation" in values and "part" not in values:
        each = values["elongation"]
        new = np.concatenate(([False], ~((each[1:] == each[:-1]) | (np.isnan(each[1:]) & np.isnan(each[:-1])))))
        values["part"] = np.cumsum(new).astype(float)


def _add_drive(table: ImportedTable) -> None:
    values, amplifier = table.values, table.amplifier
    if "drive_peak_to_peak" in values:
        values["drive_amplitude"] = values.pop("drive_peak_to_peak") / 2
    if "drive_amplitude" not in values:
        if "peak_to_peak_v" not in table.parameters:
            raise table.refusal(
                ": the amplitude of the drive is not given; give it as max - min at the amplifier's input: "
                '--set "peak_to_peak_v=5 V", or name its column: --column drive_peak_to_peak=NAME'
            )
        values["drive_amplitude"] = np.full(table.rows, table.parameters["peak_to_peak_v"] / 2)
    if (beyond := values["drive_amplitude"] > 1.05 * (amplifier.high_v - amplifier.rest_v)).any():
        row = int(beyond.argmax())
        raise table.refusal(
            f": a drive of {2 * values['drive_amplitude'][row]:.4g} V, max - min, leaves the amplifier's range of "
            f"{amplifier.low_v:g} to {amplifier.high_v:g} V around {amplifier.rest_v:g} V; give the volts at its input",
            row,
        )


def _series_point(series: ImportedSamples) -> SinePoint:
    """Return the point of a time series under a sine; without the drive, its phase is NaN."""
    time, drive, amplifier = series.time_s, series.drive_v, series.amplifier
    if drive is None:
        f, amplitude = _stated_drive(series)
        drive = amplifier.rest_v + amplitude * np.sin(2 * np.pi * f * (time - time[0]))
    else:
        f = _largest_frequency(drive, series.rate_hz)
        amplitude = abs(signals.fit_sine(drive, series.rate_hz, f).fundamental)
    cycles = float((time[-1] - time[0]) * f)
    if cycles < MIN_CYCLES:
        raise series.refusal(f" holds {cycles:.2g} cycles of {f:.4g} Hz; at least {MIN_CYCLES} are needed")
    sine = Sine(f, min(amplitude, amplifier.high_v - amplifier.rest_v), amplifier.rest_v, max(int(cycles), 1))
    moved = series.displacement_m
    recording = Recording(0, (0, moved.size), series.rate_hz, sine, drive, moved, Quality.IMPORTED, series.delay_s)
    try:
        point = measurements.sine_point([recording], series.simulated)
    except ValueError as error:
        raise series.refusal(f": {error}") from None
    return point if series.drive_v is not None else replace(point, phase=math.nan, phase_errors=math.nan)


def _stated_drive(series: ImportedSamples) -> tuple[float, float]:
    """Return frequency and amplitude of an unrecorded drive."""
    f, volts = series.settings.get("frequencies_hz", ()), series.settings.get("peak_to_peak_v")
    if len(f) != 1 or volts is None:
        raise series.refusal(
            ' has no column of the drive: name it with --column drive=NAME, or give the drive: --set frequencies_hz=160 --set "peak_to_peak_v=5 V"'
        )
    return float(f[0]), float(volts) / 2


def _largest_frequency(drive: Array, rate_hz: float) -> float:
    spectrum = np.abs(np.fft.rfft((drive - drive.mean()) * np.hanning(drive.size)))
    return signals.fit_frequency(drive, rate_hz, (int(spectrum[1:].argmax()) + 1) * rate_hz / drive.size)


ASPECTS = SineDwellAspects()
