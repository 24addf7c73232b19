"""Two faults at a time: at rest by the volts of the simulated bench, or reported; `docs/double-faults.md` has every cell."""

import os
import re
from pathlib import Path

import pytest

from tests.helpers.double_faults import DONE, PAIRS, SOURCES, double_cell, pairs_of

pytestmark = [
    pytest.mark.breaks_the_drive,
    pytest.mark.skipif(os.name != "posix", reason="programs cannot be frozen here"),
]

DEALT = ("level", "sine", "arbitrary", "ramp", "sweep")


@pytest.mark.deep
@pytest.mark.parametrize(("number", "pair"), [*enumerate(PAIRS)], ids=[" x ".join(pair) for pair in PAIRS])
def test_a_drive_under_two_faults_ends_at_rest_or_is_reported(
    number: int, pair: tuple[str, str], tmp_path: Path
) -> None:
    """Drives are dealt to the pairs."""
    seen = double_cell("33511B", DEALT[number % len(DEALT)], pair, tmp_path)
    assert seen.faults == [], seen.text + seen.next_text


@pytest.mark.deep
@pytest.mark.parametrize("source", ["SDG1032X", "card"])
@pytest.mark.parametrize(
    "pair",
    [("program killed", "wire cut"), ("program killed", "slow wire"), ("card lost", "Stop pressed")],
    ids=" x ".join,
)
def test_other_sources_under_two_faults(source: str, pair: tuple[str, str], tmp_path: Path) -> None:
    if pair not in pairs_of(source):
        pytest.skip("this source cannot have them")
    seen = double_cell(source, "level", pair, tmp_path)
    assert seen.faults == [], seen.text + seen.next_text


@pytest.mark.deep
def test_the_watchdog_hastens_the_end_of_a_level_where_its_commissioning_allows_it(tmp_path: Path) -> None:
    """The level ends by itself 8.6 s after its begin; it has just been reached when the program is killed."""
    seen = double_cell("SDG1032X_commissioned", "level", ("program killed", "card lost"), tmp_path)
    assert seen.faults == [], seen.text
    assert seen.rest_s < 6.0
    assert any(report.what == DONE for report in seen.reports)


def test_the_table_in_the_documentation_has_every_pair_and_no_fault() -> None:
    """`python docs/make_double_faults.py` runs every cell and writes it."""
    text = (Path(__file__).parents[2] / "docs" / "double-faults.md").read_text()
    assert "FAULT" not in text
    for source, kind in SOURCES.items():
        (table,) = re.findall(rf"## .*\({source}\)\n(.*?)\n## ", text, re.DOTALL)
        assert f"| first fault | second fault | {' | '.join(kind.drives)} |" in table
        for pair in pairs_of(source):
            assert f"| {' | '.join(pair)} | " in table, "a pair is new: python docs/make_double_faults.py --missing"
