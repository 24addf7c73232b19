"""Verdict on a run file from its points: for runs of earlier versions, imported runs, and to check a stored verdict."""

from collections.abc import Sequence
from datetime import UTC, datetime
from operator import itemgetter
from pathlib import Path
from typing import Any

from protocols.base import (
    EstimatedQuantity,
    Outcome,
    Protocol,
    ReferenceModel,
    RunStatus,
    Verdict,
    extend_plan,
    file_hash,
    judge_ended,
)
from protocols.resume import measured_points, protocol_of_run
from protocols.runfile import (
    MAX_TEXT_BYTES,
    LaterVerdict,
    Run,
    RunReadError,
    StorageError,
    append_estimates,
    append_results,
    change_notes,
    store_verdict,
    translate_read_errors,
    truncate_utf8,
)

CRASHED = "its program has ended without closing it"


def judge_file(path: Path, reference: ReferenceModel | None = None, store: bool = False) -> Verdict:
    """Return the verdict on a run file by its points and the checks of this version.

    Args:
        path: the run file.
        reference: model of the free specimen; default: the model stored in the run, or else the paper's tactor.
        store: whether to store the verdict in the run's sidecar, in place of an earlier one; the run file is not touched.

    Raises:
        RunReadError: it is not a run, is still being written, or is of an unknown protocol.
        NotesError: the verdict cannot be written.
        OSError: the run file cannot be read.
    """
    with Run(path) as run, translate_read_errors(path):
        verdict = _judge(run, reference)
    if store:
        now = datetime.now(UTC).isoformat(timespec="seconds")
        change_notes(path, later_verdict=LaterVerdict(verdict, now, file_hash(path)))
    return verdict


def complete_results(path: Path) -> str:
    """Store estimates and verdict of a run that ended without them, from its points; return a sentence about the result.

    Curves are not computed again.
    """
    try:
        with Run(path) as run, translate_read_errors(path):
            protocol, measured = _read_points(run)
            estimates = protocol.estimates(list(measured.values()))
            verdict = _judge_points(run, protocol, measured, None, estimates)
            reason = f"{run.record.reason}; they were computed from its points afterwards"
        with append_results(path) as file:
            file["entry/reason"][()] = truncate_utf8(reason, MAX_TEXT_BYTES)
            store_verdict(file, verdict)
            append_estimates(file, estimates)
    except (RunReadError, StorageError, ValueError) as error:
        return f"They cannot be computed from its points: {error}"
    return f"They are computed from its points now: {len(estimates)} estimates, {verdict.outcome}"


def _judge(run: Run, reference: ReferenceModel | None) -> Verdict:
    if run.record.status is RunStatus.RUNNING:
        if not run.record.crashed:
            raise RunReadError(f"{run.path} is still being written; stop that run first")
        return Verdict(Outcome.FAILED, (CRASHED,))
    return _judge_points(run, *_read_points(run), reference)


def _read_points(run: Run) -> tuple[Protocol, dict[int, Any]]:
    """Return the protocol of a run and its valid points by entry, in the order of the plan."""
    protocol = protocol_of_run(run, str(run.path))
    return protocol, dict(sorted(measured_points(run, protocol.point_type), key=itemgetter(0)))


def _judge_points(
    run: Run,
    protocol: Protocol,
    measured: dict[int, Any],
    reference: ReferenceModel | None,
    estimates: Sequence[EstimatedQuantity] | None = None,
) -> Verdict:
    amplifier = run.record.amplifier_map
    planned = len(measured)
    if not run.record.imported:  # a table has no plan
        planned = len(extend_plan(protocol, protocol.plan(amplifier.rest_v), measured, amplifier.rest_v))
    reference_model = reference or run.record.reference_model or ReferenceModel(amplifier=amplifier)
    return judge_ended(
        run.record.status, run.record.reason, protocol, list(measured.values()), planned, reference_model, estimates
    )
