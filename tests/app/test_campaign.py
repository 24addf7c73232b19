"""Campaign: item states computed from the run files, robust against any termination of the program."""

import json
import re
import shutil
import subprocess
import sys
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.campaign.campaign import Campaign
from app.campaign.plan import PAPER_ITEMS, CampaignError, CampaignItem, campaign_path
from app.campaign.queue import CampaignRunner, rehearse_campaign
from app.campaign.status import ItemStatus, NextAction
from app.campaign.summary import identified_tactor, identify_campaign_runs
from app.cli.main import main
from app.session.session import Session
from drivers.errors import BenchError
from model.parameters import Tactor
from protocols.base import Event, LogMessage, Prompt, PromptShown, RunStarted
from protocols.registry import PROTOCOLS
from protocols.runfile.reader import Run
from protocols.runfile.schema import RESERVE_BYTES
from sim_hardware.testing.safe_volts import assert_safe_voltage
from tests.helpers.simulated_bench import laboratory

QUICK = (
    CampaignItem("wiring", "wiring-check", {"record_s": 0.5, "wait_s": 0.2}),
    CampaignItem(
        "steps",
        "voltage-steps",
        {"levels_v": (2.0, 4.0), "repeats": 2, "rest_s": 0.3, "read_s": 0.3, "hold_s": 0.5},
        ("wiring",),
        (Prompt("remove-membrane", "Take the membrane off.", hands_on=True),),
    ),
    CampaignItem("dwell", "sine-dwell", {"frequencies_hz": (120, 160)}, ("steps",)),
)


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[Event]]:
    """A campaign from nothing to its end; its folder and what happened."""
    folder, events = tmp_path_factory.mktemp("runs"), []
    carry_out(Campaign.create(folder, "T1", True, QUICK), events)
    return folder, events


@pytest.fixture
def measured(once: tuple[Path, list[Event]], tmp_path: Path) -> tuple[Campaign, list[Event]]:
    """That campaign in a folder of one's own."""
    shutil.copytree(once[0], tmp_path / "runs")
    return Campaign.open(tmp_path / "runs", "T1"), list(once[1])


def carry_out(campaign: Campaign, events: list[Event], most: int = 9) -> None:
    with laboratory() as lab:
        conductor = CampaignRunner(campaign)
        session = Session(lambda: nullcontext(lab), [conductor, events.append], lab.operator)
        session.start()
        try:
            while most and (line := campaign.next_item()) is not None:
                most -= 1
                conductor.start(session, line)
                assert session.finished.wait(60)
        finally:
            assert session.close(60)
        assert_safe_voltage(lab.control.report())


def test_from_nothing_to_the_end(measured) -> None:
    campaign, events = measured
    lines = campaign.item_states()
    assert [line.status for line in lines] == [ItemStatus.DONE] * 3
    assert campaign.next_item() is None
    prompts = [event.prompt.action for event in events if isinstance(event, PromptShown)]
    at = prompts.index("remove-membrane")
    assert prompts[at - 1 : at + 2] == ["disable-high-voltage", "remove-membrane", "enable-high-voltage"]
    carried = campaign.accepted_estimates(campaign.items[2])
    assert carried["static_gain_above_rest"].value == pytest.approx(1.427e-4, rel=0.01)
    assert "bench_latency" in carried  # of the wiring check, two items below
    # Another program reads the same from the disk.
    again = Campaign.open(campaign.path.parent, "T1")
    assert [(line.status, line.run, line.estimates) for line in again.item_states()] == [
        (line.status, line.run, line.estimates) for line in lines
    ]


@pytest.mark.deep
def test_an_accepted_estimate_is_carried_into_the_next_protocol_and_the_model(measured, monkeypatch) -> None:
    campaign, _ = measured
    monkeypatch.setattr("app.campaign.campaign.CARRIED_PARAMETERS", {"settle_limit_s": "bench_latency"})
    dwell = campaign.items[2]
    with pytest.raises(CampaignError, match=r"dwell: settle_limit_s: .* greater than or equal to 0.5"):
        campaign.protocol_for(dwell)  # the wiring check's 0.4 ms did arrive
    monkeypatch.setattr("app.campaign.campaign.CARRIED_PARAMETERS", {"decay_s": "bench_latency"})
    found = {e.name: e.value for e in campaign.item_state("wiring").estimates}
    assert campaign.protocol_for(dwell).decay_s == found["bench_latency"]
    # The dwell of two points has no peak between others, which must not take mu away.
    # mu = -1.33e-5 N m/V is the truth of the simulated tactor; its stated error of 12 % is mostly that of k2.
    assert identified_tactor(campaign).mu == pytest.approx(-1.33e-5, rel=0.02)
    assert "mu" in {e.name for e in identify_campaign_runs(campaign).identified}
    campaign.reject("steps")
    campaign.reject("dwell")
    assert identified_tactor(campaign).mu == Tactor().mu


@pytest.mark.deep
def test_what_is_repeated_makes_what_rests_on_it_stale(measured) -> None:
    campaign, events = measured
    campaign.repeat("wiring")
    assert [line.status for line in campaign.item_states()] == [ItemStatus.STALE] * 3
    assert campaign.item_state("wiring").estimates, "what counted before still counts"
    assert campaign.next_item().item.name == "wiring"
    carry_out(campaign, events, most=1)
    lines = campaign.item_states()
    assert [line.status for line in lines] == [ItemStatus.DONE, ItemStatus.STALE, ItemStatus.STALE]
    assert lines[1].reason == "wiring was measured again"
    assert campaign.next_item(hands_free=True) is None  # the steps need manual actions, and the dwell depends on them


@pytest.mark.deep
def test_an_accepted_run_counts_until_the_new_one_is_accepted(measured) -> None:
    campaign, events = measured
    campaign.accept("wiring")
    first = campaign.item_state("wiring").run
    campaign.repeat("wiring")
    assert campaign.item_state("wiring").run == first
    assert "this result counts until then" in campaign.item_state("wiring").reason
    assert campaign.undo(), "a key pressed by mistake is taken back"
    assert [line.status for line in campaign.item_states()] == [ItemStatus.DONE] * 3
    campaign.repeat("wiring")
    carry_out(campaign, events, most=1)
    line = campaign.item_state("wiring")
    assert (line.status, line.run, line.next_action) == (ItemStatus.DONE, first, NextAction.NONE)
    assert line.candidate is not None
    assert campaign.item_state("dwell").status is ItemStatus.DONE, "nothing rests on the new run yet"
    campaign.reject("wiring")
    line = campaign.item_state("wiring")
    assert (line.status, line.run, line.candidate) == (ItemStatus.STALE, first, None), (
        "it is still to be measured again"
    )
    campaign.undo()
    campaign.accept("wiring")
    line = campaign.item_state("wiring")
    assert line.run != first
    assert line.candidate is None
    assert campaign.item_state("steps").status is ItemStatus.STALE
    assert first is not None
    campaign.accept("wiring", first.name)
    assert campaign.item_state("wiring").run == first, "an earlier run is selected"
    assert campaign.item_state("dwell").status is ItemStatus.DONE


def test_a_rejected_run_does_not_count_and_a_skipped_item_is_not_waited_for(measured) -> None:
    campaign, _ = measured
    campaign.reject("steps")
    assert campaign.item_state("steps").status is ItemStatus.MISSING
    assert campaign.item_state("dwell").status is ItemStatus.STALE
    campaign.skip("steps", "no time")
    assert campaign.item_state("dwell").status is ItemStatus.DONE
    campaign.skip("steps", "")
    assert campaign.item_state("steps").status is ItemStatus.MISSING


@pytest.mark.deep
def test_a_run_that_somebody_made_by_hand_counts(tmp_path: Path) -> None:
    Campaign.create(tmp_path, "T1", True, (CampaignItem("dwell", "sine-dwell", {"frequencies_hz": (120.0,)}),))
    options = ["--speed", "max", "--out", str(tmp_path), "--specimen"]
    assert main(["run", "sine-dwell", "--set", "frequencies_hz=120", *options, "T2"]) == 0
    assert main(["run", "sine-dwell", "--set", "frequencies_hz=130", *options, "T1"]) == 0
    assert Campaign.open(tmp_path, "T1").item_state("dwell").status is ItemStatus.MISSING
    assert main(["run", "sine-dwell", "--set", "frequencies_hz=120", *options, "T1"]) == 0
    assert Campaign.open(tmp_path, "T1").item_state("dwell").status is ItemStatus.DONE


def test_an_item_may_move_but_not_before_what_it_needs(tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, (*QUICK, CampaignItem("free", "sine-dwell")))
    campaign.move("free", before="wiring")
    assert [item.name for item in Campaign.open(tmp_path, "T1").items] == ["free", "wiring", "steps", "dwell"]
    with pytest.raises(CampaignError, match="dwell cannot be moved before steps: dwell needs steps before it"):
        campaign.move("dwell", before="steps")
    with pytest.raises(CampaignError, match="'lunch'"):
        campaign.move("dwell", before="lunch")


@pytest.mark.deep
def test_killed_in_the_middle_it_goes_on_where_it_was(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    steps = replace(QUICK[1], settings={**QUICK[1].settings, "repeats": 8}, needs=())
    Campaign.create(tmp_path, "T1", True, (steps, replace(QUICK[2], needs=("steps",))))
    options = ["--specimen", "T1", "--out", str(tmp_path)]
    command = [sys.executable, "-m", "app.cli.main", "campaign", "run", "--all", "--json", "--speed", "max", *options]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, cwd=Path(__file__).parents[2]) as program:
        points = 0
        for line in program.stdout:
            points += json.loads(line)["event"] == "PointMeasured"
            if points == 5:
                program.kill()
                break
    line = Campaign.open(tmp_path, "T1").item_state("steps")
    assert (line.status, line.next_action) == (ItemStatus.UNFINISHED, NextAction.RESUME)
    assert main(["campaign", "resume", "--all", "--speed", "max", *options]) == 0
    lines = Campaign.open(tmp_path, "T1").item_states()
    assert [each.status for each in lines] == [ItemStatus.DONE, ItemStatus.DONE]
    with Run(lines[0].run) as run:
        assert run.resumed_from == line.run
        assert {*map(int, run.points()["entry"])} == set(range(16))
        assert any("points carried over" in e.fields["text"] for e in run.events() if e.kind == LogMessage.kind)
    assert "done" in capsys.readouterr().out


@pytest.mark.deep
def test_a_campaign_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    options = ["--specimen", "T1", "--out", str(tmp_path)]
    assert main(["campaign", "status", *options]) == 2
    assert "tactor-bench campaign new --specimen T1" in capsys.readouterr().err
    assert main(["campaign", "new", *options]) == 0
    assert main(["campaign", "new", *options]) == 2
    assert "there is a campaign of T1 already" in capsys.readouterr().err
    assert main(["campaign", "run", "dwell", *options]) == 2
    assert "dwell has to wait" in capsys.readouterr().err
    assert main(["campaign", "skip", "dwel", *options]) == 2
    assert "'dwel'" in capsys.readouterr().err
    assert main(["campaign", "resume", *options]) == 2
    assert "no item was interrupted" in capsys.readouterr().err
    assert main(["campaign", "move", "dwell", "--before", "steps", *options]) == 2
    assert "cannot be moved before" in capsys.readouterr().err
    assert main(["campaign", "status", "--json", *options]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["items"][0]["item"] == "wiring"
    assert [item["protocol"] for item in result["items"]] == [
        i.protocol for i in PAPER_ITEMS if i.protocol in PROTOCOLS
    ]
    assert main(["campaign", "rehearse", *options]) == 0
    assert "+1500 V" in capsys.readouterr().out


@pytest.mark.parametrize(
    "text", ["{", "[]", '{"kind": "campaign", "version": 1}', '{"kind": "campaign", "version": 9}']
)
def test_a_file_that_is_no_campaign_is_a_sentence(text: str, tmp_path: Path) -> None:
    campaign_path(tmp_path, "T1").write_text(text)
    with pytest.raises(
        CampaignError, match=r"cannot be understood .* correct the file|a newer version of this program"
    ):
        Campaign.open(tmp_path, "T1")


@pytest.mark.parametrize("lost", ["prepare", "choices"])
def test_a_campaign_file_without_prompts_of_an_item_names_the_item(lost: str, tmp_path: Path) -> None:
    Campaign.create(tmp_path, "T1", True, PAPER_ITEMS)
    path = campaign_path(tmp_path, "T1")
    record = json.loads(path.read_text("utf-8"))
    item = next(item for item in record["items"] if item["prepare"])
    del (item if lost == "prepare" else item["prepare"][0])[lost]
    path.write_text(json.dumps(record))
    with pytest.raises(CampaignError, match=f"{item['name']}.*{lost}"):
        Campaign.open(tmp_path, "T1")


def test_the_rehearsal_adds_up_what_is_left(tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, QUICK)
    with laboratory() as lab:
        rehearsal = rehearse_campaign(campaign, lab.bench)
        assert [item.name for item, _ in rehearsal.items] == ["wiring", "steps", "dwell"]
        assert rehearsal.duration_s == sum(one.duration_s for _, one in rehearsal.items)
        assert rehearsal.prompts == 3 * 2 + 3  # high voltage off and on; once more around the membrane
        assert (rehearsal.lowest_specimen_v, rehearsal.highest_specimen_v) == (-500, 1500)
        campaign.skip("dwell")
        assert rehearse_campaign(campaign, lab.bench).highest_specimen_v == 900


def test_a_campaign_for_which_the_disk_has_no_space_is_refused_at_the_rehearsal(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, QUICK)
    with laboratory() as lab:
        needed = rehearse_campaign(campaign, lab.bench).file_bytes
        for spare, refused in ((1, False), (-1, True)):
            free = needed + RESERVE_BYTES + spare
            monkeypatch.setattr("shutil.disk_usage", lambda _, free=free: SimpleNamespace(free=free))
            if refused:
                with pytest.raises(BenchError, match=rf"disk of {re.escape(str(tmp_path))}.* MB"):
                    rehearse_campaign(campaign, lab.bench)
            else:
                rehearse_campaign(campaign, lab.bench)


def test_what_was_found_can_be_accepted_and_that_is_kept(measured) -> None:
    campaign, _ = measured
    assert not campaign.item_state("steps").accepted
    campaign.accept("steps")
    assert Campaign.open_file(campaign.path).item_state("steps").accepted
    campaign.reject("steps")
    assert not campaign.item_state("steps").accepted
    with pytest.raises(CampaignError, match="steps has no run that could be accepted: it is missing"):
        campaign.accept("steps")


def test_every_change_of_the_plan_can_be_taken_back(tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, (*QUICK, CampaignItem("free", "sine-dwell")))
    plans = [campaign.items]
    for change in (
        lambda: campaign.move("free", "wiring"),
        lambda: campaign.skip("steps"),
        lambda: campaign.move("free"),
    ):
        change()
        plans.append(campaign.items)
    for before in reversed(plans[:-1]):
        assert campaign.undo()
        assert [(i.name, i.skipped) for i in Campaign.open_file(campaign.path).items] == [
            (i.name, i.skipped) for i in before
        ]
    assert not campaign.undo()
    for after in plans[1:]:
        assert campaign.redo()
        assert campaign.items == after
    assert not campaign.redo()
    campaign.undo()
    campaign.skip("dwell")
    assert not campaign.redo()


def test_the_conductor_leaves_runs_alone_that_are_not_its_own(tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, QUICK)
    conductor = CampaignRunner(campaign)
    (tmp_path / "20990101T000000Z_T1_wiring-check.h5").write_text("being written: nobody may open it")
    conductor(RunStarted("wiring-check", str(tmp_path / "20990101T000000Z_T1_wiring-check.h5"), 1.0, 1, True))
    assert campaign.item_state("wiring").status is ItemStatus.MISSING
    assert not json.loads(campaign.path.read_text("utf-8"))["based_on"]
