"""Measured runs that lie over the model's curves, and the fit that brings the model to them: read and fitted beside the window."""

import threading
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.archive.replay import Measured, read_measured
from app.explore.fit import Fitted
from app.explore.state import Setting
from app.gui.widgets.background import Jobs

Fit = Callable[[Sequence[Measured], Setting, Callable[[], bool]], Fitted]
"""Finds the setting that meets the runs best, beginning from one, until it is cancelled; raises ValueError with a sentence."""


class OverlaidRuns(QObject):
    """Which runs lie over the curves, and whether they are being fitted."""

    changed = Signal()
    fitting = Signal(bool)
    """A fit has begun, or is over."""
    fitted = Signal(object)
    """A `Fitted`."""
    said = Signal(str, bool)
    """A remark, and whether it is a fault."""

    def __init__(self, fit: Fit | None, parent: QObject) -> None:
        super().__init__(parent)
        self.fit_with = fit
        self.runs: tuple[Measured, ...] = ()
        self._jobs, self._fits = Jobs("explore", self), Jobs("explore fit", self)
        self._cancelled = threading.Event()
        self._fitting = False

    def lay_over(self, paths: Sequence[Path]) -> None:
        """Read runs and add them."""
        for path in paths:
            if all(run.path != path for run in self.runs):
                self._jobs.do(lambda path=path: read_measured(path), self._laid, self._failed)  # type: ignore[misc]

    def drop(self, run: Measured) -> None:
        """Take one away."""
        self._become(tuple(r for r in self.runs if r is not run))

    def clear(self) -> None:
        """Take all away."""
        self._become(())

    def fit(self, setting: Setting) -> None:
        """Let the model go where the runs are met best, from a setting; while that goes on: cancel it."""
        if self._fitting:
            self._cancelled.set()
            return
        find, runs = self.fit_with, self.runs
        if find is None or not runs:
            self.said.emit("lay a measured run over the curves first", True)
            return
        self._cancelled.clear()
        self._become_fitting(True)
        self._fits.do(lambda: find(runs, setting, self._cancelled.is_set), self._fitted, self._fit_failed)

    def end(self) -> None:
        """End what works beside the window."""
        self._cancelled.set()
        self._jobs.close()
        self._fits.close()

    def _laid(self, run: Measured) -> None:
        self._become((*(r for r in self.runs if r.path != run.path), run))

    def _become(self, runs: tuple[Measured, ...]) -> None:
        self.runs = runs
        self.changed.emit()

    def _become_fitting(self, fitting: bool) -> None:
        self._fitting = fitting
        self.fitting.emit(fitting)

    def _fitted(self, fitted: Fitted) -> None:
        self._become_fitting(False)
        self.fitted.emit(fitted)

    def _fit_failed(self, error: Exception) -> None:
        from model.identification.fit_options import FitCancelled

        self._become_fitting(False)
        if isinstance(error, FitCancelled):
            self.said.emit("the fit was cancelled; nothing was moved", False)
        else:
            self._failed(error)

    def _failed(self, error: Exception) -> None:
        self.said.emit(str(error), True)
