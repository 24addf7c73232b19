"""Design panel of the Explore page: the added mass for a resonance, the drive for an amplitude and its power, answered in the background."""

from typing import TYPE_CHECKING

from PySide6.QtCore import Signal
from PySide6.QtWidgets import QComboBox, QLabel, QWidget

from app.common import UnitError, to_number
from app.explore import DesignAnswers, DesignQuestion, answer_design
from app.gui.face import set_length
from app.gui.widgets import WrappedRow, at_end, column, fill_combo, make_combo, make_label, make_line_edit
from app.live import LatestOnlyWorker

if TYPE_CHECKING:
    from app.gui.explore.page import ExplorePage

SLIDERS_TEXT = "the sliders"
FIELD_WIDTH = 76


class DesignPanel(QWidget):
    """Asks while it is visible, anew when a field, the source or a slider changes.

    Args:
        page: has the setting of the sliders, and returns folder and name of the specimen that is shown.
    """

    _answered = Signal(object, object)

    def __init__(self, page: "ExplorePage") -> None:
        super().__init__(page)
        self._page = page
        self._question: DesignQuestion | None = None
        self._worker = LatestOnlyWorker(answer_design, self._answered.emit, "explore design")
        at_end(self, self._worker.close)
        self.resonance, self.amplitude, self.frequency = (
            make_line_edit(f"explore.design.{name}", about, text=text)
            for name, text, about in (
                ("resonance", "160 Hz", "natural frequency that the added mass is to give"),
                ("amplitude", "100 µm", "peak-to-peak displacement that the drive is to give"),
                ("frequency", "200 Hz", "frequency of the drive"),
            )
        )
        self.source_box = make_combo(
            "explore.design.source",
            "specimen of the answers",
            [(SLIDERS_TEXT, None)],
            toolTip="The calibration gives the uncertainties; the sliders have none",
            sizeAdjustPolicy=QComboBox.SizeAdjustPolicy.AdjustToContents,
        )
        self.mass_label, self.drive_label, self.power_label = (
            make_label(name=f"explore.design.{each}") for each in ("mass", "drive", "power")
        )
        self.source_label = make_label(kind="note", name="explore.design.about")
        for edit in (self.resonance, self.amplitude, self.frequency):
            set_length(edit, width=FIELD_WIDTH)
            edit.editingFinished.connect(self.ask)
        self.source_box.currentIndexChanged.connect(lambda _: self.ask())
        fields = WrappedRow(
            make_label("Design", "caption", wrap=False), QLabel("of"), self.source_box, QLabel("which added mass for"), self.resonance,
            QLabel("which drive for"), self.amplitude, QLabel("at"), self.frequency, spacing=6,
        )  # fmt: skip
        column(fields, self.mass_label, self.drive_label, self.power_label, self.source_label, parent=self, spacing=2)
        self._answered.connect(self._show)
        self.hide()

    def ask(self) -> None:
        """Compute the answer to the fields, if the panel is visible and a value has changed."""
        if self.isHidden():
            return
        name = self._page.specimen()[1]
        self._offer(f"the calibration of {name}" if name else "")
        try:
            question = DesignQuestion(
                self._page.model.setting,
                to_number(self.resonance.text(), "Hz"),
                to_number(self.amplitude.text(), "m"),
                to_number(self.frequency.text(), "Hz"),
                self._page.specimen() if self.source_box.currentIndex() > 0 else None,
            )
        except UnitError as error:
            self._show_texts("", "", "", str(error))
            return
        if question != self._question:
            self._question = question
            self.source_label.setText("computing …")
            self._worker.submit(question)

    def toggle(self, shown: bool) -> None:
        """Show or hide the panel; the calibration is read anew when it is shown."""
        self.setVisible(shown)
        self._question = None
        self.ask()

    def _offer(self, calibration: str) -> None:
        """Offer the sliders, and a calibration, which is chosen when it is new; empty for none."""
        is_new = self.source_box.count() == 1
        choices = [(SLIDERS_TEXT, None), *([(calibration, True)] if calibration else [])]
        fill_combo(self.source_box, choices, is_new or None)

    def _show(self, question: DesignQuestion, answers: DesignAnswers | Exception) -> None:
        if question != self._question:
            return
        if isinstance(answers, Exception):
            self._show_texts("", "", "", str(answers))
        else:
            self._show_texts(answers.mass, answers.drive, answers.power, answers.source)

    def _show_texts(self, *texts: str) -> None:
        labels = (self.mass_label, self.drive_label, self.power_label, self.source_label)
        for label, text in zip(labels, texts, strict=True):
            label.setText(text)
