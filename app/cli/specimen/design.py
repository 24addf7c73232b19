"""Design topics of the command `model`: the added mass for a resonance, and the drive for an amplitude, from a calibration."""

from abc import abstractmethod
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from annotated_types import Interval

from app.cli.model_options import ShapeOptions, Topic, describe_specimen, read_settings, read_specimen
from app.cli.options import FOLDER, command, group, option
from app.cli.output import CommandResult
from app.common import Column, Table, UsageError, read_number
from app.explore import describe_reach, divided, share_that_moves
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
from model.studies import FULL_AMPLITUDE_V, DesignAnswer, EstimateSet, required_drive, required_mass

AMPLITUDE = ParameterSpec("amplitude", "m", Interval(gt=0), "max - min of the displacement", None)
MEMBRANE_NAMES = {spec.name for spec in parameter_specs(Membrane)}
WITHOUT_ERRORS = (
    "No --specimen with a calibration is given: the paper's values, or the values of --set, without uncertainties."
)


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
    specimen: str | None = option("specimen with the calibration and uncertainties to use", metavar="NAME")
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
    specimen: str | None = option("specimen with the calibration and uncertainties to use", metavar="NAME")
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


def _answer_table(
    name: str, title: str, names: Sequence[str], answers: Sequence[DesignAnswer], unit: tuple[str, str]
) -> Table:
    shown, si = unit
    values = [answer.value for answer in answers]
    columns = [Column("question", "", list(names), "for")]
    errors = [answer.standard_error for answer in answers]
    if None in errors:
        columns.append(Column("value", si, values, "needed", shown, ".4g"))
    else:
        factor, standard_errors = SCALES.get(shown, 1), np.array(errors, float)
        pairs = zip(values, standard_errors, strict=True)
        columns += [
            Column("needed", "", [format_with_uncertainty(factor * v, factor * e, shown) for v, e in pairs]),
            Column("value", si, values, displayed=False),
            Column("standard_error", si, standard_errors, displayed=False),
            Column("low", si, values - COVERAGE_FACTOR_95 * standard_errors, "95 % from", shown, ".4g"),
            Column("high", si, values + COVERAGE_FACTOR_95 * standard_errors, "to", shown, ".4g"),
        ]
    return Table(name, title, tuple(columns))
