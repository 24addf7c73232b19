"""Electrical: capacitance and loss factor over frequency and drive, loops of charge over voltage, leakage at held levels.

Needs a current monitor or a sense capacitor at the card ([[channels]] of the bench file). The first entry is a small sine: a
specimen that is open, short-circuited, does not move or moves the wrong way ends the run before any higher voltage, and so does
every later sine. Without a voltage monitor the voltage is the recorded drive through the amplifier's characteristic, and the
amplifier's own delay appears as loss.
"""

import math
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, ClassVar, Self

import numpy as np
from annotated_types import Interval, Len, Unit
from pydantic import model_validator

from drivers import BenchError, Hold, Sine
from model import QUANTITIES, Array, format_quantity
from protocols.base import (
    FLOW_KINDS,
    CheckResult,
    EstimatedQuantity,
    PlanEntry,
    Play,
    Protocol,
    Record,
    Recording,
    Series,
    SeriesAxis,
    Step,
)
from protocols.measurements.fields import QualityFlags, SampleRate, check_sample_rate, point_quality
from protocols.measurements.result_checks import signal_to_noise_check, usable_points
from protocols.signals import (
    SIGNIFICANCE,
    ConnectionLimits,
    ExpectedBending,
    ExpectedCapacitance,
    LargestLoss,
    Polarity,
    SmallestCapacitance,
    SmallestShare,
    flow,
    input_errors,
    leakage_current,
    sine_response,
    specimen_voltage,
)

SINE, LEVEL = "sine", "level"
SOURCE = "electrical, total uncertainty"

LEAST_CYCLES = 10
"""Fewest recorded cycles of a sine."""


@dataclass(frozen=True, slots=True)
class ElectricalPoint:
    """One sine (a leakage of NaN) or one held level (frequency 0, the others NaN).

    `_errors` are standard uncertainties by noise, `_total` with the stated errors of gains and delays.
    """

    frequency: Annotated[float, Unit("Hz"), "frequency, fitted to the recorded drive; 0: a held level"]
    drive: Annotated[float, Unit("V"), "peak-to-peak drive, or level held, at the amplifier's input"]
    voltage: Annotated[float, Unit("V"), "amplitude of the fundamental on the specimen, or voltage held"]
    capacitance: Annotated[float, Unit("F"), QUANTITIES["capacitance"].definition]
    capacitance_errors: Annotated[float, Unit("F"), "standard uncertainty of the capacitance by noise"]
    capacitance_total: Annotated[float, Unit("F"), "total standard uncertainty of the capacitance"]
    loss: Annotated[float, Unit("1"), QUANTITIES["loss_factor"].definition]
    loss_errors: Annotated[float, Unit("1"), "standard uncertainty of the loss factor by noise"]
    loss_total: Annotated[float, Unit("1"), "total standard uncertainty of the loss factor"]
    energy: Annotated[float, Unit("J"), QUANTITIES["energy_per_cycle"].definition]
    energy_errors: Annotated[float, Unit("J"), "standard uncertainty of the energy per cycle by noise"]
    energy_total: Annotated[float, Unit("J"), "total standard uncertainty of the energy per cycle"]
    power: Annotated[float, Unit("W"), "energy per cycle times frequency"]
    bending: Annotated[float, Unit("m/V"), "in-phase displacement per volt on the specimen; negative: reversed"]
    bending_errors: Annotated[float, Unit("m/V"), "standard uncertainty of the bending"]
    leakage: Annotated[float, Unit("A"), QUANTITIES["leakage_current"].definition]
    leakage_errors: Annotated[float, Unit("A"), "standard uncertainty of the leakage by noise"]
    leakage_total: Annotated[float, Unit("A"), "total standard uncertainty of the leakage"]
    quality: QualityFlags

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        if not self.frequency:
            leakage = format_quantity(self.leakage, self.leakage_total, "A", "leakage_current")
            return f"{self.voltage:.4g} V held: leakage {leakage}"
        return (
            f"{self.frequency:.4g} Hz, {self.voltage:.4g} V: {format_quantity(self.capacitance, self.capacitance_total, 'F', 'capacitance')}, "
            f"loss factor {format_quantity(self.loss, self.loss_total, '1', 'loss_factor')}"
        )


class Electrical(Protocol):
    """Capacitance, loss and charge-voltage loops over frequency and drive; leakage and insulation resistance at held levels."""

    name: ClassVar[str] = "electrical"
    title: ClassVar[str] = "Electrical"
    point_type: ClassVar[type] = ElectricalPoint
    axes: ClassVar[tuple[str, str]] = ("frequency", "capacitance")
    default_plot: ClassVar[str] = "charge"
    input_kinds: ClassVar[tuple[str, ...]] = FLOW_KINDS

    frequencies_hz: Annotated[
        tuple[Annotated[float, Interval(ge=1, le=500)], ...], Unit("Hz"), Len(1, 50), "frequencies of the sines"
    ] = (20.0, 50.0, 100.0, 150.0, 200.0, 400.0)
    drives_v: Annotated[
        tuple[Annotated[float, Interval(gt=0, le=5)], ...],
        Unit("V"),
        Len(1, 20),
        "peak-to-peak drives at the amplifier's input, played from the smallest to the largest",
    ] = (0.5, 2.0, 5.0)
    check_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=0.5), "peak-to-peak drive of the check before higher voltages"
    ] = 0.2
    check_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=50), "frequency of the check, far below resonance"] = 20.0
    levels_v: Annotated[
        tuple[Annotated[float, Interval(ge=0, le=5)], ...], Unit("V"), Len(0, 20), "levels held for the leakage"
    ] = (3.5, 5.0)
    wait_s: Annotated[
        float, Unit("s"), Interval(ge=0.5, le=120), "wait at rest, and again at a level, before its recording"
    ] = 3.5
    record_s: Annotated[float, Unit("s"), Interval(ge=0.2, le=60), "duration of each recording"] = 1.0
    polarity: Polarity = 1
    smallest_f: SmallestCapacitance = 2e-10
    largest_loss: LargestLoss = 0.5
    expected_f: ExpectedCapacitance = 0.0
    expected_bending: ExpectedBending = 0.0
    smallest_share: SmallestShare = 0.7
    sample_rate_hz: SampleRate = 49_975.0
    """No multiple of the frequencies: aliases of the current's jump, where the amplifier's slope changes, fall between its harmonics."""

    @model_validator(mode="after")
    def _check_sample_rate(self) -> Self:
        highest = max(*self.frequencies_hz, self.check_hz)
        check_sample_rate(self.sample_rate_hz, 20 * highest, f"for the loss at {highest:g} Hz")
        return self

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        sines = [(self.check_hz, self.check_v)]
        sines += [(f, drive) for drive in sorted(self.drives_v) for f in self.frequencies_hz]
        levels = sorted((level for level in self.levels_v if level != rest_v), key=lambda level: abs(level - rest_v))
        hold_s = self.wait_s + self.record_s + 2.0
        return (
            *(self._sine_entry(f, drive, rest_v) for f, drive in sines),
            *(
                PlanEntry(
                    f"{level:g} V held",
                    (Hold(rest_v, hold_s), Hold(level, hold_s)),
                    2 * hold_s,
                    (LEVEL, level, 0.0),
                )
                for level in levels
            ),
        )

    def _sine_entry(self, f: float, drive: float, rest_v: float) -> PlanEntry:
        duration_s = self._sine_s(f)
        cycles = math.ceil((duration_s + 1.5) * f)
        return PlanEntry(
            f"{f:g} Hz, {drive:g} V peak to peak",
            (Sine(f, drive / 2, rest_v, cycles),),
            duration_s + 0.8,
            (SINE, f, drive),
        )

    def _sine_s(self, f: float) -> float:
        return math.ceil(max(self.record_s * f, LEAST_CYCLES)) / f

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        if entry.key[0] == LEVEL:
            for hold in entry.drives:
                yield Play(hold, self.wait_s)
                yield Record(self.record_s)
            return
        f = float(entry.key[1])
        yield Play(entry.drives[0], max(0.3, 3 / f))
        recording = yield Record(self._sine_s(f))
        if fault := self._fault(recording, f):
            raise BenchError(f"{entry.label}: {fault}; no higher voltage is applied")

    def _fault(self, recording: Recording, f: float) -> str:
        """Return what is wrong with the specimen's connection as a sentence; empty if nothing is."""
        try:
            seen = sine_response(recording)[1]
        except ValueError as error:
            return str(error)
        is_first = isinstance(recording.drive, Sine) and 2 * recording.drive.amplitude_v <= self.check_v
        limits = ConnectionLimits.of(self)
        limits = limits if is_first else replace(limits, expected_f=0.0, expected_bending=0.0)
        checks = [each for each in seen.checks(limits) if not each.passed]
        if f > self.check_hz:  # nearer to the resonance only the capacitance counts
            checks = [each for each in checks if each.unit == "F"]
        return checks[0].text if checks else ""

    def with_history(self, points: Mapping[str, Array]) -> Self:
        return self.model_copy(update=ConnectionLimits.of(self).expected(points))

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> ElectricalPoint:
        drive = float(key[1] if key[0] == LEVEL else key[2])
        quality = point_quality(recordings[-1:], simulated, {})
        columns: dict[str, Any] = dict.fromkeys(ElectricalPoint.__annotations__, math.nan)
        if key[0] == LEVEL:
            rest, held = recordings[-2:]
            flows = [flow(each) for each in (rest, held)]
            voltage = specimen_voltage(held)
            leakage = leakage_current(
                flows[1].values, flows[0].values, held.rate_hz, input_errors(voltage, flows[1]), flows[1].channel.kind == FLOW_KINDS[1]
            )  # fmt: skip
            columns |= {"frequency": 0.0, "drive": drive, "voltage": float(voltage.values.mean()), "quality": quality}
            names = {"leakage": leakage}
        else:
            seen, connection = sine_response(recordings[-1])
            columns |= {
                "frequency": seen.frequency_hz,
                "drive": drive,
                "voltage": abs(seen.voltage[0]),
                "quality": quality,
            }
            columns |= {"power": seen.energy.value * seen.frequency_hz}
            columns |= {"bending": connection.bending, "bending_errors": connection.bending_errors}
            names = {"capacitance": seen.capacitance, "loss": seen.loss, "energy": seen.energy}
        for name, figure in names.items():
            columns |= dict(zip((name, f"{name}_errors", f"{name}_total"), figure, strict=True))
        return ElectricalPoint(**columns)

    def series(self, key: tuple[float | str, ...], recordings: Sequence[Recording]) -> tuple[Series, ...]:
        if key[0] == LEVEL:
            return ()
        voltage, charge, error = sine_response(recordings[-1])[0].loop()
        return (
            Series(
                voltage,
                charge,
                np.full(charge.size, error),
                x_axis=SeriesAxis("voltage", "V", "voltage on the specimen, less its mean"),
                y_axis=SeriesAxis("charge", "C", "charge of the specimen, less its mean"),
                name=self.default_plot,
                label=f"{float(key[1]):g} Hz, {float(key[2]):g} V",
            ),
        )

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        good = usable_points(list(points))
        sines = [p for p in good if p.frequency > 0]
        lowest = min((p.frequency for p in sines), default=0.0)
        found = []
        for p in (p for p in sines if p.frequency < 1.01 * lowest):
            where = f"{p.frequency:.3g} Hz at {p.drive:g} V"
            found += [
                EstimatedQuantity.listed(f"capacitance, {where}", p.capacitance, p.capacitance_total, SOURCE),
                EstimatedQuantity.listed(f"loss_factor, {where}", p.loss, p.loss_total, SOURCE),
                EstimatedQuantity.listed(f"energy_per_cycle, {where}", p.energy, p.energy_total, SOURCE),
            ]
        for p in (p for p in good if not p.frequency):
            where = f"{p.drive:g} V held"
            found.append(EstimatedQuantity.listed(f"leakage_current, {where}", p.leakage, p.leakage_total, SOURCE))
            if p.voltage * p.leakage > 0 and abs(p.leakage) > SIGNIFICANCE * p.leakage_errors:
                ohm = p.voltage / p.leakage
                error = ohm * p.leakage_total / abs(p.leakage)
                found.append(EstimatedQuantity.listed(f"insulation_resistance, {where}", ohm, error, SOURCE))
        return tuple(found)

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        names = (each.name for each in self.estimates(points) if each.name.startswith("capacitance"))
        return tuple(names) or ("capacitance",)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        good = [p for p in usable_points(points) if p.frequency > 0]
        return signal_to_noise_check("capacitance, smallest", [(p.capacitance, p.capacitance_errors) for p in good])
