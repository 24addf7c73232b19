"""State of each campaign item, computed from its runs: done, stale, missing, failed, next."""

from dataclasses import replace
from pathlib import Path

import pytest

from app.archive.run_reading import summarize_run
from app.archive.run_summary import RunSummary
from app.campaign.plan import PAPER_ITEMS, CampaignItem, drop_unknown_protocols
from app.campaign.series import evaluate_items
from app.campaign.status import ItemStatus, NextAction
from protocols.base import EstimatedQuantity, Outcome, Verdict
from protocols.runfile.record import RunRecord

A, B, C = CampaignItem("a", "p"), CampaignItem("b", "q", needs=("a",)), CampaignItem("c", "r", needs=("b",))


def made(
    name: str, at: int, state: str = "completed", points: int = 3, verdict: Verdict | None = None, **estimates: float
) -> RunSummary:
    record = RunRecord(
        protocol="p",
        specimen="T1",
        start_time=f"2026-11-21T12:{at:02d}",
        reason="why",
        entry_count=points,
        verdict=verdict or Verdict(),
        estimates=tuple(EstimatedQuantity(key, value, 0.1, "1", "") for key, value in estimates.items()),
    )
    return summarize_run(f"{name}{at}.h5", record, state=state)


def standings(
    runs: dict, based_on: dict | None = None, items: tuple[CampaignItem, ...] = (A, B, C)
) -> list[tuple[str, str]]:
    return [(line.status, line.next_action) for line in evaluate_items(Path(), items, {}, runs, based_on or {})]


def basis(need: str, run: str, **estimates: float) -> dict:
    return {need: {"run": run, "estimates": estimates}}


def test_nothing_measured_the_first_is_to_do_and_the_others_wait() -> None:
    assert standings({}) == [("missing", "run"), ("waiting", "wait"), ("waiting", "wait")]


@pytest.mark.parametrize(
    ("state", "points", "expected"),
    [
        ("completed", 3, ("done", "")),
        ("stopped", 3, ("unfinished", "resume")),
        ("crashed", 3, ("unfinished", "resume")),
        ("failed", 3, ("unfinished", "resume")),
        ("crashed", 0, ("missing", "run again")),
        ("failed", 0, ("failed", "run again")),
        ("unsafe", 3, ("failed", "run again")),
        ("running", 3, ("running", "wait")),
    ],
)
def test_how_a_run_ended_says_how_an_item_stands(state: str, points: int, expected: tuple[str, str]) -> None:
    assert standings({"a": [made("a", 1, state, points)]})[0] == expected


def test_a_run_that_was_broken_off_later_does_not_undo_a_good_one() -> None:
    (line, *_) = evaluate_items(Path(), (A,), {}, {"a": [made("a", 1), made("a", 2, "stopped")]}, {})
    assert line.status is ItemStatus.DONE
    assert line.run == Path("a1.h5")
    assert "a later run is stopped" in line.reason


def test_what_its_own_verdicts_fail_is_not_done() -> None:
    (line, *_) = evaluate_items(Path(), (A,), {}, {"a": [made("a", 1)._replace(failed_checks="polarity")]}, {})
    assert (line.status, line.next_action, line.reason) == (
        ItemStatus.FAILED,
        NextAction.REPEAT,
        "did not pass: polarity",
    )


@pytest.mark.parametrize(
    ("verdict", "expected"),
    [
        ("good", ("done", "", "good: why")),
        ("doubtful", ("done", "", "doubtful: 2 of 18 clipped; choose a larger range")),
        ("no result", ("failed", "run again", "no result: 2 of 18 clipped; choose a larger range")),
        ("did not pass", ("failed", "run again", "did not pass: 2 of 18 clipped; choose a larger range")),
    ],
)
def test_an_item_is_done_only_if_the_verdict_on_its_run_has_a_result(
    verdict: str, expected: tuple[str, str, str]
) -> None:
    reasons = () if verdict == "good" else ("2 of 18 clipped; choose a larger range",)
    judged = made("a", 1, verdict=Verdict(Outcome(verdict), reasons))
    (line, *_) = evaluate_items(Path(), (A,), {}, {"a": [judged]}, {})
    assert (line.status, line.next_action, line.reason) == expected
    assert not line.accepted, "the operator accepts it, or not"


def test_what_came_before_was_measured_again() -> None:
    runs = {"a": [made("a", 1, k2=7.0), made("a", 5, k2=7.0)], "b": [made("b", 2)], "c": [made("c", 3)]}
    based = {"b2.h5": basis("a", "a1.h5", k2=7.0), "c3.h5": basis("b", "b2.h5")}
    lines = evaluate_items(Path(), (A, B, C), {}, runs, based)
    assert [(line.status, line.reason) for line in lines] == [
        (ItemStatus.DONE, "why"),
        (ItemStatus.STALE, "a was measured again"),
        (ItemStatus.STALE, "b is stale"),
    ]
    assert [line.next_action for line in lines] == [NextAction.NONE, NextAction.REPEAT, NextAction.WAIT]


def test_what_came_before_tells_another_number_now() -> None:
    runs = {"a": [made("a", 1, k2=7.5)], "b": [made("b", 2)]}
    line = evaluate_items(Path(), (A, B), {}, runs, {"b2.h5": basis("a", "a1.h5", k2=7.0)})[1]
    assert line.reason == "k2 of a changed from 7 to 7.5"
    assert standings(runs, {"b2.h5": basis("a", "a1.h5", k2=7.5)}, (A, B))[1] == ("done", "")


def test_a_run_made_by_hand_is_judged_by_the_time() -> None:
    assert standings({"a": [made("a", 1)], "b": [made("b", 2)]}, items=(A, B))[1] == ("done", "")
    later = standings({"a": [made("a", 3)], "b": [made("b", 2)]}, items=(A, B))
    assert later[1] == (ItemStatus.STALE, NextAction.REPEAT)


def test_what_is_skipped_is_not_waited_for() -> None:
    skipped = replace(A, skipped="no weights")
    assert standings({}, items=(skipped, B, C)) == [("skipped", ""), ("missing", "run"), ("waiting", "wait")]


def test_the_paper_orders_k2_before_mu_before_c0_before_c_s() -> None:
    by_name = {item.name: item for item in PAPER_ITEMS}
    order = list(by_name)
    assert all(order.index(need) < order.index(item.name) for item in PAPER_ITEMS for need in item.needs)

    def below(name: str) -> set[str]:
        return {n for need in by_name[name].needs for n in {need} | below(need)}

    assert {"loading", "resonance"} <= below("steps") < below("dwell") < below("membrane")
    left = drop_unknown_protocols(PAPER_ITEMS, {"wiring-check", "sine-dwell", "membrane-series"})
    assert [(item.name, item.needs) for item in left] == [
        ("wiring", ()),
        ("dwell", ("wiring",)),
        ("membrane", ("dwell", "wiring")),
    ]


def test_run_made_outside_the_campaign_is_stale_where_its_basis_is_newer() -> None:
    older = {"a": [made("a", 5)], "b": [made("b", 3)]}
    assert standings(older)[1] == (ItemStatus.STALE, NextAction.REPEAT)
    newer = {"a": [made("a", 1)], "b": [made("b", 3)]}
    assert standings(newer)[1] == ("done", "")
