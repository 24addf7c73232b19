"""Mass put in the cylinder before the measurements at one mass: the specimen's own, so that the paper's 7.73 g move with the centre."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from app.identification import CalibrationError, SheetError, load_sheet, read_calibrations
from protocols import FIX_PAPER_MASS
from protocols.base import MOUNTED, Prompt

MASS_PUT_IN = "mass_put_in"
MASS_SHARE = "mass_fraction"
PAPER_MASS_KG = FIX_PAPER_MASS.values["mass_kg"]


def with_specimen_mass(prompts: Iterable[Prompt], folder: Path, specimen: str) -> tuple[Prompt, ...]:
    """Return setup prompts in which the prompt for the paper's mass names the mass of this specimen.

    The mass is taken from the specimen sheet. Without one, it is 7.73 g divided by the moving share of the active calibration.
    Without both, the prompts are unchanged.
    """
    return tuple(_adapted(prompts, folder, specimen))


def _adapted(prompts: Iterable[Prompt], folder: Path, specimen: str) -> Iterator[Prompt]:
    for prompt in prompts:
        if prompt.action != FIX_PAPER_MASS.action or prompt.values.get("mass_kg") != PAPER_MASS_KG:
            yield prompt
        elif (mass := _mass_of(folder, specimen)) is None:
            yield FIX_PAPER_MASS  # also of a campaign of an earlier version
        else:
            yield replace(FIX_PAPER_MASS, text=mass[1], values={"mass_kg": mass[0], MOUNTED: 1.0})


def _mass_of(folder: Path, specimen: str) -> tuple[float, str] | None:
    """Return the mass to put in, and the text of its prompt; None where neither sheet nor calibration has it."""
    try:
        entry = load_sheet(folder, specimen).entries.get(MASS_PUT_IN)
        if entry is not None and entry.value > 0:
            return entry.value, f"Fix the mass of {1e3 * entry.value:.4g} g in the cylinder (the specimen's sheet)."
        estimates = read_calibrations(folder, specimen).get().estimates
    except (SheetError, CalibrationError):
        return None
    share = next((each.value for each in estimates if each.name == MASS_SHARE), 0.0)
    if share <= 0:
        return None
    put_in_kg = round(PAPER_MASS_KG / share, 5)
    return put_in_kg, (
        f"Fix a mass of {1e3 * put_in_kg:.4g} g in the cylinder: by the calibration {100 * share:.0f} % of a mass moves with the centre, here "
        f"{1e3 * PAPER_MASS_KG:.4g} g (the paper's)."
    )
