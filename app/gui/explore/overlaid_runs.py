"""Measured runs over the curves of the Explore page, read and fitted in background threads."""

import threading
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from PySide6.QtCore import QObject, Signal

from app.archive import MeasuredResponse, load_run, read_measured_response
from app.common import ResultSummary
from app.explore import ExploreFit, ExploreSetting
from app.gui.widgets import BackgroundWorker

FitRuns = Callable[[Sequence[MeasuredResponse], ExploreSetting, Callable[[], bool]], ExploreFit]
"""Fits a setting to runs, starting from one, until cancelled; raises ValueError with a message for the operator."""


class OverlaidRuns(QObject):
    """The overlaid runs and their fit."""

    changed = Signal()
    fitting = Signal(bool)
    """A fit has started (True) or finished."""
    fitted = Signal(object)
    """A `ExploreFit`."""
    message = Signal(str, bool)
    """A message, and whether it is an error."""

    def __init__(self, fit: FitRuns, parent: QObject) -> None:
        super().__init__(parent)
        self.fit_with = fit
        self.runs: tuple[MeasuredResponse, ...] = ()
        self._cancelled = threading.Event()
        self._file_worker = BackgroundWorker("explore", self)
        self._fit_worker = BackgroundWorker("explore fit", self, self._cancelled.set)
        self._fitting = False

    def add(self, paths: Sequence[Path]) -> None:
        """Read runs and add them."""
        for path in paths:
            if all(run.path != path for run in self.runs):
                self._file_worker.submit(partial(read_measured_response, path), self._on_loaded, self._on_error)

    def remove(self, *runs: MeasuredResponse) -> None:
        removed = [run.path for run in runs]
        self._set_runs(tuple(run for run in self.runs if run.path not in removed))

    def read_result(self, path: Path, show: Callable[[ResultSummary], object]) -> None:
        """Read the contents of a run's result card; only the newest request is answered."""
        self._file_worker.submit(
            lambda: load_run(path, with_traces=False).result, show, self._on_error, latest_only="result"
        )

    def fit(self, setting: ExploreSetting) -> None:
        """Fit the model to the runs, starting from a setting; during a fit: cancel it."""
        if self._fitting:
            self._cancelled.set()
            return
        find, runs = self.fit_with, self.runs
        if not runs:
            self.message.emit("overlay a measured run on the curves first", True)
            return
        self._cancelled.clear()
        self._set_fitting(True)
        self._fit_worker.submit(
            lambda: find(runs, setting, self._cancelled.is_set), self._on_fitted, self._on_fit_error
        )

    def _on_loaded(self, run: MeasuredResponse) -> None:
        self._set_runs((*(r for r in self.runs if r.path != run.path), run))

    def _set_runs(self, runs: tuple[MeasuredResponse, ...]) -> None:
        self.runs = runs
        self.changed.emit()

    def _set_fitting(self, fitting: bool) -> None:
        self._fitting = fitting
        self.fitting.emit(fitting)

    def _on_fitted(self, result: ExploreFit) -> None:
        self._set_fitting(False)
        self.fitted.emit(result)

    def _on_fit_error(self, error: Exception) -> None:
        from model.identification import FitCancelled

        self._set_fitting(False)
        if isinstance(error, FitCancelled):
            self.message.emit("the fit was cancelled; nothing was moved", False)
        else:
            self._on_error(error)

    def _on_error(self, error: Exception) -> None:
        self.message.emit(str(error), True)
