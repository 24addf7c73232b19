"""Model parameters of a specimen: its active calibration, or the paper's values if it has none."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Self

import numpy as np
from numpy.typing import ArrayLike

from app.identification import calibrations
from model import EstimatedQuantity, Membrane, ParameterError, Tactor
from protocols.base import ReferenceModel
from protocols.runfile import sheet_path

if TYPE_CHECKING:
    from model import Specimen
    from model.studies import EstimateSet

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

    def specimen(self, elongation_m: float | None = None) -> "Specimen":
        """Return the specimen, free or on its membrane at an elongation (m).

        Raises:
            ParameterError: a value is not physical there.
        """
        from model import Specimen, replace_variables  # a run needs them not

        if elongation_m is None:
            return replace_variables(Specimen(self.tactor), self.nonideal)
        stretch, c_s = elongation_m / self.membrane.L_m, self.skin_damping(elongation_m)
        return replace_variables(Specimen(self.tactor, self.membrane, stretch, c_s=c_s), self.nonideal)

    def skin_damping(self, elongation_m: float) -> float | None:
        """Return the skin's damping (kg/(m s)) that was identified at one elongation alone; None where it was not."""
        return next((c_s for at, c_s in self.damping_by_elongation if same_elongation(at, elongation_m)), None)

    def estimates_for(self, specimen: "Specimen") -> "EstimateSet | None":
        """Return the estimates that a specimen depends on: the tactor's, and the membrane's if it is on one."""
        return self.estimates if specimen.membrane is None else self.membrane_estimates

    @classmethod
    def from_estimates(
        cls,
        tactor: Tactor,
        membrane: Membrane,
        estimates: Sequence[EstimatedQuantity],
        covariance: ArrayLike,
        description: str = "",
    ) -> Self:
        """Return the model of estimates with their covariance, (P, P), in their order."""
        from model import NONIDEAL_NAMES
        from model.identification import parse_elongation  # slow to load
        from model.studies import EstimateSet

        def select(*kinds: type) -> EstimateSet | None:
            names = {each.name for kind in kinds for each in fields(kind)} | set(NONIDEAL_NAMES)
            at = [i for i, each in enumerate(estimates) if each.name in names]
            if not at:
                return None
            kept, part = [estimates[i] for i in at], np.asarray(covariance, float)[np.ix_(at, at)]
            return EstimateSet(tuple(each.name for each in kept), tuple(each.value for each in kept), part)

        alone = ((parse_elongation(e.name), e.value) for e in estimates if e.name.startswith("c_s("))
        return cls(
            tactor,
            select(Tactor),
            description,
            membrane=membrane,
            membrane_estimates=select(Tactor, Membrane),
            damping_by_elongation=tuple((at, value) for at, value in alone if at is not None),
            nonideal={e.name: e.value for e in estimates if e.name in NONIDEAL_NAMES},
        )


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
    try:
        stored = calibrations.read_calibrations(folder, specimen)
        if not stored.active:
            base = _uncalibrated_model(folder, specimen)
            return replace(base, description=f"{base.description}: no calibration of {specimen} is active", stamp=stamp)
        active = stored.get()
        description = f"calibration {active.version} of {active.specimen}{', SIMULATED' if active.simulated else ''}"
        if active.doubt:
            description = f"{description} (accepted although {active.doubt.partition(':')[0]})"
        model = ActiveModel.from_estimates(
            active.tactor(), active.membrane(), active.estimates, active.covariance, description
        )
        return replace(model, problem="" if model.estimates else "none of its parameters has an error", stamp=stamp)
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
    description = f"{PAPER_MODEL.description} with the dimensions of {path.name}"
    stamp = (path, (file.st_mtime_ns, file.st_size, file.st_ino))
    return ActiveModel(sheet.tactor, None, description, "", stamp, sheet.membrane)


def reference_model(folder: Path, specimen: str) -> ReferenceModel | None:
    """Return the model of a calibrated specimen that results are compared with; None without an active calibration."""
    if not calibrations.calibrations_path(folder, specimen).exists():  # without reading the specimen sheet
        return None
    active = load_active_model(folder, specimen)
    if active.estimates is None or active.problem:
        return None
    return ReferenceModel(active.tactor, source=active.description, calibrated=True)


def same_elongation(one_m: float, other_m: float) -> bool:
    """Return whether two elongations (m) are equal settings."""
    return math.isclose(one_m, other_m, rel_tol=1e-5, abs_tol=1e-8)
