"""Files named for a specimen: different specimens never share one, and files of earlier versions are still found."""

import json
import shutil
from pathlib import Path
from urllib.parse import unquote

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError, campaign_path
from app.identification.calibrations import (
    CalibrationError,
    Calibrations,
    calibrations_path,
    read_calibrations,
    write_calibrations,
)
from model.identification import Calibration
from protocols.runfile.names import MAX_NAME_BYTES, folded_name, safe_name
from tests.helpers.messages import assert_names
from tests.helpers.run_files import FOUND
from tests.helpers.texts import texts

ALIKE = ("A-1", "A/1", "A 1", "A_1", "A:1", "A%1", "A%2F1", "A\\1", "A.1", "A 1.")


def calibration(specimen: str) -> Calibration:
    return Calibration(specimen, 1, (FOUND,), ((1e-4,),), "m", (), "1", "2026-01-01", "", False, {})


def test_names_that_need_no_escape_stay_and_others_are_reversible() -> None:
    for name in ("T7", "A-1", "a.b", "µ7", "Ärmel", "unnamed", "x" * 100):
        assert safe_name(name) == folded_name(name) == name
    assert [safe_name(name) for name in ("A/1", "A 1", "A_1", "CON", "com1.x", "end.", ".hidden")] == [
        "A%2F1", "A%201", "A%5F1", "%43ON", "%63om1.x", "end%2E", "%2Ehidden",
    ]  # fmt: skip
    long = [safe_name("x" * 150 + end) for end in "ab"]
    assert long[0] != long[1]
    assert {len(name) for name in long} == {MAX_NAME_BYTES}


@given(st.lists(texts(min_size=1, max_size=40), min_size=2, max_size=2, unique=True))
def test_different_names_never_coincide(names: list[str]) -> None:
    first, second = map(safe_name, names)
    assert first != second
    for name, safe in zip(names, (first, second), strict=True):
        assert len(safe.encode()) <= MAX_NAME_BYTES
        assert not set(safe) & set('/\\:*?"<>| _\0')
        assert safe[-1] not in ". "
        if "~" not in safe:
            assert unquote(safe, errors="surrogatepass") == name


def test_every_specimen_has_its_own_calibrations_and_campaign(tmp_path: Path) -> None:
    for name in ALIKE:
        write_calibrations(tmp_path, name, Calibrations((calibration(name),), 1))
        Campaign.create(tmp_path, name, True)
    for name in ALIKE:
        assert read_calibrations(tmp_path, name).get().specimen == name
        assert Campaign.open(tmp_path, name).specimen == name
    assert len(list(tmp_path.iterdir())) == 2 * len(ALIKE)


def test_a_file_of_an_earlier_version_is_used_by_its_specimen_only(tmp_path: Path) -> None:
    write_calibrations(tmp_path, "A/1", Calibrations((calibration("A/1"),), 1))
    Campaign.create(tmp_path, "A/1", True)
    calibrations, campaign = tmp_path / "A-1.calibrations.json", tmp_path / "A-1.campaign.json"
    calibrations_path(tmp_path, "A/1").rename(calibrations)
    campaign_path(tmp_path, "A/1").rename(campaign)
    assert read_calibrations(tmp_path, "A/1").get().specimen == "A/1"
    assert Campaign.open(tmp_path, "A/1").path == campaign
    write_calibrations(tmp_path, "A/1", Calibrations((calibration("A/1"),), 0))
    assert json.loads(calibrations.read_text("utf-8"))["active"] == 0
    assert read_calibrations(tmp_path, "A 1") == Calibrations()
    says = r"A-1.{}.json belongs to specimen A/1, not to A-1: .* rename it to A%2F1\.{}\.json"
    with pytest.raises(CalibrationError, match=says.format("calibrations", "calibrations")):
        read_calibrations(tmp_path, "A-1")
    with pytest.raises(CampaignError, match=says.format("campaign", "campaign")):
        Campaign.open(tmp_path, "A-1")
    with pytest.raises(CampaignError, match="belongs to specimen A/1"):
        Campaign.create(tmp_path, "A-1", True)


def test_a_file_that_two_specimens_shared_is_refused_to_both(tmp_path: Path) -> None:
    both = Calibrations((calibration("A-1"), calibration("A/1")), 1)
    write_calibrations(tmp_path, "A-1", both)
    for name in ("A-1", "A/1"):
        with pytest.raises(CalibrationError) as refused:
            read_calibrations(tmp_path, name)
        assert_names(str(refused.value).removeprefix(str(calibrations_path(tmp_path, name))), name)


def test_names_that_differ_in_case_only_are_refused_where_the_file_system_folds_them(tmp_path: Path) -> None:
    write_calibrations(tmp_path, "T7", Calibrations((calibration("T7"),), 1))
    shutil.copy(calibrations_path(tmp_path, "T7"), tmp_path / "t7.calibrations.json")  # what such a file system finds
    with pytest.raises(CalibrationError, match="does not distinguish upper and lower case"):
        read_calibrations(tmp_path, "t7")
