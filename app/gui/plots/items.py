"""Curves, symbols and error bars that a logarithmic axis shows by the logarithms of their values."""

from typing import Any

import numpy as np
import pyqtgraph as pg

from model import Array

SMALLEST = 1e-12
"""Ends of bands and error bars below this are drawn here, far below every range."""


def place(values: Any, log: bool) -> Array:
    """Return values as coordinates of an axis; NaN where a logarithmic one has none."""
    numbers = np.asarray(values, dtype=float)
    return np.log10(np.where(numbers > 0, numbers, np.nan)) if log else numbers


def place_end(values: Array, log: bool) -> Array:
    """Return the ends of bands or error bars as coordinates; an end not above zero lies below every range."""
    return (
        place(np.where(np.asarray(values) > SMALLEST, values, np.where(np.isfinite(values), SMALLEST, np.nan)), log)
        if log
        else values
    )


def linear_data(item: Any) -> tuple[Any, Any]:
    """Return x and y of a curve or scatter in the units of the axes, logarithmic or not."""
    if isinstance(item, pg.PlotDataItem):
        data: tuple[Any, Any] = item.getOriginalDataset()
        return data
    given: tuple[Any, Any] | None = getattr(item, "linear", None)
    return item.getData() if given is None else given


class LogPlaced:
    """Item of a plot that is placed anew when an axis becomes logarithmic, or linear again."""

    linear: tuple[Array, Array] | None = None
    """x and y in the units of the axes."""
    _log = (False, False)

    def setLogMode(self, x: bool, y: bool) -> None:
        """Place the item on logarithmic or linear axes."""
        if (x, y) != self._log:
            self._log = (x, y)
            self._place_again()

    def _place_again(self) -> None:
        raise NotImplementedError

    def _placed(self) -> tuple[Array, ...]:
        """Return x and y as coordinates of the axes."""
        assert self.linear is not None
        return tuple(place(values, log) for values, log in zip(self.linear, self._log, strict=True))


class CurveItem(LogPlaced, pg.PlotCurveItem):  # type: ignore[misc]  # pyqtgraph has no types
    """A line."""

    def setData(self, *args: Any, **options: Any) -> None:
        if len(args) == 2:
            options["x"], options["y"] = args
        if "x" in options:
            self.linear = (np.asarray(options["x"], float), np.asarray(options["y"], float))
            self._place_again(**options)
        else:
            super().setData(**options)

    def _place_again(self, **options: Any) -> None:
        if self.linear is not None:
            options["x"], options["y"] = self._placed()
            super().setData(**options | ({"connect": "finite"} if any(self._log) else {}))


class ScatterItem(LogPlaced, pg.ScatterPlotItem):  # type: ignore[misc]  # pyqtgraph has no types
    """Symbols, hidden if a logarithmic axis cannot show them."""

    _given: dict[str, Any] | None = None

    def setData(self, *args: Any, **options: Any) -> None:
        if "x" not in options:
            super().setData(*args, **options)
            return
        self._given = dict(options)
        self.linear = (np.asarray(options["x"], float), np.asarray(options["y"], float))
        if not any(self._log):
            super().setData(**options)
            return
        x, y = self._placed()
        there = np.isfinite(x) & np.isfinite(y)  # Qt crashes when it paints a point that is not finite
        options["x"], options["y"] = (np.where(there, v, v[there].min() if there.any() else 0.0) for v in (x, y))
        super().setData(**options)
        if not there.all():
            self.setPointsVisible(there)

    @property
    def hidden_count(self) -> int:
        """Number of points that are not above zero on a logarithmic axis."""
        if self.linear is None:
            return 0
        below = [values <= 0 for values, log in zip(self.linear, self._log, strict=True) if log]
        return int(np.any(below, axis=0).sum()) if below else 0

    def _place_again(self) -> None:
        if self._given is not None:
            self.setData(**self._given)


class BarsItem(LogPlaced, pg.ErrorBarItem):  # type: ignore[misc]  # pyqtgraph has no types
    """Vertical error bars."""

    _given: dict[str, Array] | None = None

    @property
    def errors(self) -> Array:
        """Half the heights of the bars, in the units of the axis."""
        assert self._given is not None
        return np.asarray(self._given["height"], float) / 2

    def setData(self, **options: Any) -> None:
        if "x" in options:
            self._given = {name: np.asarray(options[name], float) for name in ("x", "y", "height")}
            options |= self._placed_bars()
        super().setData(**options)

    def _place_again(self) -> None:
        if self._given is not None:
            super().setData(**self._placed_bars())

    def dataBounds(self, *_: Any, **__: Any) -> tuple[None, None]:
        """Leave the range to the points: on a logarithmic axis a bar may reach down without end."""
        return (None, None)

    def _placed_bars(self) -> dict[str, Any]:
        assert self._given is not None
        if not any(self._log):
            return {**self._given, "top": None, "bottom": None}
        x, y, height = (self._given[name] for name in ("x", "y", "height"))
        there = (x > 0) | (not self._log[0])
        there &= (y > 0) | (not self._log[1])
        x, y, half = x[there], y[there], height[there] / 2
        low, middle, high = (place_end(v, self._log[1]) for v in (y - half, y, y + half))
        return {"x": place(x, self._log[0]), "y": middle, "height": None, "top": high - middle, "bottom": middle - low}
