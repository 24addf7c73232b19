"""State of the Explore page: its setting with history, and the responses that the model computes from it."""

import json
from collections.abc import Callable, Sequence
from pathlib import Path

from PySide6.QtCore import QObject, QSettings, Signal
from PySide6.QtGui import QGuiApplication

from app.explore import (
    ExploreRequest,
    ExploreResult,
    ExploreSession,
    ExploreSetting,
    ResponseEngine,
    make_study,
    write_study,
)
from app.gui.widgets import BackgroundWorker, at_end
from app.live import LatestOnlyWorker
from model import ParameterError

PAINT_PAUSE_S = 0.02
"""Pause of the worker after the curve, so that it is painted before the motion is computed."""


class ExploreModel(QObject):
    """Changes the setting and computes its response in the background."""

    changed = Signal()
    """The setting has changed, or was refused."""
    computed = Signal(object, object)
    """An `ExploreRequest`, and its `ExploreResult` or an exception."""
    message = Signal(str, bool)
    """A message, and whether it is an error; an empty one after a change."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self.session = ExploreSession()
        self.requested: ExploreRequest | None = None
        self._study_worker = BackgroundWorker("explore study", self)
        self.worker = LatestOnlyWorker(ResponseEngine().compute, self.computed.emit, "explore model", PAINT_PAUSE_S)
        at_end(self, self.worker.close)

    @property
    def setting(self) -> ExploreSetting:
        return self.session.setting

    def set_value(self, name: str, value: float) -> None:
        """Set a parameter, SI."""
        self._apply(lambda: self.session.set_value(name, value))

    def set_setting(self, setting: ExploreSetting) -> None:
        self._apply(lambda: self.session.set_setting(setting))

    def load_preset(self, name: str) -> None:
        self._apply(lambda: self.session.load_preset(name))
        self.compute()

    def undo(self) -> None:
        self.session.history.undo()
        self.changed.emit()

    def redo(self) -> None:
        self.session.history.redo()
        self.changed.emit()

    def keep_curve(self) -> None:
        self.session.keep_curve()
        self.compute()

    def set_site(self, site: str) -> None:
        """Choose the body site of the perception threshold."""
        self.session.site = site
        self.compute()

    def compute(self) -> None:
        """Request the response of the setting, unless it was requested already."""
        request = self.session.request
        if request != self.requested:
            self.requested = request
            self.worker.submit(request)

    def copy(self, kind: str) -> None:
        """Copy the parameters as text for `--set`, `JSON` or `TOML`."""
        text = self.setting.as_json() if kind == "JSON" else self.setting.as_toml()
        QGuiApplication.clipboard().setText(text)
        usage = 'tactor-bench model frequency-response --set @FILE, or --set "the text itself"'
        self.message.emit(f"copied as {kind}: {usage}", False)

    def save_study(self, path: Path, result: ExploreResult | None = None) -> None:
        """Save a study of the parameters that differ between the kept curves, else of the slider moved last.

        At the frequencies of `result`; without one, 1 Hz to 250 Hz.
        """
        frequencies_hz: Sequence[float] = range(1, 251) if result is None else result.curve.frequency_hz.tolist()
        self.message.emit("computing the study …", False)
        setting, kept, variable = self.setting, self.session.kept_curves, self.session.study_variable
        self._study_worker.submit(
            lambda: write_study(path, make_study(setting, kept, variable, frequencies_hz), variable),
            lambda text: self.message.emit(str(text), False),
            lambda error: self.message.emit(str(error), True),
        )

    def save_state(self, settings: QSettings) -> None:
        settings.setValue("explore/setting", json.dumps(self.session.to_record()))

    def restore_state(self, settings: QSettings) -> None:
        try:
            self.session.restore_record(json.loads(str(settings.value("explore/setting", ""))))
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        self.changed.emit()

    def _apply(self, change: Callable[[], object]) -> None:
        """Change the setting; if the model rejects it, show why and keep the old one."""
        try:
            change()
        except ParameterError as error:
            self.message.emit(str(error), True)
        else:
            self.message.emit("", False)
        self.changed.emit()
