"""The buttons around the Explore page: where to begin, what is drawn, which runs lie over it, and how numbers leave."""

from collections.abc import Callable, Mapping, Sequence

from PySide6.QtCore import QObject, QSignalBlocker, Signal
from PySide6.QtWidgets import (
    QButtonGroup,
    QCheckBox,
    QComboBox,
    QHBoxLayout,
    QLabel,
    QLineEdit,
    QPushButton,
    QWidget,
)

from app.archive.replay import Measured
from app.common.undo import History
from app.common.units import UnitError, to_number
from app.explore.state import Setting

RANGES_HZ = (250, 500, 1000, 4000)
SERIES = ("max − min", "2 × fundamental", "phase", "log")


class ExploreBar(QObject):
    """Holds the buttons; the page lays its rows out where they belong."""

    preset_chosen = Signal(str)
    skin_chosen = Signal(bool)
    frequency_chosen = Signal(float)
    range_chosen = Signal(float)
    series_changed = Signal()
    copy_chosen = Signal(str)

    def __init__(self, presets: Mapping[str, str], fits: bool, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.presets = QComboBox()
        self.presets.addItem("Begin from …")
        for name, title in presets.items():
            self.presets.addItem(title, name)
        self.presets.setAccessibleName("begin from")
        self.presets.activated.connect(self._preset)
        self.free, self.skin = _choice("Free", "The tactor vibrates freely"), _choice("On skin", "On the membrane")
        self._where = QButtonGroup(self)
        for button in (self.free, self.skin):
            self._where.addButton(button)
        self.skin.toggled.connect(self.skin_chosen)
        self.undo, self.redo = (
            _button(text, tip) for text, tip in (("↶", "Undo: Ctrl+Z"), ("↷", "Redo: Ctrl+Shift+Z"))
        )
        self.undo.setAccessibleName("undo")
        self.redo.setAccessibleName("redo")
        self.series = [QCheckBox(words) for words in SERIES]
        self.series[0].setChecked(True)
        for box in self.series:
            box.toggled.connect(self.series_changed)
        self.frequency = QLineEdit("160")
        self.frequency.setFixedWidth(64)
        self.frequency.setToolTip("Frequency whose motion is shown; the dotted line can be dragged, too")
        self.frequency.setAccessibleName("frequency of the motion in Hz")
        self.frequency.editingFinished.connect(self._frequency)
        self.ranges = [_choice(f"{hz:g}", f"Frequencies up to {hz:g} Hz") for hz in RANGES_HZ]
        self._group = QButtonGroup(self)
        for hz, button in zip(RANGES_HZ, self.ranges, strict=True):
            self._group.addButton(button)
            button.clicked.connect(lambda _=False, hz=hz: self.range_chosen.emit(float(hz)))
        self.ranges[0].setChecked(True)
        self.keep = _button("Keep curve", "Let the present curve stay while the sliders move on: Ctrl+Shift+K")
        self.clear = _button("Clear", "Take kept curves and measured runs away")
        self.lay = _button("Lay a run over …", "Measured points over the curves: Ctrl+O, or drop files here")
        self.fit = _button("Fit these", "Let the sliders go where the runs are met best: Ctrl+F")
        if not fits:  # shown before it has a place it would be a window of its own
            self.fit.hide()
        self.study = _button(
            "Save study …", "What the kept curves vary, or else the slider moved last, as HDF5 or CSV: Ctrl+S"
        )
        self.copy_json = _button("Copy JSON", "Every parameter as JSON for --set: Ctrl+Shift+C")
        self.copy_toml = _button("Copy TOML", "Every parameter as TOML for --set")
        self.copy_json.clicked.connect(lambda: self.copy_chosen.emit("JSON"))
        self.copy_toml.clicked.connect(lambda: self.copy_chosen.emit("TOML"))
        self._chips = QHBoxLayout()
        self._chips.setSpacing(4)
        self.chips: list[QPushButton] = []

    def elsewhere(self) -> None:
        """From free to the skin, or back."""
        (self.free if self.skin.isChecked() else self.skin).click()

    def show_setting(self, setting: Setting, history: History[Setting]) -> None:
        """Tell where the tactor is, and whether there is a way back."""
        for button, there in ((self.free, not setting.on_skin), (self.skin, setting.on_skin)):
            with QSignalBlocker(button):
                button.setChecked(there)
        self.undo.setEnabled(history.can_undo)
        self.redo.setEnabled(history.can_redo)

    def show_frequency(self, hz: float) -> None:
        if not self.frequency.hasFocus():
            self.frequency.setText(f"{hz:.4g}")

    def show_measured(self, measured: Sequence[Measured], drop: Callable[[Measured], None]) -> None:
        """A button for each run laid over; pressing it takes the run away."""
        for chip in self.chips:
            self._chips.removeWidget(chip)
            chip.deleteLater()
        self.chips = []
        for run in measured:
            chip = _choice(f"{run.label}  ✕", f"{run.path}: press to take it away")
            chip.setCheckable(False)
            chip.clicked.connect(lambda _=False, run=run: drop(run))
            self._chips.addWidget(chip)
            self.chips.append(chip)

    def show_fitting(self, fitting: bool) -> None:
        """The button that fits is the one that cancels while it does."""
        self.fit.setText("Cancel the fit" if fitting else "Fit these")

    def start(self) -> QHBoxLayout:
        """Preset, free or on skin, undo and redo."""
        return _row(self.presets, self.free, self.skin, None, self.undo, self.redo)

    def leave(self) -> QHBoxLayout:
        return _row(self.copy_json, self.copy_toml, self.study, None)

    def head(self) -> QHBoxLayout:
        """What is drawn."""
        caption = QLabel("Response")
        caption.setProperty("kind", "caption")
        return _row(
            caption, *self.series, None, QLabel("up to"), *self.ranges, QLabel("Hz"),
        )  # fmt: skip

    def motion(self) -> QHBoxLayout:
        """Which motion is shown."""
        caption = QLabel("Motion")
        caption.setProperty("kind", "caption")
        return _row(caption, QLabel("at"), self.frequency, QLabel("Hz"), None)

    def runs(self) -> QHBoxLayout:
        """Kept curves and measured runs."""
        row = _row(self.keep, self.lay, self.fit)
        row.addLayout(self._chips)
        row.addStretch()
        row.addWidget(self.clear)
        return row

    def _preset(self, at: int) -> None:
        if name := self.presets.itemData(at):
            self.preset_chosen.emit(name)

    def _frequency(self) -> None:
        try:
            hz = to_number(self.frequency.text(), "Hz")
        except UnitError:
            hz = float("nan")
        if 1 <= hz <= RANGES_HZ[-1]:
            self.frequency_chosen.emit(hz)


def _row(*items: QWidget | None) -> QHBoxLayout:
    row = QHBoxLayout()
    row.setSpacing(6)
    for item in items:
        if item is None:
            row.addStretch()
        else:
            row.addWidget(item)
    return row


def _button(text: str, tip: str) -> QPushButton:
    button = QPushButton(text)
    button.setToolTip(tip)
    button.setProperty("kind", "choice")
    return button


def _choice(text: str, tip: str) -> QPushButton:
    button = _button(text, tip)
    button.setCheckable(True)
    return button
