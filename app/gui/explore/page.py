"""The Explore page: sliders for every number of the model, and at once what the skin would feel.

Where everything of the Explore page stands: sliders at the left, the curves and the motion at the right.
"""

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from PySide6.QtCore import QSettings, Qt, Signal
from PySide6.QtGui import QDragEnterEvent, QDropEvent, QGuiApplication
from PySide6.QtWidgets import QScrollArea, QSplitter, QVBoxLayout, QWidget

from app.archive.replay import Measured
from app.explore.engine import Answerer, Picture, Question
from app.explore.fit import Fitted
from app.explore.session import Exploration, write_study
from app.explore.state import TITLES, Setting, study_of
from app.gui.explore.overlaid_runs import Fit, OverlaidRuns
from app.gui.explore.plot import ExplorePlot
from app.gui.explore.shape_plot import ShapePlot
from app.gui.explore.sliders import SliderPanel
from app.gui.explore.toolbar import ExploreBar
from app.gui.widgets.background import Jobs
from app.gui.widgets.dropped_files import run_urls
from app.gui.widgets.file_dialog import Mode, ask_for_files
from app.gui.widgets.shortcuts import HERE, bind
from app.gui.widgets.status_line import Remark
from app.gui.widgets.theme import Theme
from app.live.latest_only import Latest
from app.session.state import View
from model.parameter_spec import ParameterError


def columns(
    sliders: SliderPanel, remark: Remark, plot: ExplorePlot, shape: ShapePlot, bar: ExploreBar
) -> tuple[QWidget, QWidget]:
    """The left and the right side."""
    return _left(sliders, remark, bar), _right(plot, shape, bar)


def _left(sliders: SliderPanel, remark: Remark, bar: ExploreBar) -> QWidget:
    scroll = QScrollArea()
    scroll.setWidget(sliders)
    scroll.setFocusPolicy(Qt.FocusPolicy.NoFocus)
    scroll.setWidgetResizable(True)
    scroll.setHorizontalScrollBarPolicy(Qt.ScrollBarPolicy.ScrollBarAlwaysOff)
    scroll.viewport().setAutoFillBackground(False)
    sliders.setAutoFillBackground(False)
    left, column = _column(6)
    column.setContentsMargins(0, 2, 4, 0)
    column.addLayout(bar.start())
    column.addWidget(scroll, 1)
    column.addWidget(remark)
    column.addLayout(bar.leave())
    left.setMinimumWidth(400)
    return left


def _right(plot: ExplorePlot, shape: ShapePlot, bar: ExploreBar) -> QWidget:
    right, column = _column(4)
    column.addLayout(bar.head())
    column.addLayout(bar.runs())
    rows = QSplitter(Qt.Orientation.Vertical)
    rows.addWidget(plot)
    below, beam = _column(2)
    beam.addLayout(bar.motion())
    beam.addWidget(shape, 1)
    rows.addWidget(below)
    rows.setSizes([400, 210])
    rows.setObjectName("explore/rows")
    rows.setChildrenCollapsible(False)
    column.addWidget(rows, 1)
    return right


def _column(spacing: int) -> tuple[QWidget, QVBoxLayout]:
    """An empty column that fills its place."""
    widget = QWidget()
    column = QVBoxLayout(widget)
    column.setContentsMargins(0, 0, 0, 0)
    column.setSpacing(spacing)
    return widget, column


PAINT_S = 0.02
"""After the curve the worker waits so long for it to be painted, before it goes on with the motion."""


class ExplorePage(QSplitter):
    """One page of the window.

    Args:
        fit: identifies from the runs laid over; without one there is no such button.
    """

    title = "Explore"
    _answered = Signal(object, object)

    def __init__(self, theme: Theme, fit: Fit | None = None, parent: QWidget | None = None) -> None:
        super().__init__(Qt.Orientation.Horizontal, parent)
        self.exploration = Exploration()
        self.picture: Picture | None = None
        self.shape_of: Question | None = None
        """The question whose whole answer is on the screen."""
        self._asked: Question | None = None
        self._stale = True
        self._jobs = Jobs("explore study", self)
        self.overlaid = OverlaidRuns(fit, self)
        self._latest: Latest[Question, Picture] | None = None
        self.sliders, self.plot, self.shape = SliderPanel(), ExplorePlot(theme), ShapePlot(theme)
        self.bar = ExploreBar(TITLES, fit is not None, self)
        self.remark = Remark()
        for side in columns(self.sliders, self.remark, self.plot, self.shape, self.bar):
            self.addWidget(side)
        self.setStretchFactor(0, 0)
        self.setStretchFactor(1, 1)
        self.setSizes([430, 820])
        self.setObjectName("explore/columns")
        self.setChildrenCollapsible(False)
        self._connect()
        self.setAcceptDrops(True)
        self.setFocusPolicy(Qt.FocusPolicy.ClickFocus)
        self._series()
        self._show_setting()

    @property
    def setting(self) -> Setting:
        return self.exploration.setting

    @property
    def measured(self) -> tuple[Measured, ...]:
        """The runs that lie over the curves."""
        return self.overlaid.runs

    # -- what the window does with a page ------------------------------------------------------------------------------

    def show_view(self, view: View) -> None:
        """Nothing here depends on the bench."""

    def set_theme(self, theme: Theme) -> None:
        """Take other colours."""
        self.plot.set_theme(theme)
        self.shape.set_theme(theme)

    def enter(self) -> None:
        """Take the keyboard."""
        self.setFocus()

    def refresh(self) -> None:
        """Called at every tick while the page is seen."""
        if self._asked is None:
            self._ask()
        if self._stale:
            self._stale = False
            self.sliders.show_setting(self.setting)
            self.bar.show_setting(self.setting, self.exploration.history)
        self.shape.refresh()

    def end(self) -> None:
        """End what works beside the window."""
        if self._latest is not None:
            self._latest.close()
        self._jobs.close()
        self.overlaid.end()

    def save(self, settings: QSettings) -> None:
        """Remember how it is."""
        settings.setValue("explore/setting", json.dumps(self.exploration.record()))

    def restore(self, settings: QSettings) -> None:
        """Be as it was."""
        try:
            self.exploration.begin_from(json.loads(str(settings.value("explore/setting", ""))))
        except (ValueError, KeyError, TypeError, AttributeError):
            return
        self._show_setting()

    # -- what a person wants -------------------------------------------------------------------------------------------

    def turn(self, name: str, value: float) -> None:
        """One slider to a value, SI."""
        self._moved(lambda: self.exploration.turn(name, value))

    def reset(self, name: str) -> None:
        """One slider back."""
        self._moved(lambda: self.exploration.reset(name))

    def go(self, setting: Setting) -> None:
        """Another setting."""
        self._moved(lambda: self.exploration.go(setting))

    def choose(self, name: str) -> None:
        """Begin from a preset."""
        self._moved(lambda: self.exploration.choose(name))
        if self.exploration.kept:
            self.bar.series[1].setChecked(True)  # the paper's theory is the fundamental
            self.bar.series[0].setChecked(False)
        self._ask()

    def undo(self) -> None:
        self.exploration.history.undo()
        self._show_setting()

    def redo(self) -> None:
        self.exploration.history.redo()
        self._show_setting()

    def keep(self) -> None:
        """Let the present curve stay while the sliders move on."""
        self.exploration.keep()
        self._ask()

    def clear(self) -> None:
        """Take kept curves and measured runs away."""
        self.exploration.kept = ()
        self.overlaid.clear()
        self._ask()

    def lay_over(self, paths: Sequence[Path]) -> None:
        """Measured runs over the curves."""
        self.overlaid.lay_over(paths)

    def fit(self) -> None:
        """Let the sliders go where the runs are met best; while that goes on: cancel it."""
        self.overlaid.fit(self.setting)

    def copy(self, kind: str) -> None:
        """The numbers as text for `--set`."""
        text = self.setting.as_json() if kind == "JSON" else self.setting.as_toml()
        QGuiApplication.clipboard().setText(text)
        self.remark.say(
            f'copied as {kind}: tactor-bench model frequency-response --set @FILE, or --set "the text itself"'
        )

    def save_study(self, path: Path) -> None:
        """What the kept curves vary, or the slider moved last, as a study file."""
        self.remark.say("computing the study …")
        setting, kept, variable = self.setting, self.exploration.kept, self.exploration.variable
        frequencies: Any = range(1, 251) if self.picture is None else self.picture.line.frequency_hz
        self._jobs.do(
            lambda: write_study(path, study_of(setting, kept, variable, frequencies), variable),
            lambda words: self.remark.say(str(words)),
            self._failed,
        )

    # -- inside --------------------------------------------------------------------------------------------------------

    def _fitted(self, fitted: Fitted) -> None:
        self.go(fitted.setting)
        self.remark.say(f"Fitted: {fitted.words}", stays=True)  # until a slider is moved

    def _fitting(self, fitting: bool) -> None:
        self.bar.show_fitting(fitting)
        if fitting:
            self.remark.say("fitting …", stays=True)

    def _failed(self, error: Exception) -> None:
        self.remark.say(str(error), fault=True)

    def _show_measured(self) -> None:
        self.plot.show_measured(self.measured)
        self.bar.show_measured(self.measured, self.overlaid.drop)
        if other := self.exploration.otherwise_driven(self.measured):
            drives = ", ".join(f"{run.label} at {run.peak_to_peak_v:.3g} V" for run in other)
            self.remark.say(f"{drives}; the curve is for {self.setting.peak_to_peak_v:.3g} V peak to peak", fault=True)

    def _moved(self, move: Callable[[], object]) -> None:
        """Do what moves sliders; where the model refuses, say why: they stay where they were."""
        try:
            move()
        except ParameterError as error:
            self.remark.say(str(error), fault=True)
        else:
            self.remark.say("")
        self._show_setting()

    def _show_setting(self) -> None:
        if self.isVisible():
            self._ask()
        else:
            self._asked = None
        self._stale = True  # the curve first; the sliders follow with the next frame

    def _ask(self) -> None:
        question = self.exploration.question
        if question == self._asked:
            return
        self._asked = question
        if self._latest is None:  # not before somebody looks: it loads the linear algebra
            self._latest = Latest(Answerer().pictures, self._answered.emit, "explore model", PAINT_S)
        self._latest.ask(question)

    def _show(self, question: Question, answer: Picture | Exception) -> None:
        if isinstance(answer, Exception):
            self.remark.say(f"the model cannot be computed so: {answer}; move a slider back", fault=True)
            return
        self.picture = answer
        self.plot.show_picture(answer, question.kept)
        if answer.shape is not None:
            self.shape.show_shape(answer.shape, question.at_hz)
            self.shape_of = question

    def _cursor(self, hz: float) -> None:
        self.exploration.at_hz = float(f"{hz:.4g}")
        self.bar.show_frequency(self.exploration.at_hz)
        self._ask()

    def _range(self, top_hz: float) -> None:
        self.exploration.top_hz = top_hz
        self.plot.show_range(top_hz)
        self._ask()

    def _series(self) -> None:
        self.plot.show_series(*(box.isChecked() for box in self.bar.series))

    def _browse(self) -> None:
        ask_for_files(self, "Runs to lay over", self.lay_over, "Runs (*.h5)", mode=Mode.ExistingFiles)

    def _ask_for_study(self) -> None:
        ask_for_files(
            self, "Save as study", lambda paths: self.save_study(paths[0]), "Study (*.h5);;Sheet (*.csv)", "study.h5",
            Mode.AnyFile,
        )  # fmt: skip

    def _connect(self) -> None:
        bar = self.bar
        self._answered.connect(self._show)
        self.overlaid.changed.connect(self._show_measured)
        self.overlaid.fitting.connect(self._fitting)
        self.overlaid.fitted.connect(self._fitted)
        self.overlaid.said.connect(self.remark.say)
        self.sliders.moved.connect(self.turn)
        self.sliders.reset.connect(self.reset)
        self.sliders.refused.connect(lambda words: self.remark.say(words, fault=True))
        self.plot.cursor_moved.connect(self._cursor)
        bar.preset_chosen.connect(self.choose)
        bar.skin_chosen.connect(lambda on: self._moved(lambda: self.exploration.lay_on_skin(on)))
        bar.frequency_chosen.connect(self.plot.pointer.setValue)
        bar.range_chosen.connect(self._range)
        bar.series_changed.connect(self._series)
        bar.copy_chosen.connect(self.copy)
        for button, do in (
            (bar.undo, self.undo),
            (bar.redo, self.redo),
            (bar.keep, self.keep),
            (bar.clear, self.clear),
            (bar.lay, self._browse),
            (bar.fit, self.fit),
            (bar.study, self._ask_for_study),
        ):
            button.clicked.connect(do)
        for words, do, keys in (
            ("Undo", bar.undo.click, ("Ctrl+Z",)),
            ("Redo", bar.redo.click, ("Ctrl+Shift+Z", "Ctrl+Y")),
            ("Keep the present curve", bar.keep.click, ("Ctrl+Shift+K",)),
            ("Copy every parameter as JSON", bar.copy_json.click, ("Ctrl+Shift+C",)),
            ("Lay a run over the curves", bar.lay.click, ("Ctrl+O",)),
            ("Fit the model to the runs that lie over it, or cancel the fit", bar.fit.click, ("Ctrl+F",)),
            ("Free, or on skin", bar.elsewhere, ("Ctrl+T",)),
            ("Save as a study", bar.study.click, ("Ctrl+S",)),
        ):
            bind(self, words, do, *keys, context=HERE, repeats=True)

    def dragEnterEvent(self, event: QDragEnterEvent) -> None:
        if run_urls(event):
            event.acceptProposedAction()

    def dropEvent(self, event: QDropEvent) -> None:
        self.lay_over(run_urls(event))
        event.acceptProposedAction()
