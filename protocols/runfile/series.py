"""Series of a run file, written and read: NXdata groups with signal, axes and errors."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from model import COHERENCE, ERRORS, FIT, PHASE, TOTAL_ERRORS, USABLE
from protocols.base import Role, Series, SeriesAxis
from protocols.runfile.fields import attribute_integer, attribute_text, quantity_columns

if TYPE_CHECKING:
    import h5py

SERIES_GROUP = "curves"
"""Name of the group; files of every version have it."""
PASSES_GROUP, PASS, SETTING = "passes", "part", "elongation"
"""The plot of several passes over x, and the columns of the points with number and setting of a pass."""


def append_series(file: "h5py.File", series: Sequence[Series], default_plot: str = "", gain_error: float = 0.0) -> None:
    """Append series, each an NXdata group; a NeXus viewer shows the first one named `default_plot`.

    `gain_error` is the sensor gain's relative standard uncertainty, a part of total errors; 0 or NaN if unknown.
    """
    if not series:
        return
    from protocols.runfile.creation import create_group, free_name

    entry = file["entry"]
    every = create_group(entry, SERIES_GROUP, "NXcollection")
    for given in series:
        made = free_name(every, f"{given.name}_{len(every):03d}")
        group = create_group(every, made, "NXdata")
        group["title"] = given.title
        x, y = (free_name(group, axis.name) for axis in (given.x_axis, given.y_axis))
        y += "_" * (x == y)
        whole = given.with_gain(gain_error) if gain_error > 0 else given
        one = replace(whole, x_axis=replace(given.x_axis, name=x), y_axis=replace(given.y_axis, name=y))
        group.attrs.update({"signal": y, "axes": [x]})
        group.attrs.update({"name": one.name, "label": one.label, "entry": one.entry, "role": str(one.role)})
        if one.fit is not None:
            group.attrs["auxiliary_signals"] = [y + FIT]
        for axis, values in one.columns():
            data = group.create_dataset(free_name(group, axis.name), data=values)
            data.attrs.update({"units": axis.unit, "long_name": axis.long_name})
        if one.name == default_plot and "default" not in every.attrs:
            entry.attrs["default"], every.attrs["default"] = SERIES_GROUP, made


def append_passes(file: "h5py.File") -> None:
    """Append the points of several passes over x as one plot, a line a pass, which a NeXus viewer then shows first."""
    from protocols.runfile.creation import create_group

    points = file["entry/points"]
    x, y = attribute_text(points, "axes"), attribute_text(points, "signal")
    numbers = np.unique(points[PASS][:]) if PASS in points else ()
    if len(numbers) < 2:
        return
    rows = [np.flatnonzero(points[PASS][:] == number) for number in numbers]
    places = np.sort(points[x][:][max(rows, key=len)])
    nearest = np.abs(points[x][:][:, None] - places).argmin(axis=1)  # measured places differ a little between passes
    passes = create_group(file["entry"], PASSES_GROUP, "NXdata", axes=[x])
    passes["title"] = points[y].attrs["long_name"]
    passes.create_dataset(x, data=places).attrs.update(points[x].attrs)
    names = [f"{y}_{number:g}" for number in numbers]
    for name, own in zip(names, rows, strict=True):
        line, setting_m = np.full(places.size, np.nan), float(points[SETTING][own[0]])
        line[nearest[own]] = points[y][:][own]
        label = "free" if np.isnan(setting_m) else f"{1e3 * setting_m:g} mm"
        passes.create_dataset(name, data=line).attrs.update({"units": points[y].attrs["units"], "long_name": label})
    passes.attrs.update({"signal": names[0], "auxiliary_signals": names[1:]})
    file["entry"].attrs["default"] = PASSES_GROUP


def read_series(group: "h5py.Group") -> Iterator[Series]:
    """Yield the series of a group; in earlier files further columns of the same x become series of their own.

    Raises:
        ValueError: the columns differ in length, or an axis is missing.
    """
    x, y = attribute_text(group, "axes"), attribute_text(group, "signal")
    datasets = quantity_columns(group)
    if x == y or not {x, y} <= datasets.keys():
        raise ValueError(f"{group.name} has no column of its axes")
    axes = {
        name: SeriesAxis(name, attribute_text(data, "units"), attribute_text(data, "long_name").rpartition(" (")[0])
        for name, data in datasets.items()
    }
    columns: dict[str, Any] = {name: np.asarray(data[:], float) for name, data in datasets.items()}
    places, values, fit = columns.pop(x), columns.pop(y), columns.pop(y + FIT, None)
    if (phase := columns.pop(PHASE, None)) is not None and phase.shape == values.shape:
        values = values * np.exp(1j * phase)
    usable = columns.pop(USABLE, None)
    series = Series(
        places,
        values,
        columns.pop(y + ERRORS, None),
        columns.pop(y + TOTAL_ERRORS, None),
        None if usable is None else usable > 0,
        fit,
        columns.pop(COHERENCE, None),
        x_axis=axes[x],
        y_axis=axes[y],
        fit_description="" if fit is None else axes[y + FIT].description,
        name=attribute_text(group, "name"),
        label=attribute_text(group, "label"),
        role=Role(attribute_text(group, "role")) if "role" in group.attrs else Role.MEASURED,
        entry=attribute_integer(group, "entry"),
    )
    for name, further in columns.items():
        yield Series(
            places,
            further,
            x_axis=axes[x],
            y_axis=axes[name],
            name=f"{series.name} of the {name}",
            label=series.label,
            entry=series.entry,
        )
    yield series
