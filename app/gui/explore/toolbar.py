"""Toolbar of the Explore page: presets, displayed series, overlaid runs, export."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject
from PySide6.QtWidgets import QLabel, QPushButton

from app.archive import MeasuredResponse
from app.common import UndoHistory, UnitError, to_number
from app.explore import LABORATORY_SITE, PRESET_TITLES, ExploreSetting
from app.gui.face import set_length
from app.gui.plots import SERIES
from app.gui.widgets import (
    Segments,
    SheetButton,
    WrappedRow,
    clear_layout,
    configure,
    make_button,
    make_combo,
    make_line_edit,
    make_pane,
    put_inside,
    row,
    tooltip,
)

if TYPE_CHECKING:
    from app.gui.explore.page import ExplorePage

PARAMETERS, ANSWER, MOTION = "Parameters", "Answer", "Motion"
RANGES_HZ = (250, 500, 1000, 4000)
SITE_NAMES = ("abdomen", "thenar", "forearm")
"""Names of `model.response.SITES`, which loads scipy."""
SITE_TIP = (
    "Threshold of perception, peak-to-peak displacement. Abdomen: the paper's 50 µm. Thenar and forearm: the course with frequency is published, the level is "
    "unproven (docs/theory.md). Laboratory: from laboratory.toml beside the runs"
)


class ExploreToolbar(QObject):
    """Makes the buttons, which call the page and its model; the page lays out the rows.

    Args:
        page: the page.
    """

    def __init__(self, page: "ExplorePage") -> None:
        super().__init__(page)
        self._page, model = page, page.model
        choices = [("Begin from …", None), *((title, name) for name, title in PRESET_TITLES.items())]
        self.preset_box = make_combo("", "begin from", choices)
        self.preset_box.activated.connect(self._on_preset)
        self.skin = Segments("explore.skin", "tactor", (("Free", False), ("On skin", True)))
        self.skin.chosen.connect(lambda on: model.set_setting(replace(model.setting, on_skin=on)))
        self.undo_button, self.redo_button = (
            make_button(text, act, "choice", tooltip(f"explore.{name}"), accessibleName=name)
            for text, name, act in (("↶", "undo", model.undo), ("↷", "redo", model.redo))
        )
        names = (*(series.label for series in SERIES), "Phase", "log")
        self.series = [configure(QPushButton(name), kind="chip", checkable=True) for name in names]
        self.series[0].setChecked(True)
        self.frequency = make_line_edit(
            "",
            "frequency of the motion in Hz",
            text="160",
            toolTip="Frequency whose motion is shown; the dotted line can be dragged, too",
        )
        set_length(self.frequency, width=80)
        self.frequency.editingFinished.connect(self._on_frequency)
        self.side = Segments("explore.side", "left column", ((each, each) for each in (PARAMETERS, ANSWER, MOTION)))
        self.side.select(PARAMETERS)
        self.ranges = Segments(
            "explore.range",
            "frequencies up to",
            ((f"{hz}{' Hz' * (hz == RANGES_HZ[-1])}", float(hz)) for hz in RANGES_HZ),
        )
        self.ranges.chosen.connect(page.set_range)
        self.ranges.select(float(RANGES_HZ[0]))
        sites = ((name, name) for name in SITE_NAMES)
        self.site_box = make_combo("explore.site", "body site of the perception threshold", sites, toolTip=SITE_TIP)
        self.site_box.currentTextChanged.connect(model.set_site)
        self.keep_button = make_button("Pin curve", model.keep_curve, "choice", tooltip("explore.keep"))
        self.clear_button = make_button(
            "Clear", page.clear_overlays, "choice", "Take kept curves and measured runs away"
        )
        tip = f"{tooltip('explore.overlay')}, or drop files here"
        self.overlay_button = make_button("Add runs …", page.runs_requested.emit, "choice", tip)
        tip = "Run files that are not in the folder of the page Runs"
        self.file_button = make_button("From files …", page.choose_files, "choice", tip)
        self.fit_button = make_button(
            "Fit to the runs", lambda: page.overlaid.fit(model.setting), "choice", tooltip("explore.fit")
        )
        self.study_button = make_button("Save study …", page.choose_study_file, "choice", tooltip("explore.study"))
        self.copy_json_button, self.copy_toml_button = (
            make_button(f"Copy {kind}", partial(model.copy, kind), "choice", tip)
            for kind, tip in (("JSON", tooltip("explore.copy-json")), ("TOML", "Every parameter as TOML for --set"))
        )
        self.sheet_button = SheetButton("explore")
        self.identify_button = make_button("Identify …", None, "choice", tooltip("identification"), "explore.identify")
        tip = "Which added mass for a natural frequency, and which drive for an amplitude"
        self.design_button = make_button("Design …", None, "choice", tip, checkable=True)
        self.run_chips: dict[Path, QPushButton] = {}
        """A button for each overlaid run, which shows its result."""
        self._build()

    def _build(self) -> None:
        self.side.hide()  # until the page is too narrow
        self.runs_row = WrappedRow(spacing=4)
        self.start_row = row(self.skin, self.preset_box, None, self.undo_button, self.redo_button, spacing=6)
        self.export_row = row(
            self.copy_json_button, self.copy_toml_button, self.study_button, self.sheet_button, None, spacing=6
        )
        self.series_row = WrappedRow(self.side, *self.series, self.ranges, self.keep_button, spacing=8)
        put_inside(self.frequency, QLabel("Hz"))
        self.overlay_row = WrappedRow(
            self.overlay_button,
            self.file_button,
            self.fit_button,
            self.identify_button,
            self.design_button,
            self.clear_button,
        )

    def offer_laboratory(self, offered: bool) -> None:
        """Offer the threshold of the laboratory file, and choose it; or no longer."""
        at = self.site_box.findText(LABORATORY_SITE)
        if offered and at < 0:
            self.site_box.addItem(LABORATORY_SITE)
            self.site_box.setCurrentText(LABORATORY_SITE)
        elif not offered and at >= 0:
            self.site_box.removeItem(at)

    def toggle_skin(self) -> None:
        self.skin.buttons[not self.skin.selected].click()

    def show_setting(self, setting: ExploreSetting, history: UndoHistory[ExploreSetting]) -> None:
        """Show whether the tactor is on the skin, and enable undo and redo."""
        self.skin.select(setting.on_skin)
        self.undo_button.setEnabled(history.can_undo)
        self.redo_button.setEnabled(history.can_redo)

    def show_frequency(self, hz: float) -> None:
        if not self.frequency.hasFocus():
            self.frequency.setText(f"{hz:.4g}")

    def show_runs(self, runs: Sequence[MeasuredResponse]) -> None:
        """Show two buttons for each overlaid run: one shows its result, one takes it away."""
        chosen = self.chosen_run
        clear_layout(self.runs_row)
        self.run_chips = {}
        for run in runs:
            tip, is_chosen = f"{run.path}: show its result", run.path == chosen
            chip = make_button(run.label, None, "choice", tip, checkable=True, checked=is_chosen)
            chip.clicked.connect(lambda checked, path=run.path: self._choose_run(path if checked else None))
            tip = f"Take {run.label} away"
            removing = make_button("✕", partial(self._page.overlaid.remove, run), "choice", tip, accessibleName=tip)
            self.runs_row.addWidget(make_pane(row(chip, removing, spacing=0)))
            self.run_chips[run.path] = chip
        if chosen is not None and chosen not in self.run_chips:
            self._page.show_result_of(None)

    @property
    def chosen_run(self) -> Path | None:
        """Path of the overlaid run whose result is shown."""
        return next((path for path, chip in self.run_chips.items() if chip.isChecked()), None)

    def _choose_run(self, path: Path | None) -> None:
        for each, chip in self.run_chips.items():
            chip.setChecked(each == path)
        self._page.show_result_of(path)

    def _on_preset(self, index: int) -> None:
        if name := self.preset_box.itemData(index):
            self._page.load_preset(name)

    def _on_frequency(self) -> None:
        try:
            hz = to_number(self.frequency.text(), "Hz")
        except UnitError:
            hz = float("nan")
        if 1 <= hz <= RANGES_HZ[-1]:
            self._page.plot.tools.set_cursor(hz)
