"""Protocol `endurance` on the simulated bench: cycles counted, the hidden crack found, interruptions, limits, unattended runs."""

import json
import math
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from app.config.bench_file import BenchConfig
from app.session.bench_connection import BenchConnection
from drivers import BenchError, LevelAction
from drivers.bench.armed_bench import ArmedBench
from protocols.base import CyclesInterrupted, CycleStatistics, Event, EventBus, PointMeasured, RunStatus
from protocols.measurements.endurance import Endurance, EndurancePoint
from protocols.rehearsal import rehearse
from protocols.resume import counted_cycles, load_resumable
from protocols.runfile.reader import Run
from protocols.runner.cycle_tally import CycleTally
from protocols.runner.publisher import RunCancelled
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from tests.helpers.electrical.bench import MONITORS, electrical_bench, with_inputs
from tests.helpers.simulated_bench import Ran, Trigger, assert_safe_voltage, laboratory, run

CRACK = {"crack_cycles": 2500.0, "wear_per_decade": 0.01}
SHORT: dict[str, Any] = {
    "cycles": 4000,
    "block_cycles": 1000,
    "spacing": "fixed",
    "interval_cycles": 1000,
    "sweep_s": 0.25,
    "periods": 2,
    "sample_rate_hz": 5000.0,
}


def bench(**truth: Any) -> BenchConfig:
    """Return the bench with both monitors, whose abort levels end a run."""
    config = electrical_bench(**truth)
    levels = config.levels.model_copy(update=dict.fromkeys(("laser_lost", "voltage", "current"), LevelAction.REST))
    return config.model_copy(update={"levels": levels})


def quiet(ran: Ran) -> list[str]:
    """Return the texts of the log."""
    return [event.text for event in ran.events if event.kind == "Noted"]


def point(cycles: float, **figures: float) -> EndurancePoint:
    """Return a snapshot with figures; each has an uncertainty of a thousandth."""
    values: dict[str, Any] = dict.fromkeys(EndurancePoint.__annotations__, math.nan)
    base = {
        "natural_frequency": 160.0,
        "damping": 0.05,
        "gain": 1e-5,
        "harmonics": 0.2,
        "capacitance": 1e-9,
        "loss": 0.02,
    }
    for name, value in (base | figures).items():
        values |= {name: value, f"{name}_errors": 1e-3 * base[name]}
    return EndurancePoint(**values | {"cycles": cycles, "quality": 0})


@pytest.fixture(scope="module")
def cracked(tmp_path_factory: pytest.TempPathFactory) -> Ran:
    with laboratory(bench(ageing=CRACK)) as lab:
        lab.control.history.keeps_past = True
        return run(Endurance(**SHORT, damage_action="warning"), tmp_path_factory.mktemp("runs"), lab)


@pytest.mark.deep
def test_the_specimen_has_the_cycles_that_the_points_count(cracked: Ran) -> None:
    assert cracked.status is RunStatus.COMPLETED, cracked.reason
    counted = [p.cycles for p in cracked.points if not p.is_snapshot]
    assert counted == [1000, 2000, 3000, 4000]
    assert cracked.laboratory.control.history.cycles_until(math.inf) == pytest.approx(4000, abs=0.1)


@pytest.mark.deep
def test_the_hidden_crack_is_found_within_an_interval(cracked: Ran) -> None:
    found = list(Endurance(**SHORT).damages(cracked.points))
    assert [(each.kind, each.after, each.before) for each in found] == [("crack", 2000, 3000)]
    estimates = {each.name: each for each in Endurance(**SHORT).estimates(cracked.points)}
    assert abs(estimates["cycles to damage"].value - CRACK["crack_cycles"]) <= 500
    assert estimates["cycles"].value == 4000
    assert any(event.kind == "LevelExceeded" and event.channel == "crack" for event in cracked.events)
    assert cracked.verdict.outcome == "doubtful"


@pytest.mark.deep
def test_every_block_has_statistics_and_few_samples(cracked: Ran) -> None:
    blocks = [p for p in cracked.points if not p.is_snapshot]
    for p in blocks:
        assert p.low < p.mean < p.high
        assert p.rms == pytest.approx((p.high - p.low) / (2 * math.sqrt(2)), rel=0.1)
    with Run(cracked.path) as file:
        kept = [each for each in file.recordings() if each.entry == 1]
        drift = [each for each in file.series() if each.name == "drift"]
    assert 0.2 <= (kept[0].rows[1] - kept[0].rows[0]) / kept[0].rate_hz < 0.4  # of 10 s
    assert len(drift) == 6
    assert all(each.x.tolist() == [0, 1000, 2000, 3000, 4000] for each in drift)


def interrupted(folder: Path, lab: BenchConnection, act: str) -> Ran:
    """Run; stop or pause in the middle of the second block."""
    event, blocks = threading.Event(), []

    def watch(seen: Event) -> None:
        blocks.append(seen)
        in_block = [each for each in blocks if each.kind == "EntryBegan"][-1:]
        if in_block and in_block[0].key == ("cycles", 2000) and seen.kind == "BlockSeen":
            event.set()
        if seen.kind == "Paused":
            event.clear()

    return run(Endurance(**SHORT | {"cycles": 2000}), folder, lab, watch, **{act: event})


@pytest.mark.deep
def test_a_stop_after_the_last_cycle_counts_no_cycle_that_was_not_driven(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def stopped_late(tally: CycleTally, armed: ArmedBench, *_: object) -> None:
        end_s = lab.bench.clock.now() + 2 * armed.amplifier.remaining_s
        while lab.bench.clock.now() < end_s:
            armed.read_block()
        raise RunCancelled

    monkeypatch.setattr(CycleTally, "read", stopped_late)
    with laboratory(bench()) as lab:
        ran = run(Endurance(**SHORT | {"cycles": 100, "block_cycles": 100, "interval_cycles": 100}), tmp_path, lab)
        assert lab.control.history.cycles_until(math.inf) == pytest.approx(100, abs=1)
    assert [each.driven.cycles for each in ran.events if isinstance(each, CyclesInterrupted)] == [100]


@pytest.mark.deep
def test_a_stop_in_a_block_is_counted_and_continued(tmp_path: Path) -> None:
    with laboratory(bench(ageing=CRACK)) as lab:
        stopped = interrupted(tmp_path, lab, "cancel")
        assert stopped.status is RunStatus.STOPPED
        driven = [each.driven.cycles for each in stopped.events if isinstance(each, CyclesInterrupted)]
        assert 0 < driven[0] < 1000
        there = lab.control.history.cycles_until(math.inf)
        assert 1000 + driven[0] == pytest.approx(there, abs=12)
        again = load_resumable(stopped.path)
        assert again.driven[3].cycles == driven[0]
        assert (again.drift_check_entry, "killed" in again.message) == (None, False)
        seen: list[Event] = []
        runner = Runner(RunRequest.resuming(stopped.path, tmp_path), lab.bench, lab.operator, EventBus(seen.append))
        assert runner.run().status is RunStatus.COMPLETED
        assert lab.control.history.cycles_until(math.inf) == pytest.approx(2000, abs=12)
    last = [each.point.cycles for each in seen if isinstance(each, PointMeasured)][-1]
    assert last == 2000 == counted_cycles(tmp_path, "T1")


@pytest.mark.deep
def test_a_pause_in_a_block_continues_it(tmp_path: Path) -> None:
    with laboratory(bench(ageing=CRACK)) as lab:
        paused = interrupted(tmp_path, lab, "pause")
        assert paused.status is RunStatus.COMPLETED, paused.reason
        assert "Paused" in paused.kinds()
        assert lab.control.history.cycles_until(math.inf) == pytest.approx(2000, abs=12)


COMMAND = (sys.executable, "-c", "import sys; from app.cli.main import main; sys.exit(main())")
BENCH = ("--bench", "docs/how-to/endurance.toml", "--speed", "max", "--json")


def played(arguments: tuple[str, ...], kill_in: str = "") -> list[dict[str, Any]]:
    """Run the program; return its events. It is killed when an entry with this label has begun."""
    events = []
    with subprocess.Popen([*COMMAND, *arguments, *BENCH], stdout=subprocess.PIPE, text=True) as program:
        assert program.stdout is not None
        for line in program.stdout:
            events.append(json.loads(line))
            if kill_in and events[-1]["event"] == "EntryBegan" and events[-1]["label"] == kill_in:
                program.kill()
                break
    return events


@pytest.mark.deep
def test_the_count_goes_on_after_the_program_was_killed(tmp_path: Path) -> None:
    settings = [f"--set={name}={value}" for name, value in SHORT.items()]
    begun = ("run", "endurance", "--specimen", "T1", "--out", str(tmp_path), *settings)
    played(begun, "cycles 1001 to 2000")
    (left,) = tmp_path.glob("*.h5")
    events = played(("resume", str(left)))
    done = [each["point"]["cycles"] for each in events if each["event"] == "PointMeasured"]
    # Each block and each snapshot once: the killed block is driven again or, if it had just ended, was counted.
    assert done == [0, 1000, 1000, 2000, 2000, 3000, 3000, 4000, 4000]
    assert counted_cycles(tmp_path, "T1") == 4000


def test_a_killed_block_is_told_with_its_cycles() -> None:
    protocol = Endurance(**SHORT)
    snapshot, block = protocol.plan(2.5)[:2]
    assert "1000" in protocol.uncounted(block)
    assert protocol.uncounted(snapshot) == ""


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("figures", "kind"),
    [
        ({"natural_frequency": 156.0, "damping": 0.06, "capacitance": 0.97e-9}, ["crack"]),
        ({"natural_frequency": 156.0, "damping": 0.06}, ["delamination"]),
        ({"natural_frequency": 156.0, "capacitance": math.nan, "harmonics": 0.25}, ["crack or delamination"]),
        ({"natural_frequency": 156.0}, []),
        ({"damping": 0.06, "capacitance": 0.9e-9}, []),
        ({"natural_frequency": 159.5, "damping": 0.06}, []),
    ],
)
def test_signs_of_damage(figures: dict[str, float], kind: list[str]) -> None:
    found = Endurance().damages([point(0), point(1000, **figures)])
    assert [each.kind for each in found] == kind


def test_a_change_within_its_uncertainty_exceeds_no_limit() -> None:
    protocol = Endurance(resonance_change=0.002, damage_action="off")
    assert not protocol.limits_exceeded([point(0), point(10, natural_frequency=159.5)])
    (event,) = protocol.limits_exceeded([point(0), point(10, natural_frequency=158.0)])
    assert (event.level, event.action, event.limit) == ("resonance", "ask", 0.002)
    assert "-1.25" in event.words


def test_damage_is_looked_for_between_the_last_two_snapshots() -> None:
    """Earlier ones were judged when they were measured; the result of the run has all of them."""
    worn = {"natural_frequency": 156.0, "damping": 0.06, "capacitance": 0.97e-9}
    points, protocol = [point(0), point(10, **worn), point(20, **worn)], Endurance(damping_change=1.0)
    assert [each.level for each in protocol.limits_exceeded(points[:2])] == ["damage 10"]
    assert protocol.limits_exceeded(points) == ()
    assert len(list(protocol.damages(points))) == 1


@pytest.mark.parametrize("cycles", [100, 12_345, 10_000_000, 100_000_000])
@pytest.mark.parametrize("spacing", ["fixed", "logarithmic"])
def test_the_blocks_of_a_plan_add_up_to_the_cycles(cycles: int, spacing: str) -> None:
    protocol = Endurance(cycles=cycles, spacing=spacing, earlier_cycles=7)
    plan = protocol.plan(2.5)
    counts = [entry.key[1] for entry in plan]
    assert counts == sorted(counts)
    assert sum(entry.drives[0].cycles for entry in plan if entry.key[0] == "cycles") == cycles == counts[-1] - 7
    assert max(entry.drives[0].cycles for entry in plan if entry.key[0] == "cycles") <= protocol.block_cycles


def test_a_week_fits_on_the_disk_because_raw_samples_are_thinned() -> None:
    with laboratory(bench()) as lab:
        thinned = rehearse(Endurance(cycles=100_000_000), lab.bench.amplifier, channels=lab.bench.channels)
        assert thinned.duration_s > 1e6
        assert thinned.file_bytes < 200e6
        whole = rehearse(Endurance(cycles=1_000_000, raw_s=1000), lab.bench.amplifier, channels=lab.bench.channels)
        assert whole.file_bytes > 1e4 * 1e4 * 4


def test_statistics_of_parts_are_those_of_the_whole() -> None:
    samples = np.random.default_rng(3).normal(2.0, 1.0, 1000)
    parts = CycleStatistics(5).with_samples(samples[:300]).with_samples(samples[300:])
    assert (parts.cycles, parts.scans, parts.low_m, parts.high_m) == (5, 1000, samples.min(), samples.max())
    assert (parts.mean_m, parts.rms_m) == pytest.approx((samples.mean(), samples.std()))


UNATTENDED = {"unattended": True, "responsible": "Anna, phone 4711", "longest_s": 3600.0}


def without(lab: BenchConnection, condition: str) -> dict[str, Any]:
    """Take one condition away from the bench, or from the returned parameters."""
    levels, channels = lab.bench.levels, lab.bench.channels
    match condition:
        case "commission":
            lab.bench.configuration = {**lab.bench.configuration, "commissioning": {"status": "overridden"}}
        case "watchdog":
            lab.bench.watchdog.inactive_reason = "No watchdog: the bench file disables it"
        case "laser_lost" | "voltage has" | "current has":
            lab.bench.levels = replace(levels, **{condition.removesuffix(" has"): LevelAction.ASK})
        case "voltage-monitor" | "current-monitor":
            lab.bench.channels = tuple(each for each in channels if each.kind != condition)
        case "after-run":
            lab.bench.notice = ""
        case "longest_s":
            return {"longest_s": 0.0}
        case "responsible":
            return {"responsible": "  "}
    return {}


CONDITIONS = (
    *("commission", "watchdog", "laser_lost", "voltage has", "current has", "voltage-monitor", "current-monitor"),
    *("after-run", "longest_s", "responsible"),
)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("condition", CONDITIONS)
def test_an_unattended_run_without_a_condition_is_refused_before_anything_moves(condition: str, tmp_path: Path) -> None:
    with laboratory(bench()) as lab:
        lab.bench.notice = "notify Anna"
        changed = without(lab, condition)
        ran = run(Endurance(**SHORT | UNATTENDED | changed), tmp_path, lab)
        assert (ran.status, ran.points) == (RunStatus.FAILED, [])
        assert ran.reason.partition(": ")[0].endswith("refused")
        assert condition in ran.reason
        assert ran.reason.count("; ") == 0  # nothing else is missing
        assert "Armed" not in ran.kinds()
        assert lab.control.history.cycles_until(math.inf) == 0
        assert not lab.control.history.high_voltage_on


FAULTS = {
    "sensor-out-of-range": "laser sensor has been out of range",
    "generator-power-off": "",
    "drive-cable-off": "",
    "output-tripped": "the card sees",
    "scpi-dropped": "",
    "card-unplugged": "does not answer",
    "voltage": "amplifier_voltage reads",
    "current": "amplifier_current reads",
    "range": "amplifier_voltage is at the end of the card's range",
    "duration": "its longest duration of 8 s",
    "watchdog": "the watchdog has ended",
    "disk": "is full: 0 MB are left",
}
OFF_REST = ("generator-power-off", "drive-cable-off", "output-tripped")
"""The amplifier's input is pulled to 0 V, which no program can change: the run is unsafe."""
UNMEASURED = ("card-unplugged",)
"""The drive ends at rest by itself, and the run is unsafe because that cannot be measured."""


def faulty_bench(fault: str) -> BenchConfig:
    """Return the bench on which a fault of settings, not of an instrument, occurs under the drive of a block, not of a snapshot."""
    truth = {"amplifier": {"voltage_monitor_v_per_v": 1 / 80}} if fault == "range" else {}
    config = bench(**truth)
    limits = {"voltage": {"voltage_v": 800.0}, "current": {"current_a": 1.3e-3}}.get(fault, {})
    channels = [
        each | {"gain": 80.0} if fault == "range" and each["kind"] == "voltage-monitor" else each for each in MONITORS
    ]
    return with_inputs(config.model_copy(update={"levels": config.levels.model_copy(update=limits)}), *channels)


@pytest.mark.deep
@pytest.mark.breaks_the_drive
@pytest.mark.parametrize("fault", FAULTS)
def test_a_fault_in_an_unattended_run_ends_it_at_rest_and_is_told(
    fault: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    settings = SHORT | UNATTENDED | ({"longest_s": 8.0} if fault == "duration" else {})
    with laboratory(faulty_bench(fault)) as lab:
        lab.bench.notice = "notify Anna"

        def act() -> None:
            if fault == "watchdog":

                def ended() -> None:
                    raise BenchError("the watchdog has ended")

                lab.bench.watchdog.raise_for_status = ended  # type: ignore[method-assign]
            elif fault == "disk":
                monkeypatch.setattr("protocols.runfile.writer.shutil.disk_usage", lambda _: SimpleNamespace(free=0))
            elif fault not in ("voltage", "current", "range", "duration"):
                lab.control.inject(fault)

        begun: list[Any] = []

        def in_block(event: Event) -> bool:
            begun.extend(event.key[:1] for _ in [0] if event.kind == "EntryBegan")
            return begun[-1:] == [("cycles",)] and event.kind == "BlockSeen"

        ran = run(Endurance(**settings), tmp_path, lab, Trigger(in_block, act), safe=False)
        driven = lab.control.history.cycles_until(math.inf)
        monkeypatch.undo()
        at_rest = lab.control.history.volts(np.array([lab.control.clock.now() - 1e-3]))
    assert begun[-1:] == [("cycles",)], "in the middle of a block, and nothing follows"
    assert driven <= 1000
    assert ran.status is (RunStatus.UNSAFE if fault in OFF_REST + UNMEASURED else RunStatus.FAILED), ran.reason
    assert FAULTS[fault] in ran.reason, ran.reason
    told = next(event for event in ran.events if event.kind == "RunEnded")
    assert (told.reason, told.verdict.outcome) == (ran.reason, str(ran.status))
    assert any("Anna, phone 4711" in text for text in quiet(ran))
    assert (abs(float(at_rest[0]) - 2.5) < 0.05) is (fault not in OFF_REST), fault
    if fault not in OFF_REST:
        assert_safe_voltage(ran.report)
