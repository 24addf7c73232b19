"""Verdict on a run file from its points: for runs of earlier versions, imported runs, and to check a stored verdict."""

from pathlib import Path

from protocols.base import Outcome, ReferenceModel, RunStatus, Verdict, extend_plan, judge_ended
from protocols.resume import measured_points, protocol_of_run
from protocols.runfile.reader import Run, RunReadError, translate_read_errors
from protocols.runfile.results import append_results, store_verdict

CRASHED = "the program that wrote it is gone"


def judge_file(path: Path, reference: ReferenceModel | None = None, store: bool = False) -> Verdict:
    """Return the verdict on a run file by its points and the checks of this version.

    Args:
        path: the run file.
        reference: model of the free specimen; default is the one stored in the run, or else the paper's tactor.
        store: whether to write the verdict into the file, in place of an earlier one; the format version stays.

    Raises:
        RunReadError: it is no run, is still being written, or is of a protocol that is not known here.
        StorageError: the verdict cannot be written.
    """
    with Run(path) as run, translate_read_errors(path):
        verdict = _judge(run, reference)
    if store:
        with append_results(path) as file:
            store_verdict(file, verdict)
    return verdict


def _judge(run: Run, reference: ReferenceModel | None) -> Verdict:
    if run.status is RunStatus.RUNNING:
        if not run.crashed:
            raise RunReadError(f"{run.path} is still being written; stop that run first")
        return Verdict(Outcome.FAILED, (CRASHED,))
    protocol = protocol_of_run(run, str(run.path))
    amplifier = run.amplifier_map
    measured = dict(measured_points(run, protocol.point_type))
    points = [measured[entry] for entry in sorted(measured)]
    planned = len(points)
    if not run.imported:  # a table has no plan
        planned = len(extend_plan(protocol, protocol.plan(amplifier.rest_v), measured, amplifier.rest_v))
    known = reference or run.reference or ReferenceModel(amplifier=amplifier)
    return judge_ended(run.status, run.reason, protocol, points, planned, known)
