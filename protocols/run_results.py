"""What is found in a run after it was measured, appended to its finished file; raw data is not touched."""

from collections.abc import Sequence
from pathlib import Path

import h5py

from protocols.fresh_run import group
from protocols.storing import Storing
from protocols.values import Curve, Estimate


def append_curves(path: Path, curves: Sequence[Curve], locking: bool = True) -> None:
    """Append curves to a finished run, each a group that a NeXus viewer draws.

    Raises:
        StoreError: the file cannot be written.
    """
    if not curves:
        return
    with Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        every = group(file["entry"], "curves", "NXcollection")
        for curve in curves:
            found = group(every, f"{curve.name}_{len(every):03d}", "NXdata", signal=curve.y, axes=[curve.x])
            found["title"] = f"{curve.name} {curve.label}".strip()
            found.attrs.update({"name": curve.name, "label": curve.label, "entry": curve.entry})
            for name, column in curve.columns.items():
                found.create_dataset(name, data=column.values).attrs.update(
                    {"units": column.unit, "long_name": f"{column.words} ({column.unit})"}
                )


def append_estimates(path: Path, estimates: Sequence[Estimate], locking: bool = True) -> None:
    """Append identified quantities to a finished run.

    Raises:
        StoreError: the file cannot be written.
    """
    if not estimates:
        return
    with Storing(path), h5py.File(path, "r+", libver="latest", locking=locking) as file:
        found = group(file["entry"], "estimates", "NXcollection")
        for estimate in estimates:
            one = group(found, estimate.name.replace(" ", "_"), "NXcollection")
            for name, value in (("value", estimate.value), ("standard_error", estimate.standard_error)):
                one.create_dataset(name, data=value).attrs["units"] = estimate.unit
            one["source"] = estimate.source
