"""Stated uncertainties of imported tables: each is stored and enters the fit, or is refused by name; duplicates."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.identification.observations import read_observations
from app.identification.specimen_identification import identify
from tests.helpers.importing import FULL, brought, points, refused
from tests.helpers.messages import assert_names

RESONANCE = "mass [g],natural frequency [Hz],sigma [Hz]\n" + "".join(
    f"{1.75 + i},{f},0.1\n" for i, f in enumerate((300.9, 250.9, 219.7, 197.8, 181.4, 168.5, 158.0, 149.2, 141.8))
)
STATIC = "weight (g),deflection (um),u_deflection (um),side,repeat\n" + "".join(
    f"{m},{1.3523 * m + 0.05 * (-1) ** i:.4f},0.1,{side},{i}\n"
    for m in (20, 50, 100, 200, 500)
    for side in (1, -1)
    for i in range(5)
)
STEPS = "level [V],deflection [um],u_deflection [um],repeat\n" + "".join(
    f"{u},{w + 0.1 * (-1) ** i:.4f},0.2,{i}\n"
    for u, w in ((0.5, -95.15), (1.5, -47.58), (4.0, 214.1))
    for i in range(5)
)
DWELL = "frequency [Hz],fundamental [um],u_fundamental [um]\n" + "".join(
    f"{f},{w},0.5\n"
    for f, w in ((75, 297.1), (100, 362.3), (125, 473.5), (150, 577.0), (175, 461.1), (200, 298.0), (250, 145.8))
)
CASES = {
    "mass of a resonance": (RESONANCE, "mass=0.2 g", "k2", "mass_errors", 9),
    "weights": (STATIC, "mass=1 %", "k2", "load_errors", 5),
    "weights as loads": (STATIC, "load=1 %", "k2", "load_errors", 5),
    "levels": (STEPS, "level=50 mV", "mu", "level_errors", 3),
    "frequencies": (DWELL, "frequency=5 Hz", "m_add", "frequency_errors", 7),
}


def imported(tmp_path: Path, text: str, *arguments: str) -> Path:
    (tmp_path / "t.csv").write_text(text)
    return brought(tmp_path / "t.csv", *arguments, *(FULL if text == DWELL else ()))


@pytest.mark.one_in(5)
@pytest.mark.parametrize("case", CASES)
def test_a_stated_uncertainty_of_an_input_is_stored_and_enters_the_fit(case: str, tmp_path: Path) -> None:
    text, stated, parameter, column, different = CASES[case]
    without = imported(tmp_path, text)
    path = imported(tmp_path, text, "--uncertainty", stated)
    assert (points(path)[column] > 0).all()
    found = [
        {e.name: e for e in identify([each], sheet="none").estimates}[parameter].standard_error
        for each in (without, path)
    ]
    assert found[1] > 1.5 * found[0]
    _, campaign, _ = read_observations([path])
    assert len(campaign.shared_errors) == different  # one for each mass, weight or level, not for each row
    (tmp_path / "export").mkdir()
    assert main(["export", str(path), "--format", "csv", "--out", str(tmp_path / "export")]) == 0
    (table,) = (tmp_path / "export").glob("*points.csv")
    np.testing.assert_allclose(points(brought(table))[column], points(path)[column])


@pytest.mark.deep
def test_the_uncertainty_of_an_elongation_is_stored_and_is_an_error_of_the_fit(tmp_path: Path) -> None:
    on = ("--membrane-elongation", "1.27 mm", "--uncertainty", "elongation=0.1 mm")
    path = imported(tmp_path, DWELL, *on)
    np.testing.assert_allclose(points(path)["elongation_errors"], 1e-4)
    _, campaign, _ = read_observations([path])
    (error,) = campaign.shared_errors.values()
    assert (error.acts_on, error.standard_error, error.at) == ("elongation", 1e-4, 1.27e-3)


@pytest.mark.parametrize(
    ("text", "stated", "says"),
    [
        (STATIC, "side=1", "no fit takes the uncertainty of side into account"),
        (DWELL, "drive_amplitude=1 %", "no fit takes the uncertainty of drive amplitude into account"),
        (STEPS, "read_time=1 s", "It can be given for: "),
        (STATIC, "elongation=1 mm", "elongation is not one of the values; there are: mass, deflection, load"),
    ],
)
def test_an_uncertainty_that_no_fit_uses_is_refused(
    text: str, stated: str, says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.csv").write_text(text)
    more = FULL if text == DWELL else []
    assert says in refused(tmp_path / "t.csv", capsys, "--uncertainty", stated, *more)


@pytest.mark.deep
def test_too_many_different_inputs_with_an_uncertainty_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rows = "".join(f"{20 + 0.5 * i},{i + 300}.5,1\n" for i in range(120))
    path = imported(
        tmp_path,
        "frequency [Hz],fundamental [um],u_fundamental [um]\n" + rows,
        *FULL,
        "--uncertainty",
        "frequency=1 Hz",
    )
    assert main(["identify", str(path)]) == 2
    assert "frequency has 120 different values with a separate uncertainty, the limit is 100" in capsys.readouterr().err


@pytest.mark.deep
def test_a_table_imported_several_times_is_counted_once(tmp_path: Path) -> None:
    first = imported(tmp_path, RESONANCE)
    others = [imported(tmp_path, RESONANCE, "--uncertainty", f"mass={each} g") for each in (0.1, 0.2)]
    _, campaign, notes = read_observations([first, *others])
    assert len(campaign.runs) == 1
    for note, other in zip(notes, others, strict=True):
        assert_names(note, other.name, first.name, 9)


@pytest.mark.deep
def test_a_copied_run_is_counted_once(tmp_path: Path) -> None:
    first = imported(tmp_path, DWELL)
    copy = Path(shutil.copy(first, tmp_path / "copy.h5"))
    once, twice = ({e.name: e for e in identify(paths).estimates}["mu"] for paths in ([first], [first, copy]))
    assert twice.standard_error == once.standard_error
