"""Latency on simulated benches: times of the plant's own motion under ideal steps and sines, held by the stated uncertainties."""

import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

from app.archive.description import run_text
from app.archive.figures import run_figures
from app.config.bench_file import BenchConfig, load_bench
from app.plotting.run_picture import draw_run
from app.report.result_cards import result_tables
from app.report.runs import read_report_runs
from model import Tactor
from model.response import PUBLISHED_LATENCIES, step_latency
from protocols.base import Outcome, Quality, RunStatus
from protocols.measurements.latency import SINE, STEP, OnsetLatency
from protocols.runfile.reader import Run
from protocols.signals.onset import Edge, find_edge, first_crossings, last_crossings, remove_edge, smooth
from tests.helpers.latency_truth import TrueLatency, true_sine, true_step
from tests.helpers.simulated_bench import laboratory, run, simulated

COLUMNS = {"latency, 50 µm": "latency", "rise_time": "rise", "overshoot": "overshoot", "settling_time": "settling"}


def test_a_step_and_a_sine_have_the_times_of_the_closed_form(tmp_path: Path) -> None:
    protocol = OnsetLatency(repeats=2, frequencies_hz=(100.0,))
    with laboratory() as lab:
        ran = run(protocol, tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    assert ran.verdict.outcome == "good", ran.verdict.reasons
    assert ran.report.steepest_v_per_s == pytest.approx(9000, rel=0.02)
    expected = step_latency(Tactor(), 1500.0)
    step, sine = ran.points[0], ran.points[-1]
    for name, true in (
        ("latency", expected.to_threshold_s),
        ("rise", expected.rise_s),
        ("overshoot", expected.overshoot),
        ("settling", expected.settling_s),
        ("final", expected.final_m),
    ):
        assert true is not None
        assert abs(getattr(step, name) - true) < 3 * getattr(step, f"{name}_errors"), name
    assert step.latency_errors < 0.03 * step.latency
    assert step.driven_latency - step.latency == pytest.approx(0.5 * 2.5 / 9000, rel=0.05)
    assert sine.latency == pytest.approx(1.1805e-3, abs=5e-6)  # of the plant, see latency_truth
    with Run(ran.path) as file:
        names = [e.name for e in file.record.estimates]
        planned = dict.fromkeys(entry.label.partition(", repeat")[0] for entry in protocol.plan(2.5))
        assert [curve.label for curve in file.series()] == list(planned)
        again = [
            OnsetLatency().point(key, [r], True) for key, r in zip(KEYS, list(file.recordings())[1::2], strict=True)
        ]
        figures = {f.name: f for f in run_figures(file.record)}
    assert "latency, 50 µm, after a step to 5 V" in names
    assert again == ran.points
    felt, rise = figures["latency, 50 µm, after a step to 5 V"], figures["rise_time, after a step to 5 V"]
    assert felt.total > felt.statistical  # the sensor's gain moves the threshold
    assert rise.total == pytest.approx(np.hypot(rise.statistical, 2e-3 * rise.value))  # the specimen's history alone


KEYS = ((STEP, 5.0, 1.0), (STEP, 5.0, 2.0), (SINE, 100.0, 1.0), (SINE, 100.0, 2.0))


@pytest.mark.deep
def test_the_first_onset_of_a_specimen_with_hysteresis_is_as_late_as_the_next(tmp_path: Path) -> None:
    config = load_bench("sim")
    config = config.model_copy(update={"simulation": {**(config.simulation or {}), "seed": 7, "fresh_noise": False}})
    with laboratory(config) as lab:
        ran = run(OnsetLatency(repeats=2, frequencies_hz=(100.0,)), tmp_path, lab)
    for first, second in (ran.points[:2], ran.points[2:]):  # without conditioning 16 and 22 µs apart
        assert first.latency == pytest.approx(second.latency, abs=9e-6)


@pytest.mark.deep
@pytest.mark.parametrize("bench", ["ideal", "realistic"])
def test_the_total_uncertainties_hold_against_the_plant(bench: str, tmp_path: Path) -> None:
    truth: dict[str, TrueLatency] = {}
    pulls: dict[str, list[float]] = {}
    for seed in (1, 2, 3):
        config = seeded(bench, seed)
        if not truth:
            parameters = config.simulation_parameters
            truth = {
                "after a step to 5 V": true_step(parameters, 5.0),
                "from the onset of 250 Hz": true_sine(parameters, 250.0),
            }
        with laboratory(config) as lab:
            ran = run(OnsetLatency(repeats=2, frequencies_hz=(250.0,)), tmp_path, lab)
        with Run(ran.path) as file:
            for figure in run_figures(file.record):
                name, _, what = figure.name.rpartition(", ")
                if name in COLUMNS:
                    true = getattr(truth[what], COLUMNS[name])
                    pulls.setdefault(figure.name, []).append((figure.value - true) / figure.total)
    assert len(pulls) == 8
    for name, each in pulls.items():
        assert np.abs(each).max() < 4, (name, each)  # uncertainties are known to 15 %
    assert np.sqrt(np.mean(np.square([*pulls.values()]))) < 1.3


def seeded(bench: str, seed: int) -> BenchConfig:
    config = load_bench(bench)
    return config.model_copy(update={"simulation": {**(config.simulation or {}), "seed": seed, "fresh_noise": False}})


@pytest.mark.deep
def test_the_fastest_edge_of_a_small_memory_is_slower_and_its_uncertainty_larger(tmp_path: Path) -> None:
    with laboratory(simulated(generator={"model": "AFG1022"})) as lab:
        ran = run(OnsetLatency(repeats=2, frequencies_hz=()), tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    true = step_latency(Tactor(), 1500.0)
    for point in ran.points:
        assert point.edge_time > 3.5e-4
        assert true.to_threshold_s is not None
        assert abs(point.latency - true.to_threshold_s) < 3 * point.latency_errors


@pytest.mark.deep
def test_a_response_that_stays_below_the_threshold_has_no_latency_and_a_warning(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(OnsetLatency(levels_v=(2.6,), repeats=2, frequencies_hz=()), tmp_path, lab)
    assert all(np.isnan(p.latency) and np.isfinite(p.rise) for p in ran.points)
    protocol = OnsetLatency(levels_v=(2.6,))
    assert "does not reach 50 µm under a step" in protocol.warnings(ran.points)[0]
    assert protocol.promised_estimates(ran.points) == ()
    assert ran.verdict.outcome == "doubtful"
    assert (0.0, 2.0) in [(check.value, check.low) for check in ran.verdict.checks if not check.passed]


def test_an_amplifier_at_its_current_limit_gives_no_good_latency(tmp_path: Path) -> None:
    with laboratory() as lab:
        lab.control.inject("amplifier-limited")
        ran = run(OnsetLatency(repeats=1, frequencies_hz=(), dwell_s=0.03), tmp_path, lab)
    (point,) = ran.points
    assert Quality(point.quality) == Quality.UNSETTLED | Quality.SIMULATED
    assert ran.verdict.outcome is Outcome.NO_RESULT


@pytest.mark.deep
def test_a_specimen_that_does_not_move_has_no_points(tmp_path: Path) -> None:
    with laboratory(simulated(tactor={"mu": -1e-13})) as lab:
        ran = run(OnsetLatency(repeats=1, frequencies_hz=(100.0,)), tmp_path, lab)
    assert ran.points == []


def test_the_edge_of_a_staircase_and_crossings_of_a_noisy_line() -> None:
    rate = 1e5
    time = np.arange(6000) / rate
    drive = np.interp(time, [0, 0.03, 0.03025], [2.5, 2.5, 5.0])
    edge = find_edge(drive, rate, 2.5e-4, 0.02)
    assert edge.centroid_s == pytest.approx(0.030125, abs=2e-7)
    assert edge.duration_s == pytest.approx(2.5e-4, rel=0.01)
    assert edge.step_v == pytest.approx(2.5)
    with pytest.raises(ValueError, match="the recorded drive shows no step: check the cable"):
        find_edge(np.full(6000, 2.5), rate, 2.5e-4, 0.02)
    noise = np.random.default_rng(1).normal(0, 0.01, (50, time.size))
    lines = smooth(time * 100 - 3 + noise, rate)
    for found in (
        first_crossings(time, lines, 1.0),
        last_crossings(time, -lines, np.full(50, -1.0)),
    ):
        assert np.abs(found - 0.04).max() < 3e-4
        assert np.abs(found.mean() - 0.04) < 5e-5
    nowhere = np.array([100.0])
    assert last_crossings(time, lines[:1], nowhere) == 0.0
    assert np.isnan(last_crossings(time, lines[:1], -nowhere))
    assert np.isnan(first_crossings(time, lines[:1], nowhere))


@pytest.mark.parametrize("edge_s", [1e-4, 2.8e-4])
def test_a_response_to_a_straight_edge_becomes_the_response_to_a_step(edge_s: float) -> None:
    rate, lead_s = 1e5, 0.02
    time = np.arange(0, 0.1, 1 / rate)

    def ramped(since: np.ndarray, hz: float) -> np.ndarray:
        """The integral of 1 - exp(-z w t) cos(w t) from 0 to t."""
        root = (0.03 - 1j) * 2 * np.pi * hz
        return np.where(since > 0, since - ((1 - np.exp(-root * np.maximum(since, 0))) / root).real, 0.0)

    def response(since: np.ndarray, width_s: float) -> np.ndarray:
        modes = {150.0: 1.0, 2300.0: 0.02}
        return sum(
            share * (ramped(since + width_s / 2, hz) - ramped(since - width_s / 2, hz)) / width_s
            for hz, share in modes.items()
        )

    ideal, driven = response(time - lead_s, 1e-9), response(time - lead_s, edge_s)
    restored = remove_edge(driven[None], Edge(lead_s, edge_s / np.sqrt(12), 2.5), rate)[0]
    ringing = slice(int((lead_s + edge_s) * rate), None)
    left, effect = (float(np.abs(each - ideal)[ringing].max()) for each in (restored, driven))
    assert left < 0.3 * effect, (left, effect)
    assert np.abs(restored - ideal)[-100:].max() < 1e-3
    assert np.abs(restored[: int((lead_s - 2 * edge_s) * rate)]).max() < 0.3 * np.abs(driven - ideal).max()


@pytest.mark.deep
def test_show_picture_and_report_state_the_times_of_other_actuators(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(OnsetLatency(repeats=1, frequencies_hz=(150.0,)), tmp_path, lab)
    with Run(ran.path) as file:
        text = run_text(file)
        names = [estimate.name for estimate in file.record.estimates]
    (felt,) = (name for name in names if name.startswith("latency") and "step" in name)
    assert re.search(rf"{re.escape(felt)}, .*: 0\.5", text)
    assert "ERM: 50 to 100 ms" in text
    assert "LRA: 10 to 20 ms" in text
    assert all(published.source for published in PUBLISHED_LATENCIES)
    with Run(ran.path) as file:
        draw_run(file, tmp_path / "latency.svg")
    assert "<svg" in (tmp_path / "latency.svg").read_text(encoding="utf-8")
    measured, others = (asdict(block) for block in result_tables(read_report_runs(tmp_path, "T1"), "perception"))
    conditions = {name.rpartition(", ")[2] for name in names}
    assert len(conditions) == 2
    assert all(condition in str(measured) for condition in conditions)
    assert all(published.source in str(others) for published in PUBLISHED_LATENCIES)


def test_parameters_that_leave_nothing_to_measure_are_refused() -> None:
    with pytest.raises(ValueError, match="levels_v and frequencies_hz are both empty"):
        OnsetLatency(levels_v=(), frequencies_hz=())
    with pytest.raises(ValueError, match="greater than or equal to 50000"):
        OnsetLatency(sample_rate_hz=20_000.0)
