"""Model parameters of a specimen: its active calibration, or the paper's values if it has none."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.identification import calibrations
from model import NONIDEAL_NAMES, Membrane, ParameterError, Specimen, Tactor, replace_variables
from protocols.base import ReferenceModel
from protocols.runfile.names import sheet_path

if TYPE_CHECKING:
    from model.studies.uncertainty import EstimateSet

FileStamp = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class ActiveModel:
    """Tactor and membrane parameters with their uncertainty and their source."""

    tactor: Tactor
    estimates: "EstimateSet | None"
    """Identified parameters of the tactor; None if none has a standard error."""
    description: str
    problem: str = ""
    """Why the calibration is not used: it cannot be read."""
    stamp: tuple[Path, FileStamp] | None = None
    """File and version that was read; None without a file."""
    membrane: Membrane = field(default_factory=Membrane)
    membrane_estimates: "EstimateSet | None" = None
    """Identified parameters of tactor and membrane; None if none has a standard error."""
    damping_by_elongation: tuple[tuple[float, float], ...] = ()
    """Elongation (m) and skin damping (kg/(m s)) where it was identified for single elongations."""
    nonideal: Mapping[str, float] = field(default_factory=dict)
    """Hysteresis, creep and flexibility of the clamp, where they were identified."""

    def specimen(self, elongation_m: float | None = None) -> Specimen:
        """Return the specimen, free or on its membrane at an elongation (m).

        Raises:
            ParameterError: a value is not physical there.
        """
        if elongation_m is None:
            return replace_variables(Specimen(self.tactor), self.nonideal)
        alone = next((c_s for at, c_s in self.damping_by_elongation if same_elongation(at, elongation_m)), None)
        stretch = elongation_m / self.membrane.L_m
        return replace_variables(Specimen(self.tactor, self.membrane, stretch, c_s=alone), self.nonideal)


PAPER_MODEL = ActiveModel(Tactor(), None, "the paper's values")


def load_active_model(folder: Path | None, specimen: str, previous: ActiveModel = PAPER_MODEL) -> ActiveModel:
    """Load the active model of a specimen from the calibrations in `folder`; `previous` if its file is unchanged.

    Does not raise: if the file cannot be read, the paper's values are returned with `problem` set.
    """
    if folder is None or not specimen:
        return PAPER_MODEL
    path = calibrations.calibrations_path(folder, specimen)
    try:
        file = path.stat()
    except OSError:
        return _uncalibrated_model(folder, specimen)
    stamp = (path, (file.st_mtime_ns, file.st_size, file.st_ino))
    if previous.stamp == stamp:
        return previous
    from model.identification import parse_elongation  # slow to load

    try:
        known = calibrations.read_calibrations(folder, specimen)
        if not known.active:
            base = _uncalibrated_model(folder, specimen)
            return replace(base, description=f"{base.description}: no calibration of {specimen} is active", stamp=stamp)
        active = known.get()
        estimates = active.estimate_set()
        of_tactor, both = _select_estimates(estimates, Tactor), _select_estimates(estimates, Tactor, Membrane)
        alone = ((parse_elongation(e.name), e.value) for e in active.estimates if e.name.startswith("c_s("))
        damping = tuple((at, value) for at, value in alone if at is not None)
        simulated = ", SIMULATED" if active.simulated else ""
        words = f"calibration {active.version} of {active.specimen}{simulated}"
        if active.doubt:
            words = f"{words} (accepted although {active.doubt.partition(':')[0]})"
        trouble = "" if of_tactor else "nothing of it has an error"
        nonideal = {e.name: e.value for e in active.estimates if e.name in NONIDEAL_NAMES}
        return ActiveModel(
            active.tactor(), of_tactor, words, trouble, stamp, active.membrane(), both, damping, nonideal
        )
    except (calibrations.CalibrationError, ParameterError) as error:
        return ActiveModel(PAPER_MODEL.tactor, None, PAPER_MODEL.description, str(error), stamp)


def _uncalibrated_model(folder: Path, specimen: str) -> ActiveModel:
    """Return the paper's values, with the dimensions of the specimen sheet if there is one."""
    path = sheet_path(folder, specimen)
    if not path.exists():
        return PAPER_MODEL
    from app.identification.sheet_file import SheetError, load_sheet

    try:
        sheet, file = load_sheet(folder, specimen), path.stat()
    except (SheetError, OSError) as error:
        return replace(PAPER_MODEL, problem=str(error))
    words = f"{PAPER_MODEL.description} with the dimensions of {path.name}"
    stamp = (path, (file.st_mtime_ns, file.st_size, file.st_ino))
    return ActiveModel(sheet.tactor, None, words, "", stamp, sheet.membrane)


def reference_model(folder: Path, specimen: str) -> ReferenceModel | None:
    """Return the model of a calibrated specimen that results are compared with; None without an active calibration."""
    active = load_active_model(folder, specimen)
    if active.estimates is None or active.problem:
        return None
    return ReferenceModel(active.tactor, source=active.description, calibrated=True)


def _select_estimates(estimates: "EstimateSet", *kinds: type) -> "EstimateSet | None":
    """Return the estimates of the fields of some parameter classes; None if there are none."""
    from model.studies.uncertainty import EstimateSet

    known = {each.name for kind in kinds for each in fields(kind)} | set(NONIDEAL_NAMES)
    at = [i for i, name in enumerate(estimates.names) if name in known]
    if not at:
        return None
    names, values = tuple(estimates.names[i] for i in at), tuple(estimates.values[i] for i in at)
    return EstimateSet(names, values, estimates.covariance[np.ix_(at, at)])


def same_elongation(one_m: float, other_m: float) -> bool:
    """Return whether two elongations (m) are one that was set twice."""
    return math.isclose(one_m, other_m, rel_tol=1e-5, abs_tol=1e-8)
