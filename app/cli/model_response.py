"""Topics of the command `model` under a drive: frequency response, latency, and the membrane."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from annotated_types import Interval

from app.cli.model_options import (
    DENSITY,
    DURATION,
    ELONGATION,
    VOLTAGE,
    DriveOptions,
    ShapeOptions,
    Topic,
    describe_specimen,
    plausibility_note,
    read_settings,
    read_specimen,
    read_values,
)
from app.cli.options import THRESHOLD, FileOptions, command, group, option
from app.cli.output import CommandResult
from app.common import Column, Table, UsageError, read_number
from app.identification import chosen_threshold
from model import LOAD_SPEC as WEIGHT
from model import (
    PRE_STRETCH,
    AmplifierMap,
    Array,
    Complex,
    Membrane,
    ParameterError,
    ParameterSpec,
    SagSolution,
    Series,
    Specimen,
    point_stiffness,
    replace_variables,
    sag,
    specimen_record,
    weight_per_length,
)
from model.response import (
    PERIODIC_FREQUENCY_SPEC,
    THRESHOLD_SPEC,
    TOLERANCE_SPEC,
    UNCOMFORTABLE_HZ,
    UNCOMFORTABLE_SOURCE,
    Latency,
    PerceptionThreshold,
    PeriodicResponse,
    Waveform,
    amplifier_response,
    exact_response,
    fourier_series,
    harmonic_orders,
    onset_response,
    perception_margin,
    sine_latency,
    step_latency,
    step_response,
    tactor_modal_form,
    usable_bands,
    with_lag,
)
from model.response import frequency_response as receptance
from model.studies import PaperFigure

DWELL_HZ = "25,50,75,100,125,150,155,160,165,170,175,180,185,190,195,200,225,250"
"""The paper's frequencies."""
CURVE_HZ = "1:250:250"
POINTS = 2001
RUNS_FOLDER = Path("runs")
"""Folder whose laboratory file names the threshold if `--threshold` does not."""


@command("--frequencies 1:500:500 --elongation '1.27 mm' --csv response.csv")
class FrequencyResponseTopic(Topic):
    """Compute amplitude against frequency under the drive that the amplifier delivers: 2 x fundamental and max - min."""

    shapes: ShapeOptions = group(ShapeOptions)
    drive: DriveOptions = group(DriveOptions)
    frequencies: str | None = option(
        "frequencies, e.g. '25,50,75 Hz', '1:500:500' or '1:1000:100:log' (default: the paper's 18 from 25 to 250 Hz; "
        "1:250:250 where a file is written)",
        metavar="LIST",
    )
    waveform: Waveform = option("drive (default: %(default)s)", "sine")
    at: str | None = option("distance from the clamp, e.g. '8 mm' (default: the centre)", metavar="X")
    exact: bool = option("add the closed-form solution, to compare with the n shape functions")
    threshold: str | None = THRESHOLD
    files: FileOptions = group(FileOptions, "the response")

    def compute(self) -> CommandResult:
        specimen = read_specimen(self)
        t, skin = specimen.acting_tactor, specimen.skin
        default = CURVE_HZ if self.files.csv or self.files.picture else DWELL_HZ
        f = np.array(read_values(default if self.frequencies is None else self.frequencies, PERIODIC_FREQUENCY_SPEC))
        choice = self.shapes.choose(specimen, float(f.max()))
        n = choice.n
        amplitude, offset = self.drive.read()
        position = ParameterSpec("at", "m", Interval(ge=0, le=t.L), "distance from the clamp", None)
        at = None if self.at is None else read_number(self.at, position)
        beam = amplifier_response(t, f, amplitude, offset, skin=skin, waveform=self.waveform, n=n, x=at)
        response = with_lag(beam, specimen, amplitude, offset, AmplifierMap())
        felt = chosen_threshold(RUNS_FOLDER, self.threshold)
        columns = _response_columns(response, receptance(t, f, skin, n, at), felt)
        twice = 2 * np.abs(response.fundamental)
        lines = [Series(f, response.peak_to_peak, label="max - min"), Series(f, twice, label="2 x fundamental")]
        if self.exact:
            exact = exact_response(t, f, skin, at)
            V = fourier_series(self.waveform, amplitude, offset, AmplifierMap(), 1)
            columns.append(Column("exact", "m", 2 * np.abs(V[1] * exact), "closed form", "µm", ".1f"))
            lines.append(Series(f, 2 * np.abs(V[1] * exact), label="2 x fundamental, closed form"))
        where = describe_specimen(specimen)
        title = f"Response to a {self.waveform} of {2 * amplitude:g} V peak to peak around {offset:g} V, {where}"
        table = Table("response", title, tuple(columns))
        figure = PaperFigure("response", "frequency", "Hz", "amplitude of the centre", "m", tuple(lines), title + ".")
        note, bands = _describe_felt_bands(f, response.peak_to_peak, felt)
        return CommandResult(
            "model frequency-response",
            specimen_record(specimen),
            (table,),
            (note, f"{choice.describe()}."),
            figures=(figure,),
            extra={"felt_hz": bands, "shapes": choice.n, "shape_error": choice.error},
        )


@command("--voltage '1500 V' --frequency '160 Hz' --picture step.png")
class StepTopic(Topic):
    """Compute the latency of a voltage step and of a sine's onset: time to 50 µm, rise, overshoot, settling."""

    shapes: ShapeOptions = group(ShapeOptions)
    drive: DriveOptions = group(DriveOptions)
    voltage: str = option("step on the specimen (default: %(default)s)", "1500 V")
    frequency: str = option("frequency of the sine (default: %(default)s)", "160 Hz")
    threshold: str = option("perception threshold (default: %(default)s)", "50 um")
    tolerance: str = option("settling band (default: %(default)s)", "2 %")
    duration: str | None = option("duration of the curves (default: until both have settled)")
    files: FileOptions = group(FileOptions, "both curves")

    def compute(self) -> CommandResult:
        specimen = read_specimen(self)
        choice = self.shapes.choose(specimen)
        t, skin, n = specimen.acting_tactor, specimen.skin, choice.n
        volts, hz = read_number(self.voltage, VOLTAGE), read_number(self.frequency, PERIODIC_FREQUENCY_SPEC)
        amplitude, offset = self.drive.read()
        threshold = read_number(self.threshold, THRESHOLD_SPEC)
        tolerance = read_number(self.tolerance, TOLERANCE_SPEC)
        stepped = step_latency(t, volts, threshold, tolerance, skin, n)
        begun = sine_latency(t, hz, amplitude, offset, threshold, tolerance, skin, n=n)
        where, felt = describe_specimen(specimen), f"time to {1e6 * threshold:g} µm"
        drive = f"{2 * amplitude:g} V peak to peak around {offset:g} V at the amplifier's input"
        titles = f"Step of {volts:g} V on the specimen, {where}", f"Onset of a sine of {hz:g} Hz, {drive}"
        tables = (
            _latency_table("step", titles[0], "final deflection", felt, stepped, tolerance),
            _latency_table("sine_onset", titles[1], "amplitude of the fundamental", felt, begun, tolerance),
        )
        longest = max(stepped.settling_s or 0.02, begun.settling_s or 0.02)
        duration = 1.5 * longest if self.duration is None else read_number(self.duration, DURATION)
        time = np.linspace(0, duration, POINTS)
        V = fourier_series("sine", amplitude, offset, AmplifierMap(), harmonic_orders(np.array([hz])))
        w = step_response(t, time, volts, skin, n)
        onset = onset_response(tactor_modal_form(t, skin, n), time, hz, V).real
        curve = Table("time", "", (Column("time", "s", time), Column("step", "m", w), Column("sine_onset", "m", onset)))
        lines = (Series(time, w, label=f"step of {volts:g} V"), Series(time, onset, label=f"onset of {hz:g} Hz"))
        figure = PaperFigure("step", "time", "s", "deflection of the centre", "m", lines, f"Begun from rest, {where}.")
        return CommandResult(
            "model step",
            specimen_record(specimen),
            tables,
            (f"{choice.describe()}.",),
            write_csv=curve.to_csv,
            figures=(figure,),
            extra={"shapes": choice.n, "shape_error": choice.error},
        )


def _response_columns(response: PeriodicResponse, receptance: Complex, felt: PerceptionThreshold) -> list[Column]:
    """Return frequency, amplitudes, phase, receptance, and the margin over the perception threshold."""
    f, peak_to_peak = response.frequency_hz, response.peak_to_peak
    head = f"x {1e6 * felt.amplitude_m[0]:g} µm" if len(felt.amplitude_m) == 1 else "x threshold"
    return [
        Column("frequency", "Hz", f, format_spec=".6g"),
        Column("peak_to_peak", "m", peak_to_peak, "max - min", "µm", ".1f"),
        Column("twice_fundamental", "m", 2 * np.abs(response.fundamental), "2 x fundamental", "µm", ".1f"),
        Column("phase", "rad", np.angle(response.fundamental), "phase", "°", ".1f"),
        Column("receptance_re", "m/V", receptance.real, displayed=False),
        Column("receptance_im", "m/V", receptance.imag, displayed=False),
        Column("margin", "", perception_margin(f, peak_to_peak, felt), head, format_spec=".2f"),
    ]


def _describe_felt_bands(
    f: Array, amplitude: Array, threshold: PerceptionThreshold
) -> tuple[str, tuple[tuple[float, float], ...]]:
    """Return the bands in which max - min exceeds the perception threshold, as text and in Hz."""
    rising, order = np.unique(f, return_index=True)
    bands = usable_bands(rising, amplitude[order], threshold)
    peak = f"Highest max - min: {1e6 * amplitude.max():.1f} µm at {f[amplitude.argmax()]:g} Hz. "
    if not bands:
        return f"{peak}Nowhere felt: below the threshold, {threshold.description}.", bands
    listed = ", ".join(f"{low:.4g} to {high:.4g} Hz" for low, high in bands)
    computed = f"of the {rising[0]:g} to {rising[-1]:g} Hz computed"
    text = f"{peak}Felt {listed}, {computed}: above the threshold, {threshold.description}."
    if bands[-1][1] > UNCOMFORTABLE_HZ[0]:
        text += f" Above it tends to be uncomfortable ({UNCOMFORTABLE_SOURCE})."
    return text, bands


def _latency_table(name: str, title: str, final: str, felt: str, latency: Latency, tolerance: float) -> Table:
    columns = (
        Column("final", "m", [latency.final_m], final, "µm", ".1f"),
        Column("to_threshold", "s", [latency.to_threshold_s], felt, "ms", ".3f"),
        Column("rise", "s", [latency.rise_s], "10 % to 90 % rise", "ms", ".3f"),
        Column("overshoot", "", [latency.overshoot], "overshoot", "%", ".1f"),
        Column("settling", "s", [latency.settling_s], f"settled within {100 * tolerance:g} %", "ms", ".2f"),
    )
    return Table(name, title, columns, vertical=True)


ELONGATIONS = "0,1.27,2.54,3.81,5.08,6.35 mm"
"""The paper's membrane elongations."""
ELONGATION_CURVE = "0:6.35 mm:64"


@command("--elongation '0:6.35 mm:6' --set 'E_m=6.95 MPa'")
class MembraneTopic(Topic):
    """Compute the sag of the membrane by von Karman and by linear theory, skin stiffness and damping, by pre-stretch."""

    pre_stretch: str | None = option(
        "pre-stretch of the membrane, e.g. 0.0075 or '0.75 %%', one or a list", metavar="DELTA"
    )
    elongation: str | None = option("elongation of the membrane, e.g. '1.27 mm', one or a list", metavar="LENGTH")
    density: str = option("density of the membrane, kg/m^3 (default: %(default)s)", "1000")
    load: str | None = option("weight per length, e.g. '0.906 N/m'; instead of --density")
    files: FileOptions = group(FileOptions, "the table")

    def compute(self) -> CommandResult:
        values = read_settings(self.settings)
        if "delta" in values:
            raise UsageError(
                "--set delta: the membrane is computed at several pre-stretches; write --pre-stretch 0.0075"
            )
        specimen = replace_variables(Specimen(membrane=Membrane()), values)
        m = specimen.membrane or Membrane()
        delta = self._pre_stretches(m)
        q = (
            weight_per_length(m, read_number(self.density, DENSITY))
            if self.load is None
            else read_number(self.load, WEIGHT)
        )
        sags = [_sag_result(m, q, float(d)) for d in delta]
        skins = [replace(specimen, delta=float(d)).skin for d in delta]
        table = Table(
            "membrane",
            f"Membrane, E_m = {m.E_m / 1e6:.4g} MPa, under {q:.4g} N/m of its own weight",
            (
                Column("elongation", "m", delta * m.L_m, display_unit="mm", format_spec=".2f"),
                Column("pre_stretch", "", delta, "pre-stretch", format_spec=".5f"),
                Column("sag", "m", [s.centre_m for s in sags], "sag", "mm", ".3f"),
                Column("linear_sag", "m", [s.linear_theory_m for s in sags], "linear theory", "mm", ".3f"),
                Column("tension", "N", [s.tension_n for s in sags], "tension", format_spec=".4g"),
                Column("stretch", "", [s.stretch for s in sags], format_spec=".5f"),
                Column("k_point", "N/m", point_stiffness(m.L_m, m.b_m, m.h_m, m.E_m, delta), format_spec=".5g"),
                Column("k_s", "N/m^2", [s.k_s for s in skins]),
                Column("c_s", "kg/(m s)", [s.c_s for s in skins]),
            ),
        )
        note = (
            "Sag: bending with the tension that the deflection itself makes (von Karman) and the pre-stretch; linear theory leaves "
            "the former out. k_s and c_s belong to the weightless membrane at its pre-stretch."
        )
        question = plausibility_note("delta", float(delta.max()))
        notes = (note, question) if question else (note,)
        return CommandResult(
            "model membrane", specimen_record(specimen), (table,), notes, figures=_membrane_figures(table)
        )

    def _pre_stretches(self, membrane: Membrane) -> Array:
        if self.pre_stretch is not None and self.elongation is not None:
            raise UsageError("the pre-stretch is given twice, by --pre-stretch and --elongation; leave one out")
        if self.pre_stretch is not None:
            return np.array(read_values(self.pre_stretch, PRE_STRETCH))
        default = ELONGATION_CURVE if self.files.csv or self.files.picture else ELONGATIONS
        elongations = default if self.elongation is None else self.elongation
        return np.array(read_values(elongations, ELONGATION)) / membrane.L_m


def _membrane_figures(table: Table) -> tuple[PaperFigure, ...]:
    """Return sag, stiffness and damping over the elongation of the membrane."""
    columns = {column.name: column for column in table.columns}
    elongation = np.asarray(columns["elongation"].values)
    panels = []
    for title, *names in (
        ("sag of the centre", "sag", "linear_sag"),
        ("skin stiffness k_s", "k_s"),
        ("skin damping c_s", "c_s"),
    ):
        lines = tuple(
            Series(elongation, np.asarray(column.values), label=column.displayed_name)
            for column in (columns[name] for name in names)
        )
        unit, caption = columns[names[0]].unit or "", f"{title.capitalize()}."
        panels.append(PaperFigure(names[0], "elongation of the membrane", "m", title, unit, lines, caption))
    return tuple(panels)


def _sag_result(m: Membrane, q: float, delta: float) -> SagSolution:
    try:
        return sag(m, q, delta)
    except ParameterError:
        raise
    except (ValueError, RuntimeError) as error:  # the search for the tension failed
        raise UsageError(
            f"the sag under {q:g} N/m at pre-stretch {delta:g} cannot be computed ({error}); "
            "give a load that stretches the membrane noticeably, or less pre-stretch"
        ) from error
