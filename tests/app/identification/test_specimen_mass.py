"""Mass that a campaign asks for in the cylinder: that of the sheet, or by the calibrated share; what moves on the simulated bench."""

from pathlib import Path

import pytest

from app.campaign.specimen_mass import with_specimen_mass
from app.identification.calibrations import Calibrations, write_calibrations
from model import EstimatedQuantity
from model.identification import Calibration
from protocols.base import MOUNTED
from protocols.paper_campaign import FIX_PAPER_MASS, REMOVE_MEMBRANE
from sim_hardware.plant.parameters import Nonidealities, SimulationParameters
from sim_hardware.plant.setup_state import apply_action, initial_state

PARTLY = SimulationParameters(beyond=Nonidealities(mass_share=0.703))


def moving_kg(values: dict[str, float]) -> float:
    return apply_action(initial_state(PARTLY), "fix-mass", values, PARTLY).fixed_kg


def test_without_sheet_and_calibration_the_mass_that_moves_is_named(tmp_path: Path) -> None:
    found = with_specimen_mass((REMOVE_MEMBRANE, FIX_PAPER_MASS), tmp_path, "T1")
    assert found == (REMOVE_MEMBRANE, FIX_PAPER_MASS)
    assert moving_kg(dict(FIX_PAPER_MASS.values)) == 7.73e-3
    assert moving_kg({"mass_kg": 7.73e-3}) == pytest.approx(0.703 * 7.73e-3), "a mass that is named is what is put in"


def test_the_calibrated_share_gives_the_mass_to_put_in(tmp_path: Path) -> None:
    share = EstimatedQuantity("mass_fraction", 0.703, 0.01, "1", "runs")
    known = Calibration("T1", 1, (share,), ((1e-4,),), "m", (), "1", "2026-01-01", "", False, {})
    write_calibrations(tmp_path, "T1", Calibrations((known,), 1))
    (found,) = with_specimen_mass((FIX_PAPER_MASS,), tmp_path, "T1")
    assert "11 g" in found.text
    assert "70 %" in found.text
    assert moving_kg(dict(found.values)) == pytest.approx(7.73e-3, rel=1e-3)


def test_the_mass_of_the_sheet_comes_first(tmp_path: Path) -> None:
    sheet = (
        'specimen = "T1"\n[masses]\nmass_put_in = { value = "10.5 g", uncertainty = "0.01 g", instrument = "scale" }\n'
    )
    (tmp_path / "T1.specimen.toml").write_text(sheet)
    (found,) = with_specimen_mass((FIX_PAPER_MASS,), tmp_path, "T1")
    assert found.text == "Fix the mass of 10.5 g in the cylinder (the specimen's sheet)."
    assert found.values == {"mass_kg": pytest.approx(10.5e-3), MOUNTED: 1.0}
    assert found.hands_on
