"""Causes of a misfit on the command line: the paper's 11 g of which 7.73 g act, from tables to the fit with the mass fraction.

The tables are made by finite elements, which share nothing with the fit.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from app.cli.main import main
from app.identification import SpecimenSheet, identify_observations, nonideality_lines
from model.identification import FitOptions
from tests.helpers.importing import brought
from tests.helpers.laboratory import Laboratory, measure
from tests.helpers.messages import assert_names

pytestmark = pytest.mark.deep


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Loads on the MFC side and nine added masses, of which 70 % act."""
    return tables(tmp_path_factory.mktemp("paper"), Laboratory(mass_fraction=7.73 / 11))


def tables(folder: Path, laboratory: Laboratory) -> list[str]:
    """Import the tables of loads and masses of a laboratory."""
    loading, _, masses, *_ = measure(laboratory, 3, small=True).runs
    rows: Any = zip(loading.load_n, 1e6 * loading.deflection_m, 1e6 * loading.errors_m, strict=True)  # type: ignore[union-attr]
    (folder / "s.csv").write_text(
        "load [N],deflection [um],u_deflection [um]\n" + "".join(f"{a:.8g},{b:.8g},{c:.4g}\n" for a, b, c in rows)
    )
    rows = zip(1e3 * masses.mass_kg, masses.frequency_hz, masses.errors_hz, strict=True)  # type: ignore[union-attr]
    (folder / "m.csv").write_text(
        "mass [g],frequency [Hz],u_frequency [Hz]\n" + "".join(f"{a:.8g},{b:.8g},{c:.4g}\n" for a, b, c in rows)
    )
    return [str(brought(Path(folder / name))) for name in ("s.csv", "m.csv")]


def answer(capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_mass_fraction_is_named_first_and_freed(runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", *runs, "--plain", "--json"]) == 0
    plain = answer(capsys)
    assert plain["adequate"] is False
    assert plain["causes"]["cause"][0] == "mass_fraction"
    assert "most likely because the masses put in the cylinder act as 7" in plain["adequacy"]
    assert main(["identify", *runs, "--plain"]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "fit with the first cause: identify --also mass_fraction" in shown
    assert main(["identify", *runs, "--plain", "--also", "mass_fraction", "--json"]) == 0
    better = answer(capsys)
    assert better["adequate"] is True, better["adequacy"]
    table = better["parameters"]
    found = {n: (v, e) for n, v, e in zip(table["name"], table["value"], table["standard_error"], strict=True)}
    assert abs(found["mass_fraction"][0] - 7.73 / 11) < 2.5 * found["mass_fraction"][1]
    assert abs(found["k2"][0] - 7e-3) < 2.5 * found["k2"][1]
    assert 1.96 * found["k2"][1] < 0.15 * 7e-3  # with ruler and caliper


def test_the_mass_fraction_is_found_without_asking(runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    """Creep and clamp are as uncertain as those of any specimen."""
    assert main(["identify", *runs, "--json"]) == 0
    found = answer(capsys)
    assert found["adequate"] is True, found["adequacy"]
    beyond = dict(zip(found["nonidealities"]["name"], found["nonidealities"]["words"], strict=True))
    assert beyond.pop("mass_fraction").startswith("the masses put in the cylinder act as 7")
    assert beyond == {"creep": "not seen", "clamp_flexibility": "assumed"}
    table = found["parameters"]
    k2 = dict(zip(table["name"], zip(table["value"], table["standard_error"], strict=True), strict=True))["k2"]
    assert abs(k2[0] - 7e-3) < 1.96 * k2[1] < 0.3 * 7e-3


def test_the_paper_s_case_has_k2_within_fifteen_percent() -> None:
    """11 g put in, 7.73 g act: loads on both sides, nine masses and a free dwell, with dimensions by ruler and caliper."""
    runs = measure(Laboratory(mass_fraction=7.73 / 11), 3, small=True)
    found = identify_observations("T1", runs, "joint", FitOptions(n=20), sheet=SpecimenSheet("T1"))
    assert found.adequacy is not None
    assert found.adequacy.adequate is True
    assert found.steps == ()
    k2 = next(e for e in found.identified if e.name == "k2")
    assert abs(k2.value - 7e-3) < 1.96 * k2.standard_error < 0.15 * 7e-3
    fraction = next(e for e in found.nonidealities if e.name == "mass_fraction")
    assert abs(fraction.value - 7.73 / 11) < 1.96 * fraction.standard_error
    assert nonideality_lines(found)[0].startswith("the masses put in the cylinder act as 7")


@pytest.fixture(scope="module")
def tared(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Loads with a pan of 5 g that was not stated."""
    folder = tmp_path_factory.mktemp("pan")
    return tables(folder, Laboratory(load_offset_kg=5e-3))


def test_a_cause_that_is_not_expected_is_added_and_needs_agreement(
    tared: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", *tared, "--json"]) == 0
    found = answer(capsys)
    assert found["adequate"] is True, found["adequacy"]
    assert found["steps"]["added"] == ["", "load_offset"]
    assert found["steps"]["chi_square"][1] < found["steps"]["chi_square"][0] / 2
    assert found["proposed"] == ["load_offset"]
    assert main(["identify", *tared, "--accept", "--by", "me"]) == 2
    assert "adequate only with load_offset" in capsys.readouterr().err
    assert main(["identify", *tared, "--also", "load_offset", "--accept", "--by", "me"]) == 0
    capsys.readouterr()
    assert main(["identify", *tared, "--plain", "--json"]) == 0
    assert answer(capsys)["adequate"] is False


def test_nonidealities_are_for_the_joint_fit(runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", *runs, "--method", "chain", "--also", "mass_fraction"]) == 2
    assert_names(capsys.readouterr().err, "--also", "chain")
    assert main(["identify", *runs, "--also", "mass_share"]) == 2
    assert "mass_share is not an identifiable parameter" in capsys.readouterr().err
