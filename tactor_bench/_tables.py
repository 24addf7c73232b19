"""Points, curves and estimates of a run as numpy columns with units, and as pandas frames."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any, ClassVar, TypeVar

from model import Array, EstimatedQuantity, Mask, format_quantity
from protocols.base import Quality, Series, usable_mask

if TYPE_CHECKING:
    import pandas as pd

T = TypeVar("T")


class _NamedItems(Mapping[str, T]):
    """Items by name; the error for an unknown name lists the valid ones."""

    unknown: ClassVar[str]

    def __init__(self, items: Mapping[str, T]) -> None:
        self._items = dict(items)

    def __getitem__(self, name: str) -> T:
        if name not in self._items:
            raise KeyError(self.unknown.format(name, ", ".join(self._items) or "none"))
        return self._items[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)


class ColumnTable(_NamedItems[Array]):
    """Named columns with units: `table["frequency"]` is a numpy array, `table.unit("frequency")` its SI unit, `len(table)` the number of columns."""

    unknown = "there is no column {!r}; the columns are: {}"

    def __init__(self, columns: Mapping[str, Array], units: Mapping[str, str]) -> None:
        super().__init__(columns)
        self._units = dict(units)

    def __repr__(self) -> str:
        rows = len(next(iter(self.values()), ()))
        listed = ", ".join(f"{name} [{self.unit(name)}]" for name in self)
        return f"<{type(self).__name__}: {rows} rows of {listed}>"

    def unit(self, name: str) -> str:
        """Return the SI unit of a column; `1` for a pure number.

        Raises:
            KeyError: there is no such column.
        """
        self[name]
        return self._units.get(name, "1")

    def errors(self, name: str) -> Array:
        """Return the standard uncertainties of a column, in its unit and shape.

        Raises:
            KeyError: the column has no uncertainties.
        """
        return self[f"{name}_errors"]

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas frame, one row per point; a column of several values per point becomes several columns.

        The units are in `frame.attrs["units"]`, by column.

        Raises:
            ImportError: pandas is not installed.
        """
        columns: dict[str, Array] = {}
        units: dict[str, str] = {}
        for name, values in self.items():
            several = {name: values} if values.ndim == 1 else {f"{name}_{i}": v for i, v in enumerate(values.T, 1)}
            columns |= several
            units |= dict.fromkeys(several, self.unit(name))
        frame = pandas().DataFrame(columns)
        frame.attrs["units"] = units
        return frame


class Points(ColumnTable):
    """The points of a run.

    Columns are named as in the run file: (N,) arrays of numbers, or (N, K) for several values per point. `<name>_errors`
    are standard uncertainties, `quality` holds flags (`Quality`), `entry` the entry of the protocol's plan.

    Example:
        >>> import numpy as np
        >>> points = Points({"frequency": np.array([100.0, 160.0]), "quality": np.array([0, 2])}, {"frequency": "Hz"})
        >>> points["frequency"][points.usable], points.unit("frequency"), points.flags[1]
        (array([100.]), 'Hz', <Quality.UNSETTLED: 2>)
    """

    @property
    def flags(self) -> tuple[Quality, ...]:
        """Quality flags of each point, (N,)."""
        return tuple(Quality(int(each)) for each in self["quality"])

    @property
    def usable(self) -> Mask:
        """Whether fits and summaries may use each point, (N,), by its flags."""
        return usable_mask(self["quality"])


class CurveTable(ColumnTable):
    """A curve of one entry of a run, in addition to its point: a frequency response, a decay, a loop.

    Attributes:
        name: for example `response`.
        label: distinguishes the curves of one name.
        x, y: names of the plotted columns; `errors(y)` are the standard uncertainties of y, if available.
        entry: entry of the protocol's plan.
    """

    def __init__(self, series: Series) -> None:
        columns = list(series.columns())
        super().__init__({axis.name: values for axis, values in columns}, {axis.name: axis.unit for axis, _ in columns})
        self.name, self.label, self.entry = series.name, series.label, series.entry
        self.x, self.y = series.x_axis.name, series.y_axis.name


class EstimateTable(_NamedItems[EstimatedQuantity]):
    """Estimates by name: `table["k2"].value`, `.standard_error`, `.unit`; printed with two digits of their error."""

    unknown = "there is no estimate of {!r}; there are: {}"

    def __init__(self, estimates: Sequence[EstimatedQuantity]) -> None:
        super().__init__({each.name: each for each in estimates})

    def __repr__(self) -> str:
        lines = (f"{name}: {format_quantity(e.value, e.standard_error, e.unit, name)}" for name, e in self.items())
        return "\n".join(lines) or "no estimates"

    def to_pandas(self) -> "pd.DataFrame":
        """Return a pandas frame with the columns value, standard_error and unit, indexed by name.

        Raises:
            ImportError: pandas is not installed.
        """
        rows = {name: (e.value, e.standard_error, e.unit) for name, e in self.items()}
        return pandas().DataFrame.from_dict(rows, orient="index", columns=["value", "standard_error", "unit"])


def pandas() -> Any:
    """Import pandas.

    Raises:
        ImportError: it is not installed.
    """
    try:
        import pandas as pd
    except ImportError:
        raise ImportError(
            "to_pandas needs pandas, which is not installed in this environment; install it ('pip install pandas'), "
            "or use the numpy columns, for example run.points['frequency']"
        ) from None
    return pd
