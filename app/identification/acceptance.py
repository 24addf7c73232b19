"""Acceptance of an identification as the active calibration: inadequate or untested results need a written reason."""

from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from app.identification.calibrations import CalibrationError, Calibrations, read_calibrations, write_calibrations
from app.identification.specimen_identification import IdentificationResult
from drivers.watchdog import version
from model.identification import Calibration

if TYPE_CHECKING:
    from app.identification.recalibration import Correction

MIN_REASON_LENGTH = 10
"""Letters and digits of a reason."""


class AcceptanceError(CalibrationError):
    """The identification cannot be accepted like this; the message gives reason and remedy."""


def doubt_about(identification: IdentificationResult) -> str:
    """Return the reason why the acceptance needs a decision; empty for a result with a tested and adequate model.

    A cause added because of the data is a proposal, which needs agreement.
    """
    adequacy = identification.adequacy
    if adequacy is None:
        return f"unchecked: no test of the model is made by the method '{identification.method}'"
    if adequacy.adequate is None:
        return f"unchecked: {adequacy.message}"
    if not adequacy.adequate:
        return f"NOT ADEQUATE: {adequacy.message}"
    if identification.steps:
        names = ", ".join(step.name for step in identification.steps)
        return f"adequate only with {names}, which the test of the model proposes: identify --also agrees to it"
    return ""


def is_reason(text: str) -> bool:
    """Return whether a text is long enough to be a reason."""
    return sum(map(str.isalnum, text)) >= MIN_REASON_LENGTH


def accept_identification(
    identification: IdentificationResult,
    folder: Path,
    runs: Sequence[Path],
    by: str = "",
    note: str = "",
    reason: str = "",
    correction: "Correction | None" = None,
) -> tuple[Calibration, Path]:
    """Store an identification as the next version of the specimen's calibration, now active, and return it with its file.

    Args:
        identification: accepted identification.
        folder: folder of the calibrations.
        runs: its run files.
        by: name of the person who accepts it.
        note: a remark.
        reason: reason for accepting an inadequate or untested result.
        correction: bench file of a repeated reduction of the raw samples.

    Raises:
        AcceptanceError: nothing was identified, or a reason is needed.
        CalibrationError: the file cannot be read or written.
    """
    if not identification.identified:
        raise AcceptanceError(
            f"nothing is accepted: these runs identify no parameter of {identification.specimen}; add runs, "
            "or fix parameters with --fix. Without --accept the command names what to measure next"
        )
    doubt, reason = doubt_about(identification), reason.strip()
    if doubt and not is_reason(reason):
        raise AcceptanceError(
            f"nothing is accepted: the result is {doubt}. Find the cause; or write why it is to be used all the same (--reason TEXT), "
            f"with at least {MIN_REASON_LENGTH} letters: the reason is kept with the calibration and printed with it"
        )
    calibrations = read_calibrations(folder, identification.specimen)
    number = max((each.version for each in calibrations.versions), default=0) + 1
    accepted = Calibration(
        specimen=identification.specimen,
        version=number,
        estimates=identification.estimates,
        covariance=tuple(tuple(row) for row in np.asarray(identification.covariance).tolist()),
        method=identification.method,
        runs=tuple(path.name for path in runs),
        code=version(),
        accepted_at=datetime.now(UTC).isoformat(timespec="seconds"),
        accepted_by=by,
        simulated=identification.observations.simulated,
        fixed=dict(identification.fixed),
        note=note,
        reduced=correction.as_record() if correction else {},
        doubt=doubt,
        reason=reason if doubt else "",
        known=dict(identification.priors),
        statistical=dict(identification.statistical_errors),
        dimensions="" if identification.sheet is None else identification.sheet.description,
    )
    path = write_calibrations(folder, identification.specimen, Calibrations((*calibrations.versions, accepted), number))
    return accepted, path
