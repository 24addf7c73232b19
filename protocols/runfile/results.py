"""Results that a run file has at its end: verdict and estimates, with its checksums."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

import h5py

from protocols.base import EstimatedQuantity, RunStatus, Verdict
from protocols.runfile.checksums import changed_names, compute_digests, store_checksums, stored_digests
from protocols.runfile.creation import create_group
from protocols.runfile.errors import StorageError, translate_write_errors
from protocols.runfile.open import RunReadError
from protocols.runfile.reader import Run
from protocols.runfile.record import RunRecord
from protocols.runfile.sidecar import NotesError, store_listed
from protocols.runfile.transaction import transaction


@contextmanager
def append_results(path: Path, new: bool = False) -> Iterator[h5py.File]:
    """Open a run that has ended, for its results; afterwards its checksums are computed, and lists find its record in the sidecar.

    All changes are applied together at the end; a kill or an error leaves all or none of them.

    Args:
        path: the run file.
        new: whether the run has just ended, so that it has no checksums yet.

    Raises:
        StorageError: the file cannot be written, or it is damaged: new checksums would hide that.
    """
    record: RunRecord | None = None
    with translate_write_errors("run", path), transaction(path) as changed:
        with h5py.File(changed, "r+", libver="latest") as file:
            stored = stored_digests(file)
            if stored is not None and (different := changed_names(stored, compute_digests(file))):
                raise StorageError(
                    f"nothing is added to {path}: its contents differ from its checksums ({', '.join(different[:3])}); take "
                    "another copy of it"
                )
            yield file
            if new or stored is not None:
                store_checksums(file)
        with suppress(RunReadError), h5py.File(changed, "r") as file, Run(path, file) as run:
            record = run.stored_record()
    with suppress(NotesError, OSError, ValueError, TypeError, LookupError):  # lists read a run without it from its data
        if record is not None and record.status is not RunStatus.RUNNING:
            store_listed(path, record)


def store_verdict(file: h5py.File, verdict: Verdict) -> None:
    """Store the verdict in the place of an earlier one."""
    entry = file["entry"]
    for name, value in (("verdict", str(verdict.outcome)), ("verdict_details", verdict.to_json())):
        if name in entry:
            del entry[name]
        entry.create_dataset(name, data=value)


def append_estimates(file: h5py.File, estimates: Sequence[EstimatedQuantity]) -> None:
    """Append identified quantities; the group lists them in this order, the most important first."""
    if not estimates:
        return
    found = file["entry"].create_group("estimates", track_order=True)
    found.attrs["NX_class"] = "NXcollection"
    for estimate in estimates:
        one = create_group(found, estimate.name.replace(" ", "_"), "NXcollection")
        for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
            one.create_dataset(name, data=value).attrs["units"] = estimate.unit
        one["source"] = estimate.source
