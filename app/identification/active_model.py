"""What is believed of a specimen: its active calibration, the paper's values where it has none; and which of the two."""

from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from model.parameters import Membrane, Tactor

if TYPE_CHECKING:
    from model.studies.uncertainty import Estimates

Stamp = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Believed:
    """A tactor and the membrane for its skin, how well they are known, and who says so."""

    tactor: Tactor
    estimates: "Estimates | None"
    """Those of the tactor's parameters that were identified; None where nothing has an error."""
    words: str
    trouble: str = ""
    """Why it is not what one expects: a calibration that cannot be read."""
    stamp: tuple[Path, Stamp] | None = None
    """File and version that was read; None where there is none."""
    membrane: Membrane = field(default_factory=Membrane)
    on_membrane: "Estimates | None" = None
    """Those of tactor and membrane; None where nothing has an error."""
    damping: tuple[tuple[float, float], ...] = ()
    """Elongation (m) and damping (kg/(m s)) where the skin's damping was identified for one elongation by itself."""


PAPER = Believed(Tactor(), None, "the paper's values")


def believed(folder: Path | None, specimen: str, before: Believed = PAPER) -> Believed:
    """What is believed of a specimen whose calibrations are kept in `folder`; `before` while its file is the same.

    It never raises: what cannot be read is told in `trouble`, and the paper's values stand in.
    """
    if folder is None or not specimen:
        return PAPER
    from app.identification import calibrations  # the model's numerics, for which no window waits
    from app.identification.calibrations import CalibrationError
    from model.identification.parameters import elongation_of
    from model.parameter_spec import ParameterError

    path = calibrations.calibrations_path(folder, specimen)
    try:
        file = path.stat()
    except OSError:
        return PAPER
    stamp = (path, (file.st_mtime_ns, file.st_size, file.st_ino))
    if before.stamp == stamp:
        return before
    try:
        known = calibrations.read(folder, specimen)
        if not known.active:
            return Believed(PAPER.tactor, None, f"{PAPER.words}: no calibration of {specimen} is active", "", stamp)
        active = known.get()
        estimates = active.for_bands()
        told, both = _some(estimates, Tactor), _some(estimates, Tactor, Membrane)
        alone = ((elongation_of(e.name), e.value) for e in active.estimates if e.name.startswith("c_s("))
        damping = tuple((at, value) for at, value in alone if at is not None)
        simulated = ", SIMULATED" if active.simulated else ""
        words = f"calibration {active.version} of {active.specimen}{simulated}"
        trouble = "" if told else "nothing of it has an error"
        return Believed(active.tactor(), told, words, trouble, stamp, active.membrane(), both, damping)
    except (CalibrationError, ParameterError) as error:
        return Believed(PAPER.tactor, None, PAPER.words, str(error), stamp)


def _some(estimates: "Estimates", *of: type) -> "Estimates | None":
    """The estimates of the fields of some parameters; None where there are none."""
    from model.studies.uncertainty import Estimates

    known = {each.name for kind in of for each in fields(kind)}
    at = [i for i, name in enumerate(estimates.names) if name in known]
    if not at:
        return None
    names, values = tuple(estimates.names[i] for i in at), tuple(estimates.values[i] for i in at)
    return Estimates(names, values, estimates.covariance[np.ix_(at, at)])
