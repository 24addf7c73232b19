"""Design questions of a specimen: the added mass for a resonance, the drive for an amplitude and its power, with total uncertainties."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from app.explore.state import ExploreSetting
from app.identification import load_active_model, read_calibrations
from model import COVERAGE_FACTOR_95, AmplifierMap, EstimatedQuantity, ParameterError, Specimen, format_with_uncertainty
from model.response import choose_shapes, response_curve
from model.studies import (
    FULL_AMPLITUDE_V,
    DesignAnswer,
    EstimateSet,
    PowerWaveform,
    drive_power,
    load_set,
    required_drive,
    required_mass,
)

WAVEFORMS: tuple[PowerWaveform, ...] = ("sine", "square", "belt")
NO_LOAD = (
    "Its power needs capacitance and loss factor: measure the electrical properties of the specimen, or state both in "
    "tactor-bench model power"
)


@dataclass(frozen=True, slots=True)
class DesignQuestion:
    """Both questions about one specimen.

    Attributes:
        resonance_hz: required frequency of the largest response.
        amplitude_m, drive_hz: max - min that a drive is to give at a frequency.
        calibrated: folder and name of the specimen whose active calibration answers; None: the setting of the sliders.
    """

    setting: ExploreSetting
    resonance_hz: float
    amplitude_m: float
    drive_hz: float
    calibrated: tuple[Path, str] | None = None


@dataclass(frozen=True, slots=True)
class DesignAnswers:
    """The answers as sentences, and their source."""

    mass: str
    drive: str
    power: str
    source: str


def answer_design(question: DesignQuestion) -> Iterator[DesignAnswers]:
    """Yield the answers; a question that cannot be answered has the reason instead.

    Raises:
        ParameterError: the specimen is not physical, or has no calibration.
    """
    specimen, estimates, share, source = _source_of(question)
    n = choose_shapes(specimen.tactor, specimen.skin).n
    yield DesignAnswers(
        _mass_sentence(question, specimen, estimates, share, n),
        _drive_sentence(question, specimen, estimates, n),
        _power_sentence(question, specimen, estimates, n),
        source,
    )


def share_that_moves(folder: Path, specimen: str) -> EstimatedQuantity | None:
    """Return the share of a mass in the cylinder that moves, where the active calibration holds it."""
    estimates = read_calibrations(folder, specimen).get().estimates
    return next((each for each in estimates if each.name == "mass_fraction"), None)


def divided(answer: DesignAnswer, share: EstimatedQuantity) -> DesignAnswer:
    """Return an answer over a share, their errors taken as independent."""
    value = answer.value / share.value
    if answer.standard_error is None:
        return DesignAnswer(value, None)
    relative = math.hypot(answer.standard_error / answer.value, share.standard_error / share.value)
    return DesignAnswer(value, abs(value) * relative)


def describe_reach(specimen: Specimen, drive: DesignAnswer, frequency_hz: float, n: int) -> str:
    """Return the volts of a drive on the specimen and the result of the largest drive, or that the target cannot be reached."""
    full_v = 2 * FULL_AMPLITUDE_V
    largest = float(response_curve(specimen, np.array([frequency_hz]), FULL_AMPLITUDE_V, n=n).peak_to_peak[0])
    if drive.value > full_v:
        return f"It cannot be reached: the amplifier takes {full_v:g} V peak to peak, which gives {1e6 * largest:.4g} µm there."
    amplifier = AmplifierMap()
    low_v, high_v = (float(amplifier.specimen_v(2.5 + side * drive.value / 2)) for side in (-1, 1))
    return f"On the specimen {low_v:.4g} to {high_v:.4g} V; {full_v:g} V peak to peak, the largest drive, gives {1e6 * largest:.4g} µm."


def _source_of(question: DesignQuestion) -> tuple[Specimen, EstimateSet | None, EstimatedQuantity | None, str]:
    setting = question.setting
    if question.calibrated is None:
        return setting.specimen, None, None, "From the sliders, without uncertainties."
    folder, name = question.calibrated
    active = load_active_model(folder, name)
    if active.problem or active.estimates is None:
        raise ParameterError(
            f"{name} has no calibration that can be used; measure, then Identify … (Shift+F7) and accept"
        )
    elongation_m = setting.value("delta") * active.membrane.L_m if setting.on_skin else None
    where = "free" if elongation_m is None else f"on the membrane at {1e3 * elongation_m:.3g} mm elongation"
    estimates = active.estimates if elongation_m is None else active.membrane_estimates
    text = f"From {active.description}, {where}; ± total standard uncertainty."
    return active.specimen(elongation_m), estimates, share_that_moves(folder, name), text


def _mass_sentence(
    question: DesignQuestion, specimen: Specimen, estimates: EstimateSet | None, share: EstimatedQuantity | None, n: int
) -> str:
    try:
        mass = required_mass(specimen, question.resonance_hz, estimates, n=n)
    except ParameterError as error:
        return str(error)
    text = f"{_with_error(mass, 1e3, 'g')} must move with the centre for the largest response at {question.resonance_hz:g} Hz"
    if share is not None:
        text += f"; to put into the cylinder: {_with_error(divided(mass, share), 1e3, 'g')}"
    return f"{text}. Present: {1e3 * specimen.tactor.m_add:.4g} g."


def _drive_sentence(question: DesignQuestion, specimen: Specimen, estimates: EstimateSet | None, n: int) -> str:
    hz, amplitude_m = question.drive_hz, question.amplitude_m
    try:
        drive = required_drive(specimen, hz, amplitude_m, estimates, n=n)
    except ParameterError as error:
        return str(error)
    text = f"{_with_error(drive, 1.0, 'V')} peak to peak at the amplifier's input for {1e6 * amplitude_m:g} µm at {hz:g} Hz."
    return f"{text} {describe_reach(specimen, drive, hz, n)}"


def measured_load(folder: Path, specimen: str) -> tuple[EstimatedQuantity, ...]:
    """Return capacitance and loss factor of the newest run that has both; empty without one."""
    from protocols import newest_estimates  # slow to import

    return newest_estimates(folder, specimen, "capacitance", "loss_factor")


def _power_sentence(question: DesignQuestion, specimen: Specimen, estimates: EstimateSet | None, n: int) -> str:
    seen = () if question.calibrated is None else measured_load(*question.calibrated)
    if not seen:
        return NO_LOAD
    load = load_set(*((each.value, each.standard_error) for each in seen))
    try:
        powers = [
            drive_power(specimen, each, question.drive_hz, question.amplitude_m, load, estimates, n=n)
            for each in WAVEFORMS
        ]
    except ParameterError as error:
        return str(error)
    best, *others = sorted(powers, key=lambda each: each.driver_w.value)
    rest = ", ".join(f"{each.waveform} {1e3 * each.driver_w.value:.3g} mW" for each in others)
    return (
        f"Least power there: {best.waveform}, {_with_error(best.driver_w, 1e3, 'mW')} from a driver without recovery, of which the specimen "
        f"takes {_with_error(best.specimen_w, 1e3, 'mW')} ({rest})."
    )


def _with_error(answer: DesignAnswer, factor: float, unit: str) -> str:
    value = factor * answer.value
    if answer.standard_error is None:
        return f"{value:.4g} {unit}"
    error = factor * answer.standard_error
    low, high = value - COVERAGE_FACTOR_95 * error, value + COVERAGE_FACTOR_95 * error
    return f"{format_with_uncertainty(value, error, unit)} (95 %: {low:.4g} to {high:.4g} {unit})"
