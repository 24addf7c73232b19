"""Design topics of the command `model`: the added mass for a resonance, the drive for an amplitude, and its power, from a calibration."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from annotated_types import Interval

from app.cli.model_options import ShapeOptions, Topic, describe_specimen, read_settings, read_specimen
from app.cli.options import FOLDER, command, group, option
from app.cli.output import CommandResult
from app.common import Column, Table, UsageError, read_number, read_numbers, read_stated
from app.explore import NO_LOAD, WAVEFORMS, describe_reach, divided, measured_load, share_that_moves
from app.identification import PAPER_MODEL, ActiveModel, load_active_model
from model import (
    COVERAGE_FACTOR_95,
    SCALES,
    Membrane,
    ParameterSpec,
    Specimen,
    format_with_uncertainty,
    parameter_specs,
    specimen_record,
)
from model.response import PERIODIC_FREQUENCY_SPEC
from model.studies import (
    FULL_AMPLITUDE_V,
    LOAD_SPECS,
    DesignAnswer,
    EstimateSet,
    battery_life,
    least_power,
    load_set,
    required_drive,
    required_mass,
)

AMPLITUDE = ParameterSpec("amplitude", "m", Interval(gt=0), "max - min of the displacement", None)
BATTERY = ParameterSpec("battery", "W h", Interval(gt=0), "usable energy of the battery", None)
ON_SHARE = ParameterSpec("on-share", "1", Interval(gt=0, le=1), "share of the time in which the driver drives", None)
IDLE = ParameterSpec("idle", "W", Interval(ge=0), "power that the driver takes at all times", None)
MEMBRANE_NAMES = {spec.name for spec in parameter_specs(Membrane)}
WITHOUT_ERRORS = (
    "No --specimen with a calibration is given: the paper's values, or the values of --set, without uncertainties."
)
CALIBRATED = option("specimen with the calibration and uncertainties to use", metavar="NAME")


class DesignTopic(Topic):
    """A question about a specimen that its active calibration answers, with the total uncertainty of the calibration."""

    specimen: str | None
    folder: Path
    shapes: ShapeOptions

    @abstractmethod
    def answer(self, specimen: Specimen, estimates: EstimateSet | None, n: int) -> tuple[tuple[Table, ...], list[str]]:
        """Return tables and notes."""

    def compute(self) -> CommandResult:
        active = self._active_model()
        specimen = read_specimen(self, base=active)
        estimates = active.estimates_for(specimen)
        estimates = None if estimates is None else estimates.without(read_settings(self.settings))
        choice = self.shapes.choose(specimen)
        tables, notes = self.answer(specimen, estimates, choice.n)
        source = f"From {active.description}, {describe_specimen(specimen)}."
        notes = [source if estimates is not None else WITHOUT_ERRORS, *notes]
        if estimates is not None and specimen.membrane is not None and not set(estimates.names) & MEMBRANE_NAMES:
            notes.append(
                "The calibration has no parameters of the membrane: the paper's values are used, without uncertainties."
            )
        return CommandResult(f"model {tables[0].name}", specimen_record(specimen), tables, tuple(notes))

    def _active_model(self) -> ActiveModel:
        if self.specimen is None:
            return PAPER_MODEL
        active = load_active_model(self.folder, self.specimen)
        if active.problem or active.estimates is None:
            reason = active.problem or f"{active.description} have no uncertainties"
            raise UsageError(
                f"{self.specimen} has no calibration in {self.folder} that can be used ({reason}); measure and accept one: "
                "tactor-bench identify RUNS --accept"
            )
        return active


@command("--frequency '160 Hz' --specimen T7")
class AddedMassTopic(DesignTopic):
    """Compute the added mass for a resonance at a frequency, with the uncertainty of a calibration."""

    frequency: str = option("frequency of the resonance (default: %(default)s)", "160 Hz")
    specimen: str | None = CALIBRATED
    folder: Path = FOLDER
    shapes: ShapeOptions = group(ShapeOptions)

    def answer(self, specimen: Specimen, estimates: EstimateSet | None, n: int) -> tuple[tuple[Table, ...], list[str]]:
        hz = read_number(self.frequency, PERIODIC_FREQUENCY_SPEC)
        peak = required_mass(specimen, hz, estimates, n=n)
        undamped = required_mass(specimen, hz, estimates, undamped=True, n=n)
        names = [f"largest response at {hz:g} Hz", f"undamped natural frequency of {hz:g} Hz"]
        answers = [peak, undamped]
        share = None if self.specimen is None else share_that_moves(self.folder, self.specimen)
        if share is not None:
            names += [f"{name}, to put into the cylinder" for name in names]
            answers += [divided(answer, share) for answer in answers]
        table = _answer_table("added-mass", f"Added mass for {hz:g} Hz", names, answers, ("g", "kg"))
        present = (
            f"The present added mass is {1e3 * specimen.tactor.m_add:.4g} g. It is the mass that moves with the centre: only a share of "
            "the mass in the cylinder moves (the paper's 11 g moved as 7.73 g)."
        )
        return (table,), [present]


@command("--amplitude '100 um' --frequency '200 Hz' --elongation '6.35 mm' --specimen T7")
class DriveTopic(DesignTopic):
    """Compute the drive for an amplitude at a frequency, free or on a skin, with the uncertainty of a calibration."""

    amplitude: str = option("max - min of the displacement (default: %(default)s)", "100 um")
    frequency: str = option("frequency of the sine (default: %(default)s)", "200 Hz")
    specimen: str | None = CALIBRATED
    folder: Path = FOLDER
    shapes: ShapeOptions = group(ShapeOptions)

    def answer(self, specimen: Specimen, estimates: EstimateSet | None, n: int) -> tuple[tuple[Table, ...], list[str]]:
        hz, amplitude_m = read_number(self.frequency, PERIODIC_FREQUENCY_SPEC), read_number(self.amplitude, AMPLITUDE)
        drive = required_drive(specimen, hz, amplitude_m, estimates, n=n)
        names = (f"sine of {hz:g} Hz for {1e6 * amplitude_m:g} µm, peak to peak",)
        table = _answer_table("drive", "Drive at the amplifier's input", names, (drive,), ("V", "V"))
        reach = describe_reach(specimen, drive, hz, n)
        if drive.value > 2 * FULL_AMPLITUDE_V:
            return (table,), [reach]
        lag = (
            "with the hysteresis of the full drive"
            if specimen.hysteresis
            else "without hysteresis, which this model does not have"
        )
        return (table,), [f"{reach} In proportion to the drive, {lag}."]


@command(
    "--amplitude '100 um' --frequencies '100...250 step 10' --battery '2 W h' --efficiency '0.7 +- 0.05' --specimen T7"
)
class PowerTopic(DesignTopic):
    """Compute which drive gives an amplitude for the least power, and how long a battery lasts, with total uncertainties."""

    amplitude: str = option("max - min of the displacement (default: %(default)s)", "100 um")
    frequencies: str = option("frequencies to choose from (default: %(default)s)", "100...250 step 10")
    capacitance: str | None = option("at 20 Hz, e.g. '1.83 nF +- 0.02 nF' (default: newest run that measured it)")
    loss: str | None = option("loss factor at 20 Hz, e.g. '0.03 +- 0.002' (default: newest run that measured it)")
    efficiency: str = option("share of its input that the driver delivers, e.g. '0.7 +- 0.05'", "1")
    battery: str | None = option("usable energy of a battery, e.g. '2 W h'", metavar="ENERGY")
    on_share: str = option("share of the time in which the driver drives (default: %(default)s)", "1")
    idle: str = option("power that the driver takes at all times (default: %(default)s)", "0 W")
    specimen: str | None = CALIBRATED
    folder: Path = FOLDER
    shapes: ShapeOptions = group(ShapeOptions)

    def answer(self, specimen: Specimen, estimates: EstimateSet | None, n: int) -> tuple[tuple[Table, ...], list[str]]:
        amplitude_m = read_number(self.amplitude, AMPLITUDE)
        frequencies = [float(PERIODIC_FREQUENCY_SPEC.check(hz)) for hz in read_numbers(self.frequencies, "Hz")]
        load = self._load()
        found = [least_power(specimen, each, frequencies, amplitude_m, load, estimates, n=n) for each in WAVEFORMS]
        columns = [
            Column("waveform", "", [each.waveform for each in found]),
            Column("frequency", "Hz", [each.frequency_hz for each in found], "at", "Hz", ".4g"),
            *_answer_columns("drive", [each.drive_v for each in found], ("V", "V")),
            *_answer_columns("specimen", [each.specimen_w for each in found], ("mW", "W")),
            *_answer_columns("driver", [each.driver_w for each in found], ("mW", "W")),
        ]
        notes = [
            "The driver recovers nothing; its power is for the drive alone. The volts are at the bench amplifier's input, peak to peak."
        ]
        if self.battery is not None:
            given = (
                read_number(self.battery, BATTERY),
                read_number(self.on_share, ON_SHARE),
                read_number(self.idle, IDLE),
            )
            lives = [battery_life(given[0], each.driver_w, *given[1:]) for each in found]
            columns += _answer_columns("battery", lives, ("h", "h"))
        best = min(found, key=lambda each: each.driver_w.value)
        notes.insert(0, f"Least power for {1e6 * amplitude_m:g} µm: {best.waveform} of {best.frequency_hz:g} Hz.")
        return (Table("power", f"Drives for {1e6 * amplitude_m:g} µm with the least power", tuple(columns)),), notes

    def _load(self) -> EstimateSet:
        seen = () if self.specimen is None else measured_load(self.folder, self.specimen)
        pairs = [(each.value, each.standard_error) for each in seen]
        given = []
        for at, (text, spec) in enumerate(zip((self.capacitance, self.loss), LOAD_SPECS.values(), strict=False)):
            if text is None and not pairs:
                raise UsageError(f"{NO_LOAD} --capacitance '1.83 nF' --loss 0.03")
            given.append(pairs[at] if text is None else _read_value(text, spec))
        return load_set(given[0], given[1], _read_value(self.efficiency, LOAD_SPECS["efficiency"]))


def _read_value(text: str, spec: ParameterSpec) -> tuple[float, float]:
    """Return value and standard uncertainty, 0 if only a value is stated."""
    is_uncertain = "+-" in text or "±" in text
    return read_stated(text, spec) if is_uncertain else (read_number(text, spec), 0.0)


def _answer_table(
    name: str, title: str, names: Sequence[str], answers: Sequence[DesignAnswer], unit: tuple[str, str]
) -> Table:
    needed = _answer_columns("", answers, unit)
    return Table(name, title, (Column("question", "", list(names), "for"), *needed))


def _answer_columns(name: str, answers: Sequence[DesignAnswer], unit: tuple[str, str]) -> list[Column]:
    """Return the columns of values with their errors, named `NAME`, `NAME_standard_error` ..., or `value`, ... for no name."""
    shown, si = unit
    prefix, title = f"{name}_" if name else "", name or "needed"
    values = [answer.value for answer in answers]
    errors = [answer.standard_error for answer in answers]
    if None in errors:
        return [Column(f"{prefix}value", si, values, title, shown, ".4g")]
    factor, standard_errors = SCALES.get(shown, 1), np.array(errors, float)
    pairs = zip(values, standard_errors, strict=True)
    interval = (
        Column(
            f"{prefix}low",
            si,
            values - COVERAGE_FACTOR_95 * standard_errors,
            "95 % from",
            shown,
            ".4g",
            displayed=not name,
        ),
        Column(
            f"{prefix}high", si, values + COVERAGE_FACTOR_95 * standard_errors, "to", shown, ".4g", displayed=not name
        ),
    )
    return [
        Column(title, "", [format_with_uncertainty(factor * v, factor * e, shown) for v, e in pairs]),
        Column(f"{prefix}value", si, values, displayed=False),
        Column(f"{prefix}standard_error", si, standard_errors, displayed=False),
        *interval,
    ]
