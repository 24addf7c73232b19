"""Typed reading of datasets and attributes: a wrong type or shape raises a ValueError with the place."""

from collections.abc import Collection
from typing import TYPE_CHECKING, Any

import numpy as np

from protocols.base import parse_json_object, visible_text, visible_values

if TYPE_CHECKING:
    import h5py

MAX_ATTRIBUTE_VALUES = 64
"""Largest number of values of an attribute; the program's own have one or two."""
ROWS_PER_READ = 4096
"""Number of rows of a table per read."""


def read_text(group: "h5py.Group", name: str) -> str:
    """Return a text of one line, with control characters escaped."""
    return visible_text(read_raw_text(group, name))


def read_raw_text(group: "h5py.Group", name: str) -> str:
    """Return a text as stored."""
    value = _scalar(group, name, "SO")
    return value.decode() if isinstance(value, bytes) else str(value)


def read_object(group: "h5py.Group", name: str) -> dict[str, Any]:
    """Return a JSON object stored as text, with control characters escaped."""
    try:
        return dict(visible_values(parse_json_object(read_raw_text(group, name))))
    except ValueError as error:
        raise ValueError(f"{group.name}/{name}: {error}") from None


def read_number(group: "h5py.Group", name: str) -> float:
    """Return a number."""
    return float(_scalar(group, name, "iufb"))


def read_integer(group: "h5py.Group", name: str) -> int:
    """Return an integer or a truth value."""
    return int(_scalar(group, name, "iub"))


def column(group: "h5py.Group", name: str, kinds: str = "iuf") -> "h5py.Dataset":
    """Return a dataset of numbers along one axis."""
    return _dataset(group, name, kinds)


def table(group: "h5py.Group", name: str, names: Collection[str]) -> "h5py.Dataset":
    """Return a dataset of records with at least these fields."""
    data = _dataset(group, name, "V")
    if missing := [each for each in names if each not in (data.dtype.names or ())]:
        raise ValueError(f"{data.name} has no {missing[0]}")
    return data


def subgroup(group: "h5py.Group", name: str) -> "h5py.Group":
    """Return a group in a group."""
    import h5py

    item = group[name]
    if not isinstance(item, h5py.Group):
        raise ValueError(f"{item.name} is not a group")
    return item


def quantity_columns(group: "h5py.Group") -> "dict[str, h5py.Dataset]":
    """Return the columns of a table: its datasets with units. Other objects in the group are ignored."""
    import h5py

    columns = {}
    for name, data in group.items():
        if isinstance(data, h5py.Dataset) and "units" in data.attrs:
            if data.dtype.kind not in "iuf" or data.ndim not in (1, 2):
                raise ValueError(f"{data.name} is not a column of numbers")
            columns[visible_text(name)] = data
    return columns


def attribute_texts(of: "h5py.Group | h5py.Dataset", name: str) -> list[str]:
    """Return an attribute of one or several texts."""
    attribute = of.attrs.get_id(name)
    if attribute.dtype.kind not in "SOU" or int(np.prod(attribute.shape, dtype=np.int64)) > MAX_ATTRIBUTE_VALUES:
        raise ValueError(f"{of.name} has a {name} that is not text")
    values = np.atleast_1d(of.attrs[name]).ravel().tolist()
    return [visible_text(value.decode() if isinstance(value, bytes) else str(value)) for value in values]


def attribute_text(of: "h5py.Group | h5py.Dataset", name: str) -> str:
    """Return an attribute of one text, or the first of several."""
    texts = attribute_texts(of, name)
    if not texts:
        raise ValueError(f"{of.name} has an empty {name}")
    return texts[0]


def attribute_integer(of: "h5py.Group | h5py.Dataset", name: str) -> int:
    """Return an integer attribute."""
    attribute = of.attrs.get_id(name)
    if attribute.dtype.kind not in "iu" or attribute.shape not in ((), (1,)):
        raise ValueError(f"{of.name} has a {name} that is not an integer")
    return int(np.ravel(of.attrs[name])[0])


def _dataset(group: "h5py.Group", name: str, kinds: str) -> "h5py.Dataset":
    """Return a dataset of one of the numpy kinds along one axis."""
    import h5py

    data = group[name]
    if not isinstance(data, h5py.Dataset):
        raise ValueError(f"{group.name}/{name} is a group, not data")
    if data.dtype.kind not in kinds or data.shape is None or data.ndim != 1:
        raise ValueError(f"{group.name}/{name} has another type or shape than in a run")
    return data


def _scalar(group: "h5py.Group", name: str, kinds: str) -> Any:
    """Return a single value of one of the numpy kinds; h5py's objects of its high level take three times as long to read it."""
    from h5py import h5d, h5o, h5s

    data = h5o.open(group.id, name.encode())
    if not isinstance(data, h5d.DatasetID):
        raise ValueError(f"{group.name}/{name} is a group, not data")
    value = np.empty((), data.dtype)
    if value.dtype.kind not in kinds or data.get_space().get_simple_extent_type() != h5s.SCALAR:
        raise ValueError(f"{group.name}/{name} has another type or shape than in a run")
    data.read(h5s.ALL, h5s.ALL, value)
    return value[()]
