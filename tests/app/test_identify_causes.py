"""Causes of a misfit on the command line: the paper's 11 g of which 7.73 g act, from tables to the fit with the mass fraction.

The tables are made by finite elements, which share nothing with the fit.
"""

import json
from pathlib import Path
from typing import Any

import pytest

from app.cli.main import main
from tests.helpers.importing import brought
from tests.helpers.laboratory import Laboratory, measure

pytestmark = pytest.mark.deep


@pytest.fixture(scope="module")
def runs(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Loads on the MFC side and nine added masses, of which 70 % act."""
    folder = tmp_path_factory.mktemp("paper")
    loading, _, masses, *_ = measure(Laboratory(mass_fraction=7.73 / 11), 3, small=True).runs
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
    assert main(["identify", *runs, "--json"]) == 0
    plain = answer(capsys)
    assert plain["adequate"] is False
    assert plain["causes"]["cause"][0] == "mass_fraction"
    assert "most likely because the masses put in the cylinder act as 7" in plain["adequacy"]
    assert main(["identify", *runs]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "the fit with it: identify --also mass_fraction" in shown
    assert main(["identify", *runs, "--also", "mass_fraction", "--json"]) == 0
    better = answer(capsys)
    assert better["adequate"] is True, better["adequacy"]
    table = better["parameters"]
    found = {n: (v, e) for n, v, e in zip(table["name"], table["value"], table["standard_error"], strict=True)}
    assert abs(found["mass_fraction"][0] - 7.73 / 11) < 2.5 * found["mass_fraction"][1]
    assert abs(found["k2"][0] - 7e-3) < 2.5 * found["k2"][1]
    assert 1.96 * found["k2"][1] < 0.15 * 7e-3  # with ruler and caliper


def test_proposed_nonidealities_are_added_in_turn_and_none_is_accepted(
    runs: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", *runs, "--stepwise", "--json"]) == 0
    found = answer(capsys)
    assert found["adequate"] is True, found["adequacy"]
    steps = found["steps"]
    assert steps["added"] == ["", "mass_fraction"]
    assert steps["chi_square"][1] < steps["chi_square"][0] / 2
    assert found["proposed"] == ["mass_fraction"]
    assert "mass_fraction" in found["parameters"]["name"]
    assert main(["identify", *runs, "--stepwise", "--accept", "--by", "me"]) == 2
    assert "--stepwise only proposes" in capsys.readouterr().err
    assert main(["identify", *runs, "--stepwise", "--method", "chain"]) == 2
    assert "--stepwise is for the joint fit" in capsys.readouterr().err


def test_nonidealities_are_for_the_joint_fit(runs: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", *runs, "--method", "chain", "--also", "mass_fraction"]) == 2
    assert "are for the joint fit" in capsys.readouterr().err
    assert main(["identify", *runs, "--also", "mass_share"]) == 2
    assert "mass_share is not an identifiable parameter" in capsys.readouterr().err
