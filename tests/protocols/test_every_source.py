"""Every protocol on every source, as docs/protocols-and-sources.md says: it runs, or is refused before anything moves."""

import re
from pathlib import Path

import numpy as np
import pytest

from app.archive.run_reading import read_run_summary
from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignItem
from app.campaign.queue import rehearse_campaign
from app.campaign.status import ItemStatus
from app.config.driver_registry import SOURCES as DRIVERS
from app.config.driver_registry import built_in_names, load_driver
from docs.make_source_table import PAGE, page
from drivers.errors import DriveRejectedError
from drivers.generators.burst import BurstGenerator
from protocols.base import LogMessage, RunStatus
from protocols.measurements.dwelt_response import LINES_IN_PEAK, coarse_frequencies, next_frequencies
from protocols.measurements.free_decay import FreeDecay
from protocols.measurements.hysteresis import Hysteresis
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS
from protocols.rehearsal import adapt_to_source, rehearse
from protocols.resume import load_resumable
from protocols.runfile.reader import Run
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.helpers.electrical.bench import bench_for
from tests.helpers.simulated_bench import laboratory, run, simulated
from tests.helpers.sources import ALIKE, GENERATORS, SHORTER, SOURCES, SUPPLY, rehearsed, source_bench

NARROW = Sweep(start_hz=300, stop_hz=525)
"""A sweep that an AFG1022 cannot play: its band is less than an octave, so that there are no pieces of it."""

PEAK_HZ = 151.1127
"""Largest response of the paper's tactor with 7.73 g, from the model on a fine grid."""


@pytest.mark.deep
def test_the_table_of_protocols_and_sources_is_what_the_rehearsals_give() -> None:
    assert PAGE.read_text("utf-8") == page(), "run 'python docs/make_source_table.py'"


@pytest.mark.deep
@pytest.mark.parametrize("source", SOURCES)
def test_every_protocol_runs_on_every_source_or_is_refused_before_anything_moves(source: str, tmp_path: Path) -> None:
    for name in BUILT_IN_PROTOCOLS:
        kind = PROTOCOLS[name]
        if not kind.high_voltage and source in GENERATORS[1:]:
            continue  # nothing is played
        with laboratory(bench_for(name, source_bench(source))) as lab:
            protocol = kind(**SHORTER.get(name, {}))
            foreseen = rehearsed(protocol, lab, source)
            ran = run(protocol, tmp_path, lab)
        assert foreseen.runs == page_says_it_runs(name, source), name
        if foreseen.runs:
            assert ran.status is RunStatus.COMPLETED, f"{name}: {ran.reason}"
            assert ran.points, f"{name}: {ran.reason}"
        else:
            assert ran.status is RunStatus.FAILED, name
            assert "Asked" not in ran.kinds(), name
            assert ran.report.live_s == 0, name


@pytest.mark.deep
def test_a_row_stands_for_models_with_the_same_capabilities() -> None:
    for row, others in ALIKE.items():
        found = {model: capabilities(model) for model in (row, *others)}
        assert all(each == found[row] for each in found.values()), found


def capabilities(model: str) -> tuple[object, ...]:
    """Return what of a model decides which drives it plays."""
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, VirtualClock())
    driver = next(n for n in built_in_names(DRIVERS) if load_driver(DRIVERS, n).supports_model(model))  # type: ignore[attr-defined]
    source = load_driver(DRIVERS, driver)(bench.link(), bench.clock)
    assert isinstance(source, BurstGenerator)
    able = source.capabilities
    return driver, source.playable.max_points, able.holds_range, able.max_burst_cycles, able.min_amplitude_vpp


def page_says_it_runs(name: str, source: str) -> bool:
    rows = [line.split("|")[1:-1] for line in PAGE.read_text("utf-8").splitlines() if line.startswith("| ")]
    column = [cell.strip() for cell in rows[0]].index(name)
    return not next(row[column] for row in rows if row[0].strip() == source).strip().startswith("no")


@pytest.mark.deep
def test_a_mass_resonance_by_single_frequencies_finds_the_resonance_and_keeps_what_was_asked(tmp_path: Path) -> None:
    with laboratory(source_bench("33220A")) as lab:
        ran = run(MassResonance(masses_kg=(7.73e-3,)), tmp_path, lab)
    (point,) = ran.points
    assert abs(point.natural_frequency - 158.31) < 5 * point.natural_frequency_errors < 0.1
    assert abs(point.damping - 0.2110) < 1e-3
    assert abs(point.frequency - PEAK_HZ) < 5 * point.frequency_errors < 0.1
    assert np.isnan(point.spectrum_peak)
    assert any("method dwell instead of sweep" in e.text for e in ran.events if isinstance(e, LogMessage))
    with Run(ran.path) as file:
        assert file.record.parameters["method"] == "dwell"
        assert file.record.requested == {"method": "sweep"}
        (curve,) = file.series()
        recordings = list(file.recordings())
    assert curve.x.size == len(recordings) > 20
    assert load_resumable(ran.path, (0,)).protocol.model_dump()["method"] == "dwell"
    assert read_run_summary(ran.path, ran.path.name).requested_parameters["method"] == "sweep"  # type: ignore[union-attr]


@pytest.mark.deep
def test_what_fits_is_not_adapted_and_what_nothing_helps_names_another_protocol() -> None:
    with laboratory(source_bench("33511B")) as lab:
        for protocol in (Sweep(), MassResonance(), Hysteresis()):
            assert adapt_to_source(protocol, lab.bench.amplifier).protocol is protocol
    with laboratory(source_bench("AFG1022")) as lab:
        assert adapt_to_source(Hysteresis(), lab.bench.amplifier).requested == {
            "frequencies_hz": [0.1, 0.2, 0.5, 1.0, 2.0, 5.0]
        }
        with pytest.raises(  # no octave: no pieces
            DriveRejectedError, match=r"this PeriodicSweep needs .* On this source, run sine-dwell instead$"
        ):
            rehearse(NARROW, lab.bench.amplifier)
    with laboratory(source_bench(SUPPLY)) as lab:
        with pytest.raises(DriveRejectedError, match=r"not play a Sine: .* run voltage-steps instead$"):
            rehearse(Hysteresis(), lab.bench.amplifier)
        with pytest.raises(DriveRejectedError, match=r"\b25 V/s.* 1000 V/s"):
            rehearse(FreeDecay(), lab.bench.amplifier)


@pytest.mark.deep
def test_the_protocol_that_a_refusal_names_runs_as_it_is_named(tmp_path: Path) -> None:
    with laboratory(source_bench("AFG1022")) as lab:
        refused = run(NARROW, tmp_path, lab)
        assert refused.status is RunStatus.FAILED
        (named,) = re.findall(r"On this source, run ([\w-]+) instead", refused.reason)
        ran = run(PROTOCOLS[named].model_validate({}), tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason
    with laboratory(source_bench(SUPPLY)) as lab:
        refused = run(Hysteresis(), tmp_path, lab)
        (named,) = re.findall(r"On this source, run ([\w-]+) instead", refused.reason)
        ran = run(PROTOCOLS[named].model_validate({}), tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED, ran.reason


@pytest.mark.deep
@pytest.mark.parametrize("ratio", [0.2, 0.02])
def test_single_frequencies_close_in_on_a_peak_however_narrow(ratio: float) -> None:
    def response(f: np.ndarray) -> np.ndarray:
        return np.abs(1 / (1 - (f / 160) ** 2 + 2j * ratio * f / 160))

    found = list(coarse_frequencies(25.0, 525.0, 16))
    while more := next_frequencies(found, response(np.array(found)).tolist()):
        found += more
    assert len(found) < 70
    assert len(set(found)) == len(found)
    height = response(np.array(found))
    assert np.count_nonzero(height > height.max() / np.sqrt(2)) >= LINES_IN_PEAK


@pytest.mark.deep
def test_a_campaign_counts_a_run_whose_parameters_were_adapted(tmp_path: Path) -> None:
    campaign = Campaign.create(
        tmp_path,
        "T1",
        True,
        (CampaignItem("loops", "hysteresis", {"frequencies_hz": (0.5, 1.0, 2.0, 5.0), "cycles": 3}),),
    )
    with laboratory(source_bench("SDG1032X")) as lab:
        ran = run(campaign.protocol_for(campaign.items[0]), tmp_path, lab)
    assert [p.frequency for p in ran.points] == pytest.approx([1, 2, 5], rel=1e-3)
    assert campaign.item_states()[0].status is ItemStatus.DONE


@pytest.mark.deep
def test_the_rehearsal_of_a_campaign_lists_every_item_and_what_is_refused(tmp_path: Path) -> None:
    items = (CampaignItem("steps", "voltage-steps"), CampaignItem("dwell", "sine-dwell"))
    campaign = Campaign.create(tmp_path, "T1", True, items)
    with laboratory(source_bench(SUPPLY)) as lab:
        rehearsal = rehearse_campaign(campaign, lab.bench)
    assert [item.name for item, _ in rehearsal.items] == ["steps"]
    ((item, reason),) = rehearsal.refusals
    assert item.name == "dwell"
    assert "not play a Sine" in reason


@pytest.mark.deep
def test_the_rehearsal_counts_the_whole_of_a_drive_that_cannot_be_stopped() -> None:
    dwell = SineDwell(frequencies_hz=(100.0, 150.0))
    played_s = sum(drive.duration_s for entry in dwell.plan(2.5) for drive in entry.drives)
    for source, whole in (("33511B", False), ("SDG1032X", True)):
        with laboratory(source_bench(source)) as lab:
            assert (rehearse(dwell, lab.bench.amplifier).duration_s >= played_s) is whole
