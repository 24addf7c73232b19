"""Random protocols, operators, faults, kills, delays and second hands; `docs/fault-search.md` has the counts."""

import re
import runpy
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.single_faults.system_calls import supported

ROOT = Path(__file__).parents[2]

FOUND = (
    47,
    366,
    905,
    909,
    914,
    1276,
    1898,
    4188,
    4473,
    4511,
    5527,
    6065,
    6101,
    6168,
    6342,
    6777,
    6860,
    8407,
    14521,
    17527,
)
"""Seeds whose violation was mended, one of each kind."""

OPEN: set[int] = set()
"""Seeds with a violation that is not mended yet; a new page must not add to them silently."""


def assert_searched(*options: str) -> None:
    command = [sys.executable, "docs/make_fault_search.py", *options]
    ran = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr


@pytest.mark.deep
@pytest.mark.skipif(not supported(), reason="system calls are shown by Linux only")
def test_runs_drawn_by_fixed_seeds_keep_what_is_required() -> None:
    """About a minute; `python docs/make_fault_search.py --minutes 600 --log LOG` is a night."""
    assert_searched("--seed", "1", "--runs", "80")


@pytest.mark.deep
@pytest.mark.skipif(not supported(), reason="system calls are shown by Linux only")
@pytest.mark.parametrize("seed", FOUND)
def test_a_run_that_was_found_keeps_what_is_required(seed: int) -> None:
    assert_searched("--seed", str(seed))


def test_the_page_adds_later_seeds_to_its_counts_and_no_seed_twice() -> None:
    script = runpy.run_path(str(ROOT / "docs" / "make_fault_search.py"))
    before = (ROOT / "docs" / "fault-search.md").read_text("utf-8")
    last = script["Counts"].of_page(before).seeds[1]
    run = {"date": "2026-12-01", "protocol": "sweep", "operator": "slow", "status": "unsafe", "happened": ["kill"]}
    bad = {**run, "seed": last + 1, "wrong": ["a jump"]}
    assert script["page"]([], before) == before
    later = script["page"]([{**bad, "seed": last}, bad], before)
    counts, earlier = script["Counts"].of_page(later), script["Counts"].of_page(before)
    assert counts.runs == earlier.runs + 1
    assert counts.seeds[1] == last + 1
    assert counts.happened["kill"]["unsafe"] == earlier.happened["kill"]["unsafe"] + 1
    assert counts.happened[script["ALL"]].total() == counts.runs == counts.operators.total()
    assert counts.bad == {**earlier.bad, last + 1: "a jump"}
    mended = script["Counts"].of_page(script["page"]([{**bad, "wrong": []}], later))
    assert (mended.runs, mended.bad) == (counts.runs, earlier.bad)


def test_the_page_has_no_violation_beyond_the_open_ones() -> None:
    text = (ROOT / "docs" / "fault-search.md").read_text("utf-8")
    assert re.search(rf"^\d+ runs, seeds \d+ to \d+, .*; {len(OPEN)} violate a requirement\.$", text, re.MULTILINE)
    table = text.partition("## Violations")[2].partition("## ")[0]
    assert {int(seed) for seed in re.findall(r"^\| (\d+) \|", table, re.MULTILINE)} == OPEN
