"""What is believed of a specimen: its active calibration, the paper's values where it has none; and which of the two."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from model.parameters import Membrane, Tactor

if TYPE_CHECKING:
    from model.studies.uncertainty import EstimateSet

FileStamp = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class ActiveModel:
    """A tactor and the membrane for its skin, how well they are known, and who says so."""

    tactor: Tactor
    estimates: "EstimateSet | None"
    """Those of the tactor's parameters that were identified; None where nothing has an error."""
    description: str
    problem: str = ""
    """Why it is not what one expects: a calibration that cannot be read."""
    stamp: tuple[Path, FileStamp] | None = None
    """File and version that was read; None where there is none."""
    membrane: Membrane = field(default_factory=Membrane)
    membrane_estimates: "EstimateSet | None" = None
    """Those of tactor and membrane; None where nothing has an error."""
    damping_by_elongation: tuple[tuple[float, float], ...] = ()
    """Elongation (m) and damping (kg/(m s)) where the skin's damping was identified for one elongation by itself."""


PAPER_MODEL = ActiveModel(Tactor(), None, "the paper's values")


def load_active_model(folder: Path | None, specimen: str, previous: ActiveModel = PAPER_MODEL) -> ActiveModel:
    """What is believed of a specimen whose calibrations are kept in `folder`; `before` while its file is the same.

    It never raises: what cannot be read is told in `problem`, and the paper's values stand in.
    """
    if folder is None or not specimen:
        return PAPER_MODEL
    from app.identification import calibrations  # the model's numerics, for which no window waits
    from app.identification.calibrations import CalibrationError
    from model.identification.parameters import parse_elongation
    from model.parameter_spec import ParameterError

    path = calibrations.calibrations_path(folder, specimen)
    try:
        file = path.stat()
    except OSError:
        return PAPER_MODEL
    stamp = (path, (file.st_mtime_ns, file.st_size, file.st_ino))
    if previous.stamp == stamp:
        return previous
    try:
        known = calibrations.read_calibrations(folder, specimen)
        if not known.active:
            return ActiveModel(
                PAPER_MODEL.tactor,
                None,
                f"{PAPER_MODEL.description}: no calibration of {specimen} is active",
                "",
                stamp,
            )
        active = known.get()
        estimates = active.estimate_set()
        told, both = _select_estimates(estimates, Tactor), _select_estimates(estimates, Tactor, Membrane)
        alone = ((parse_elongation(e.name), e.value) for e in active.estimates if e.name.startswith("c_s("))
        damping = tuple((at, value) for at, value in alone if at is not None)
        simulated = ", SIMULATED" if active.simulated else ""
        words = f"calibration {active.version} of {active.specimen}{simulated}"
        trouble = "" if told else "nothing of it has an error"
        return ActiveModel(active.tactor(), told, words, trouble, stamp, active.membrane(), both, damping)
    except (CalibrationError, ParameterError) as error:
        return ActiveModel(PAPER_MODEL.tactor, None, PAPER_MODEL.description, str(error), stamp)


def _select_estimates(estimates: "EstimateSet", *kinds: type) -> "EstimateSet | None":
    """The estimates of the fields of some parameters; None where there are none."""
    from model.studies.uncertainty import EstimateSet

    known = {each.name for kind in kinds for each in fields(kind)}
    at = [i for i, name in enumerate(estimates.names) if name in known]
    if not at:
        return None
    names, values = tuple(estimates.names[i] for i in at), tuple(estimates.values[i] for i in at)
    return EstimateSet(names, values, estimates.covariance[np.ix_(at, at)])
