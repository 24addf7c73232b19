"""Series of a campaign: one item that repeats a protocol over the values of one parameter, with its results as a curve."""

import json
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from app.archive import RunSummary
from app.archive.run_reading import summarize_run
from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError, CampaignItem, campaign_path
from app.campaign.queue import CampaignRunner, next_item_after, rehearse_campaign
from app.campaign.series import evaluate_items, series_curves, varied_unit
from app.campaign.status import ItemState, ItemStatus, NextAction
from app.cli.main import main
from app.common import ExitCode
from app.session.session import Session
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import laboratory

LEVELS_V = (1.0, 3.0, 2.0)
QUICK = {"frequencies_hz": (140, 160), "record_s": 0.2}
SERIES = CampaignItem("levels", "sine-dwell", QUICK, varied="peak_to_peak_v", values=LEVELS_V)
PLAIN = CampaignItem("dwell", "sine-dwell", {"record_s": 0.2})


def test_an_item_of_an_earlier_version_has_the_present_names_of_parameters() -> None:
    stored = {**PLAIN.as_record(), "settings": {"wanted": 0.01}, "varied": "wanted", "values": [0.02]}
    item = CampaignItem.from_record(stored)
    assert item.settings == {"target_relative_uncertainty": 0.01}
    assert item.varied == "target_relative_uncertainty"


def measure(campaign: Campaign, most: int) -> list[tuple[str, float]]:
    """Measure the next items as a queue does; return items and drives."""
    done: list[tuple[str, float]] = []
    with laboratory() as lab:
        runner = CampaignRunner(campaign)
        session = Session(lambda: nullcontext(lab), [runner], lab.operator)
        session.start()
        try:
            line = campaign.next_item()
            while line is not None and len(done) < most:
                request = runner.prepare(line)
                done.append((request.item, request.protocol.model_dump()["peak_to_peak_v"]))
                runner.submit(session, request)
                assert session.finished.wait(60)
                line = next_item_after(campaign, campaign.item_state(line.item.name), hands_free=True)
        finally:
            assert session.close(60)
        assert_safe_voltage(lab.control.report())
    return done


@pytest.mark.deep
def test_a_series_is_one_item_and_its_results_are_a_curve(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, (SERIES, PLAIN))
    assert json.loads(campaign_path(tmp_path, "T1").read_text())["version"] == 2
    with laboratory() as lab:
        whole = {item.name: one for item, one in rehearse_campaign(campaign, lab.bench).items}["levels"]
    assert whole.entries == 2 * len(LEVELS_V)
    assert measure(campaign, 1) == [("levels", 1.0)]
    campaign = Campaign.open(tmp_path, "T1")  # after a restart
    state = campaign.item_state("levels")
    assert (state.status, state.next_action) == (ItemStatus.MISSING, NextAction.RUN)
    assert state.reason == "1 of 3 values; next peak to peak 3 V: not measured yet"
    with pytest.raises(CampaignError, match="before all of its values are measured"):
        campaign.accept("levels")
    # The queue goes through the values in their order, and then to the next item: the runs of the series are not its runs.
    assert measure(campaign, 3) == [("levels", 3.0), ("levels", 2.0), ("dwell", 5.0)]
    state = campaign.item_state("levels")
    assert state.status is ItemStatus.DONE
    assert campaign.item_state("dwell").run not in [step.run for step in state.steps]
    curve = series_curves(state)[-1]
    assert curve.x.tolist() == [1.0, 2.0, 3.0]
    for drive, largest_m in zip(curve.x, curve.y, strict=True):
        (file,) = [step.run for step in state.steps if step.item.settings["peak_to_peak_v"] == drive]
        assert file is not None
        with Run(file) as run:
            assert largest_m == run.points()["peak_to_peak"].max()
    assert curve.y[2] > 2 * curve.y[0]
    campaign.accept("levels")
    assert campaign.item_state("levels").accepted
    csv = tmp_path / "levels.csv"
    arguments = ["campaign", "curve", "levels", "--specimen", "T1", "--out", str(tmp_path)]
    assert main([*arguments, "--csv", str(csv), "--picture", str(tmp_path / "levels.png")]) == ExitCode.DONE
    assert [line.partition(",")[0] for line in csv.read_text().splitlines()[1:]] == ["1.0", "2.0", "3.0"]
    assert (tmp_path / "levels.png").read_bytes().startswith(b"\x89PNG")
    assert "SIMULATED" in capsys.readouterr().out
    campaign.reject("levels", state.steps[1].run.name if state.steps[1].run else "")
    state = campaign.item_state("levels")
    assert state.step is not None
    assert state.step.settings["peak_to_peak_v"] == 3.0
    assert not state.accepted


def made(name: str, volts: float, at: int, state: str = "completed", points: int = 3) -> RunSummary:
    figures = [("natural_frequency", 160.0 - volts, 0.1, 0.2, "Hz", "")] if state == "completed" else []
    record = RunRecord(
        protocol="sine-dwell",
        specimen="T1",
        start_time=f"2026-11-21T12:{at:02d}",
        reason="why",
        entry_count=points,
        parameters={"peak_to_peak_v": volts},
    )
    return summarize_run(f"{name}.h5", record, state=state)._replace(figures_json=json.dumps(figures))


def test_a_series_is_done_when_each_value_is_and_its_curve_is_in_the_order_of_the_values() -> None:
    def state(*runs: RunSummary, item: CampaignItem = SERIES) -> ItemState:
        (found,) = evaluate_items(Path("runs"), (item,), {}, {"levels": runs}, {})
        return found

    one, two, three = made("a", 1.0, 1), made("b", 2.0, 3), made("c", 3.0, 2)
    assert (state().status, state().next_action) == (ItemStatus.MISSING, NextAction.RUN)
    assert [step.settings["peak_to_peak_v"] for step in state(one).pending] == [3.0, 2.0]
    assert state(one).step == state(one).pending[0]
    stopped = state(one, made("s", 3.0, 2, "stopped"))
    assert (stopped.status, stopped.next_action) == (ItemStatus.UNFINISHED, NextAction.RESUME)
    assert stopped.resumed_run == Path("runs/s.h5")
    assert state(one, made("r", 3.0, 2, "running", 0)).next_action is NextAction.WAIT
    assert series_curves(state(one)) == ()
    whole = state(one, two, three)
    assert (whole.status, whole.next_action, whole.run) == (ItemStatus.DONE, NextAction.NONE, Path("runs/b.h5"))
    (curve,) = series_curves(whole)
    assert {axis.name: values.tolist() for axis, values in curve.columns()} == {
        "peak_to_peak_v": [1.0, 2.0, 3.0],
        "natural_frequency": [159.0, 158.0, 157.0],
        "natural_frequency_errors": [0.1] * 3,
        "natural_frequency_total_errors": [0.2] * 3,
    }
    assert curve.x_axis.unit == "V"
    assert varied_unit(CampaignItem("x", "unknown", varied="y", values=(1.0, 2.0))) == "1"
    assert varied_unit(CampaignItem("x", "sine-dwell", varied="unknown", values=(1.0, 2.0))) == "1"
    again = state(one, two, three, made("d", 3.0, 9), item=replace(SERIES, accepted=("a.h5", "b.h5", "c.h5")))
    assert again.candidate is not None
    assert again.candidate.name == "d.h5"
    assert whole.candidate is None
    first = CampaignItem("wiring", "wiring-check")
    _, waiting = evaluate_items(Path("runs"), (first, replace(SERIES, needs=("wiring",))), {}, {"levels": (one,)}, {})
    assert (waiting.status, waiting.next_action) == (ItemStatus.WAITING, NextAction.WAIT)
    assert waiting.step is None
    assert "1 of 3 values; needs wiring" in waiting.reason
    assert not whole.accepted
    assert state(one, two, three, item=replace(SERIES, accepted=("a.h5", "b.h5", "c.h5"))).accepted
    assert state(one, two, three, item=replace(SERIES, rejected=("c.h5",))).next_action is NextAction.RUN
    assert state(one, two, three, item=replace(SERIES, skipped="later")).status is ItemStatus.SKIPPED


def add(folder: Path, *arguments: str) -> int:
    return main(["campaign", "add", *arguments, "--specimen", "T1", "--out", str(folder)])


def test_a_series_is_added_by_a_command(tmp_path: Path) -> None:
    Campaign.create(tmp_path, "T1", True, (PLAIN,))
    vary = ["--vary", "peak_to_peak_v=500 mV, 1...2 step 0.5"]
    assert (
        add(tmp_path, "levels", "--protocol", "sine-dwell", *vary, "--set", "frequencies_hz=140,160") == ExitCode.DONE
    )
    item = Campaign.open(tmp_path, "T1").items[1]
    assert item.values == (0.5, 1.0, 1.5, 2.0)
    assert tuple(item.settings["frequencies_hz"]) == (140, 160)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["levels", "--vary", "peak_to_peak_v"], "NAME=VALUE"),
        (["levels", "--vary", "volume=1,2"], "no parameter 'volume'"),
        (["levels", "--vary", "frequencies_hz=1,2"], "not a single number"),
        (["levels", "--vary", "peak_to_peak_v=1,1"], "each once"),
        (["levels", "--vary", "peak_to_peak_v=1,x"], "'x'"),
        (["levels", "--vary", "peak_to_peak_v=1,90"], "peak_to_peak_v"),
        (["levels", "--vary", "peak_to_peak_v=1,2", "--set", "peak_to_peak_v=3"], "leave one of them out"),
        (["dwell", "--vary", "peak_to_peak_v=1,2"], "already"),
        (["levels", "--vary", "peak_to_peak_v=1,2", "--needs", "nothing"], "no 'nothing'"),
    ],
)
def test_a_series_that_cannot_be_measured_is_refused(
    arguments: Sequence[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    Campaign.create(tmp_path, "T1", True, (PLAIN,))
    before = campaign_path(tmp_path, "T1").read_bytes()
    assert add(tmp_path, *arguments, "--protocol", "sine-dwell") == ExitCode.USAGE
    assert says in capsys.readouterr().err
    assert campaign_path(tmp_path, "T1").read_bytes() == before


def test_a_campaign_without_series_is_read_by_earlier_versions(tmp_path: Path) -> None:
    Campaign.create(tmp_path, "T1", True, (PLAIN,))
    record = json.loads(campaign_path(tmp_path, "T1").read_text())
    assert record["version"] == 1
    assert "varied" not in record["items"][0]
