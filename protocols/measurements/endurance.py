"""Endurance: blocks of cycles of a sine, with snapshots of resonance, damping, gain, harmonics, capacitance and loss between them.

Every block and every snapshot is an entry of the plan with a point of its own, so that a killed program loses the cycles of one
block at most. A block's point has the statistics of the displacement, a snapshot's point the figures, whose changes against the
first snapshot are judged with their statistical uncertainties: errors of gains and delays, and the misfit of one mode by hysteresis,
are common to all snapshots of a run.
"""

import math
from collections.abc import Callable, Generator, Iterable, Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from typing import Annotated, Any, ClassVar, NamedTuple, Self

import numpy as np
from annotated_types import Interval, Unit
from pydantic import model_validator

from drivers import Drive, LevelAction, Sine
from model import QUANTITIES, format_quantity, format_with_uncertainty
from protocols.base import (
    FLOW_KINDS,
    CheckResult,
    Cycle,
    EstimatedQuantity,
    LevelExceeded,
    PlanEntry,
    Play,
    Protocol,
    Quality,
    Record,
    Recording,
    Series,
    SeriesAxis,
    Step,
    UnattendedRun,
    first_adapted,
)
from protocols.measurements.dwelt_response import check_response_present
from protocols.measurements.fields import (
    DampingRatio,
    DampingRatioError,
    DriveVpp,
    NaturalFrequency,
    NaturalFrequencyError,
    QualityFlags,
    SampleRate,
    check_sample_rate,
    modal_columns,
    point_quality,
)
from protocols.measurements.result_checks import SIGNIFICANCE_SIGMAS
from protocols.measurements.sine_dwell import sine_point
from protocols.measurements.sweep import Sweep, fit_one_mode
from protocols.signals import sine_response

CYCLES, SNAPSHOT = "cycles", "snapshot"
DRIFT = "drift"
"""Name of the series of the changes over the cycles."""
SOURCE = "snapshots, statistical uncertainty"

LONGEST_BLOCK_S = 1000.0
"""Longest block: over a longer one the clocks of source and card differ by more than the read-back of the drive allows."""

MAX_ENTRIES = 20_000
SMALLER_BLOCKS = (50_000, 20_000, 10_000, 5000, 2000, 1000, 800, 500, 200, 100)
"""Cycles of a block for a source with a shorter burst or a smaller memory."""

GAIN_CYCLES = 20
"""Cycles of the slow sine of a snapshot."""


class SnapshotSpacing(StrEnum):
    """Spacing of the snapshots over the cycles; stored in run files."""

    LOGARITHMIC = "logarithmic"
    FIXED = "fixed"


@dataclass(frozen=True, slots=True)
class EndurancePoint:
    """The end of a block (the figures are NaN), or a snapshot (the statistics are NaN). Uncertainties are standard and statistical."""

    cycles: Annotated[float, Unit("1"), "cycles so far, those before the run included"]
    low: Annotated[float, Unit("m"), "lowest displacement of the block"]
    high: Annotated[float, Unit("m"), "highest displacement of the block"]
    mean: Annotated[float, Unit("m"), "mean displacement of the block"]
    rms: Annotated[float, Unit("m"), "root mean square of the displacement about its mean in the block"]
    natural_frequency: NaturalFrequency
    natural_frequency_errors: NaturalFrequencyError
    damping: DampingRatio
    damping_errors: DampingRatioError
    gain: Annotated[float, Unit("m/V"), "amplitude of the displacement per volt at the amplifier's input, slow sine"]
    gain_errors: Annotated[float, Unit("m/V"), "standard uncertainty of the gain"]
    harmonics: Annotated[float, Unit("1"), "total harmonic distortion of the displacement, slow sine"]
    harmonics_errors: Annotated[float, Unit("1"), "standard uncertainty of the distortion"]
    capacitance: Annotated[float, Unit("F"), QUANTITIES["capacitance"].definition + "; NaN without its channel"]
    capacitance_errors: Annotated[float, Unit("F"), "standard uncertainty of the capacitance by noise"]
    loss: Annotated[float, Unit("1"), QUANTITIES["loss_factor"].definition + "; NaN without its channel"]
    loss_errors: Annotated[float, Unit("1"), "standard uncertainty of the loss factor by noise"]
    quality: QualityFlags

    @property
    def is_snapshot(self) -> bool:
        """Whether the point is a snapshot."""
        return math.isnan(self.rms)

    @property
    def summary(self) -> str:
        """The point in a line, for a log."""
        at = f"{self.cycles:.6g} cycles"
        if not self.is_snapshot:
            return f"{at}: displacement {1e6 * self.low:.1f} to {1e6 * self.high:.1f} µm, rms {1e6 * self.rms:.2f} µm"
        text = (
            f"{at}: natural frequency {format_quantity(self.natural_frequency, self.natural_frequency_errors, 'Hz')}, damping ratio "
            f"{format_with_uncertainty(self.damping, self.damping_errors)}, gain {format_quantity(self.gain, self.gain_errors, 'm/V')}"
        )
        if math.isnan(self.capacitance):
            return text
        return f"{text}, capacitance {format_quantity(self.capacitance, self.capacitance_errors, 'F', 'capacitance')}"


class DriftFigure(NamedTuple):
    """A figure of the snapshots: its column, its name for people, the sign of its change by damage, 0: either, and its setting."""

    column: str
    label: str
    damaged: int
    setting: str


FIGURES = (
    DriftFigure("natural_frequency", "natural frequency", -1, "resonance"),
    DriftFigure("damping", "damping ratio", 1, "damping"),
    DriftFigure("gain", "gain", 0, "gain"),
    DriftFigure("harmonics", "harmonics", 0, "harmonics"),
    DriftFigure("capacitance", "capacitance", -1, "capacitance"),
    DriftFigure("loss", "loss factor", 1, "loss"),
)

Change = Annotated[float, Unit("1"), Interval(gt=0, le=10)]
Action = LevelAction


class Damage(NamedTuple):
    """Signs of damage between two successive snapshots: its kind, the cycles of both, and the signs as text."""

    kind: str
    after: float
    before: float
    signs: str


class Endurance(Protocol):
    """100 to 10^8 cycles of a sine, with snapshots of resonance, damping, gain, harmonics, capacitance and loss; signs of damage."""

    name: ClassVar[str] = "endurance"
    title: ClassVar[str] = "Endurance"
    point_type: ClassVar[type] = EndurancePoint
    axes: ClassVar[tuple[str, str]] = ("cycles", "natural_frequency")
    default_plot: ClassVar[str] = DRIFT
    max_recording_scans: ClassVar[float] = math.inf
    repeatable: ClassVar[bool] = False

    frequency_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=500), "frequency of the cycles"] = 100.0
    peak_to_peak_v: DriveVpp = 4.0
    cycles: Annotated[int, Unit("1"), Interval(ge=100, le=100_000_000), "number of cycles of this run"] = 10_000_000
    earlier_cycles: Annotated[
        int, Unit("1"), Interval(ge=0, le=1_000_000_000), "cycles of the specimen before this run, added to its counts"
    ] = 0
    block_cycles: Annotated[
        int,
        Unit("1"),
        Interval(ge=100, le=100_000),
        "cycles of a block, which is played to its end and counted as a whole; a killed program loses one at most",
    ] = 50_000
    raw_s: Annotated[
        float, Unit("s"), Interval(ge=0, le=1000), "samples kept of each block, from its start; 1000 s keep all"
    ] = 0.2
    cool_s: Annotated[float, Unit("s"), Interval(ge=0, le=3600), "pause at rest after each block, for cooling"] = 0.0
    spacing: Annotated[SnapshotSpacing, "spacing of the snapshots"] = SnapshotSpacing.LOGARITHMIC
    first_cycles: Annotated[
        int, Unit("1"), Interval(ge=10, le=100_000_000), "cycles before the second snapshot, logarithmic spacing"
    ] = 1000
    per_decade: Annotated[
        int, Unit("1"), Interval(ge=1, le=50), "snapshots per decade of cycles, logarithmic spacing"
    ] = 4
    interval_cycles: Annotated[
        int, Unit("1"), Interval(ge=100, le=100_000_000), "cycles between snapshots, fixed spacing"
    ] = 500_000
    sweep_low_hz: Annotated[float, Unit("Hz"), Interval(ge=1, le=2000), "lowest frequency of a snapshot's sweep"] = 40.0
    sweep_high_hz: Annotated[float, Unit("Hz"), Interval(ge=2, le=2000), "highest frequency of a snapshot's sweep"] = (
        340.0
    )
    sweep_s: Annotated[float, Unit("s"), Interval(ge=0.02, le=60), "duration of one pass of the sweep"] = 0.5
    periods: Annotated[int, Unit("1"), Interval(ge=2, le=1000), "analysed periods of the sweep, of two passes each"] = 4
    snapshot_v: Annotated[float, Unit("V"), Interval(gt=0, le=5), "peak-to-peak drive of a snapshot"] = 1.0
    gain_hz: Annotated[
        float, Unit("Hz"), Interval(ge=1, le=50), "slow sine of a snapshot: gain, harmonics, capacitance, loss"
    ] = 20.0
    resonance_change: Annotated[Change, "limit of the relative change of the natural frequency"] = 0.1
    resonance_action: Annotated[Action, "action beyond it"] = LevelAction.ASK
    damping_change: Annotated[Change, "limit of the relative change of the damping ratio"] = 1.0
    damping_action: Annotated[Action, "action beyond it"] = LevelAction.WARNING
    gain_change: Annotated[Change, "limit of the relative change of the gain"] = 0.3
    gain_action: Annotated[Action, "action beyond it"] = LevelAction.WARNING
    harmonics_change: Annotated[Change, "limit of the relative change of the harmonics"] = 1.0
    harmonics_action: Annotated[Action, "action beyond it"] = LevelAction.WARNING
    capacitance_change: Annotated[Change, "limit of the relative change of the capacitance"] = 0.1
    capacitance_action: Annotated[Action, "action beyond it"] = LevelAction.WARNING
    loss_change: Annotated[Change, "limit of the relative change of the loss factor"] = 1.0
    loss_action: Annotated[Action, "action beyond it"] = LevelAction.WARNING
    damage_step: Annotated[
        float,
        Unit("1"),
        Interval(gt=0, le=1),
        "smallest relative step between successive snapshots that is a sign of damage, if it is significant too",
    ] = 0.01
    damage_action: Annotated[Action, "action after signs of a crack or of delamination"] = LevelAction.ASK
    unattended: Annotated[bool, "run with nobody at the bench; refused without the protection that this needs"] = False
    responsible: Annotated[str, "person who is responsible for an unattended run and can be reached"] = ""
    longest_s: Annotated[
        float,
        Unit("s"),
        Interval(ge=0, le=1e7),
        "duration after which an unattended run ends at rest; it can be resumed; 0: not stated",
    ] = 0.0
    stop_from_phone: Annotated[
        bool,
        "allow the stop of an unattended run from a phone, at an address with a token that is valid for this run only",
    ] = False
    sample_rate_hz: SampleRate = 10_000.0

    @model_validator(mode="after")
    def _check_parameters(self) -> Self:
        check_sample_rate(self.sample_rate_hz, 20 * self.frequency_hz, f"for a sine of {self.frequency_hz:g} Hz")
        if self.block_cycles > LONGEST_BLOCK_S * self.frequency_hz:
            raise ValueError(
                f"block_cycles of {self.block_cycles} at {self.frequency_hz:g} Hz take {self.block_cycles / self.frequency_hz:.0f} s, at "
                f"most {LONGEST_BLOCK_S:g} s are allowed: use {LONGEST_BLOCK_S * self.frequency_hz:.0f} or fewer"
            )
        if (entries := self.cycles / self.block_cycles + len(self._snapshots())) > MAX_ENTRIES:
            raise ValueError(
                f"block_cycles of {self.block_cycles} and the snapshots make {entries:.0f} entries, at most {MAX_ENTRIES} are allowed: use longer "
                "blocks or fewer snapshots"
            )
        if self.stop_from_phone and not self.unattended:
            raise ValueError("stop_from_phone is for unattended runs: set unattended too, or leave stop_from_phone out")
        _ = self._sweep  # with its own checks
        return self

    # -- plan ----------------------------------------------------------------------------------------------------------

    @property
    def _sweep(self) -> Sweep:
        return Sweep(
            start_hz=self.sweep_low_hz,
            stop_hz=self.sweep_high_hz,
            peak_to_peak_v=self.snapshot_v,
            sweep_s=self.sweep_s,
            periods=self.periods,
            sample_rate_hz=self.sample_rate_hz,
        )

    def _snapshots(self) -> list[int]:
        """Return the cycles of this run after which a snapshot follows, from 0 on."""
        if self.spacing is SnapshotSpacing.FIXED:
            return [*range(0, self.cycles, self.interval_cycles), self.cycles]
        decades = math.log10(max(self.cycles / self.first_cycles, 1.0))
        steps = range(math.floor(self.per_decade * decades + 1e-9) + 1)
        counts = {round(self.first_cycles * 10 ** (k / self.per_decade)) for k in steps}
        return sorted({0, self.cycles} | {count for count in counts if count < self.cycles})

    def adapted(self, rest_v: float, reason_unsupported: Callable[[Drive], str]) -> Self:
        """Play smaller blocks, and sweep faster, if the source's burst or memory is small."""
        sweep = self._sweep.adapted(rest_v, reason_unsupported)
        changes = {"sweep_s": sweep.sweep_s, "periods": sweep.periods} if sweep.pieces == 1 else {}
        smaller = [{**changes, "block_cycles": n} for n in SMALLER_BLOCKS if n < self.block_cycles]
        return first_adapted([changes, *smaller] if changes else smaller, self, rest_v, reason_unsupported)

    def plan(self, rest_v: float) -> tuple[PlanEntry, ...]:
        snapshots = self._snapshots()
        entries = [self._snapshot_entry(snapshots[0], rest_v)]
        for begin, end in pairwise(snapshots):
            blocks = math.ceil((end - begin) / self.block_cycles)
            ends = [begin + k * (end - begin) // blocks for k in range(blocks + 1)]
            entries += [self._block_entry(*pair, rest_v) for pair in pairwise(ends)]
            entries.append(self._snapshot_entry(end, rest_v))
        return tuple(entries)

    def _block_entry(self, begin: int, end: int, rest_v: float) -> PlanEntry:
        drive = Sine(self.frequency_hz, self.peak_to_peak_v / 2, rest_v, end - begin)
        first, last = begin + self.earlier_cycles, end + self.earlier_cycles
        seconds = drive.duration_s + self.cool_s + 0.5
        label = f"cycles {first + 1} to {last}"
        return PlanEntry(label, (drive,), seconds, (CYCLES, last), stored_s=min(self.raw_s + 0.5, seconds))

    def _snapshot_entry(self, at: int, rest_v: float) -> PlanEntry:
        sweeps, count = self._sweep.drives(rest_v), at + self.earlier_cycles
        slow = Sine(self.gain_hz, self.snapshot_v / 2, rest_v, GAIN_CYCLES + math.ceil(1.5 * self.gain_hz))
        seconds = sum(drive.duration_s for drive in sweeps) + slow.duration_s + 0.5
        return PlanEntry(f"snapshot at {count} cycles", (*sweeps, slow), seconds, (SNAPSHOT, count))

    def measure(self, entry: PlanEntry, rest_v: float) -> Generator[Step, Any, None]:
        if entry.key[0] == CYCLES:
            (block,) = entry.drives
            assert isinstance(block, Sine)  # by `plan`
            yield Cycle(block, self.raw_s, self.cool_s)
            return
        yield from self._sweep.measure(entry, rest_v)
        yield Play(entry.drives[-1], max(0.3, 3 / self.gain_hz))
        yield Record(GAIN_CYCLES / self.gain_hz)

    def uncounted(self, entry: PlanEntry) -> str:
        if entry.key[0] != CYCLES:
            return ""
        (block,) = entry.drives
        return (
            f"The program was killed in the block '{entry.label}': up to {getattr(block, 'cycles', 0)} cycles of it were driven and are "
            "not counted; the block is driven again"
        )

    @property
    def unattended_run(self) -> UnattendedRun | None:
        if not self.unattended:
            return None
        return UnattendedRun(self.responsible.strip(), self.longest_s, self.stop_from_phone)

    # -- results -------------------------------------------------------------------------------------------------------

    def point(self, key: tuple[float | str, ...], recordings: Sequence[Recording], simulated: bool) -> EndurancePoint:
        columns: dict[str, Any] = dict.fromkeys(EndurancePoint.__annotations__, math.nan) | {"cycles": float(key[1])}
        if key[0] == CYCLES:
            seen = recordings[-1].cycles
            if seen is None:
                raise ValueError("the file has a part of the samples of this block; its stored statistics are of all")
            columns |= {"low": seen.low_m, "high": seen.high_m, "mean": seen.mean_m, "rms": seen.rms_m}
            return EndurancePoint(**columns | {"quality": point_quality(recordings[-1:], simulated, {})})
        swept, slow = recordings[-2:]
        response = self._sweep.response((swept,))
        check_response_present(response)
        columns |= modal_columns(fit_one_mode(response)[1], by_noise=True)
        dwell = sine_point((slow,), simulated)
        relative = dwell.relative_uncertainty
        columns |= {
            "gain": dwell.fundamental / dwell.drive_amplitude,
            "gain_errors": dwell.fundamental_errors / dwell.drive_amplitude,
            "harmonics": dwell.thd,
            "harmonics_errors": relative * math.sqrt(1 + dwell.thd**2),
        }
        if slow.inputs is not None and slow.inputs.signal(slow.rows, *FLOW_KINDS) is not None:
            electrical = sine_response(slow)[0]
            for name in ("capacitance", "loss"):
                value, error, _ = getattr(electrical, name)
                columns |= {name: value, f"{name}_errors": error}
        quality = point_quality((swept,), simulated, {}) | dwell.quality
        return EndurancePoint(**columns | {"quality": quality})

    def drifts(self, points: Sequence[Any]) -> tuple[Series, ...]:
        snapshots = _snapshots_of(points)
        if len(snapshots) < 2:
            return ()
        x_axis = SeriesAxis("cycles", "1", "cycles")
        y_axis = SeriesAxis("change", "1", "relative change against the first snapshot")
        cycles, found = np.array([p.cycles for p in snapshots]), []
        for column, label, *_ in FIGURES:
            change, errors = np.array([_change(snapshots[0], p, column) for p in snapshots]).T
            if np.isfinite(change).all():
                found.append(Series(cycles, change, errors, x_axis=x_axis, y_axis=y_axis, name=DRIFT, label=label))
        return tuple(found)

    def limits_exceeded(self, points: Sequence[Any]) -> tuple[LevelExceeded, ...]:
        snapshots = _snapshots_of(points)
        if len(snapshots) < 2:
            return ()
        now, found = snapshots[-1], []
        for column, label, _, setting in FIGURES:
            change, error = _change(snapshots[0], now, column)
            limit, action = getattr(self, f"{setting}_change"), getattr(self, f"{setting}_action")
            if action is not LevelAction.OFF and abs(change) > limit and abs(change) > SIGNIFICANCE_SIGMAS * error:
                seen = f"{format_with_uncertainty(100 * change, 100 * error)} %"
                words = f"The {label} has changed by {seen} after {now.cycles:.6g} cycles (limit {100 * limit:.3g} %)"
                found.append(LevelExceeded(setting, math.nan, label, abs(change), limit, "1", str(action), words))
        if self.damage_action is not LevelAction.OFF:
            found += [
                LevelExceeded(
                    f"damage {d.before:g}", math.nan, d.kind, 1.0, 0.0, "1", str(self.damage_action), _text(d)
                )
                for d in self.damages(snapshots[-2:])
            ]
        return tuple(found)

    def damages(self, points: Sequence[Any]) -> Iterator[Damage]:
        """Yield the steps between successive snapshots that are signs of a crack or of delamination.

        Each has a fall of the natural frequency, and a rise of the damping ratio, a change of the harmonics or a fall of the capacitance.
        A crack breaks electrodes, so that capacitance is lost; a layer that comes off keeps it.
        """
        for earlier, later in pairwise(_snapshots_of(points)):
            signs = {}
            for column, label, damaged, _ in FIGURES:
                change, error = _change(earlier, later, column)
                if (damaged * change if damaged else abs(change)) > max(self.damage_step, SIGNIFICANCE_SIGMAS * error):
                    signs[column] = f"{label} {format_with_uncertainty(100 * change, 100 * error)} %"
            if "natural_frequency" in signs and signs.keys() & {"damping", "harmonics", "capacitance"}:
                kind = "crack" if "capacitance" in signs else "delamination"
                if math.isnan(later.capacitance):
                    kind = "crack or delamination"
                yield Damage(kind, earlier.cycles, later.cycles, ", ".join(signs.values()))

    def estimates(self, points: Iterable[Any]) -> tuple[EstimatedQuantity, ...]:
        points = list(points)
        if not points:
            return ()
        found = [EstimatedQuantity("cycles", max(p.cycles for p in points), 0.0, "1", "blocks played to their end")]
        snapshots = _snapshots_of(points)
        names = {"natural_frequency": "natural_frequency", "damping": "damping_ratio", "capacitance": "capacitance"}
        names["loss"] = "loss_factor"
        for when, each in (("first snapshot", snapshots[:1]), ("last snapshot", snapshots[1:][-1:])):
            for column, name in names.items():
                found += [
                    EstimatedQuantity.listed(
                        f"{name}, {when}", getattr(p, column), getattr(p, f"{column}_errors"), SOURCE
                    )
                    for p in each
                    if math.isfinite(getattr(p, column))
                ]
        for damage in list(self.damages(snapshots))[:1]:
            middle, half = 0.5 * (damage.after + damage.before), 0.5 * (damage.before - damage.after)
            source = f"middle between two snapshots, of equal probability between them: {damage.kind}"
            found.append(EstimatedQuantity("cycles to damage", middle, half / math.sqrt(3), "1", source))
        return tuple(found)

    def promised_estimates(self, points: Sequence[Any]) -> tuple[str, ...]:
        return ("cycles",)

    def checks(self, points: Sequence[Any]) -> tuple[CheckResult, ...]:
        damages = list(self.damages(points))
        remedy = _text(damages[0]) if damages else ""
        return (CheckResult("signs of damage", float(len(damages)), "1", None, 0.0, remedy),)


def _snapshots_of(points: Sequence[Any]) -> list[Any]:
    """Return the usable snapshots with a resonance, in order."""
    return [p for p in points if p.is_snapshot and Quality(p.quality).usable and math.isfinite(p.natural_frequency)]


def _change(first: Any, second: Any, column: str) -> tuple[float, float]:
    """Return the change of a figure relative to the first, and its standard uncertainty; NaN without both."""
    before, after = getattr(first, column), getattr(second, column)
    if first is second:
        return 0.0 * before, 0.0 * before
    errors = [getattr(each, f"{column}_errors") for each in (first, second)]
    return (after - before) / abs(before), math.hypot(*errors) / abs(before)


def _text(damage: Damage) -> str:
    return f"Signs of {damage.kind} between {damage.after:.6g} and {damage.before:.6g} cycles: {damage.signs}"
