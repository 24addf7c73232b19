"""What a person must do now: large words, a drawing of the set-up, what the laser sees, and one key for each answer."""

from PySide6.QtCore import Qt, Signal
from PySide6.QtGui import QShortcut
from PySide6.QtWidgets import QHBoxLayout, QLabel, QPushButton, QWidget

from app.gui.bench.notice import Choice, Notice
from app.gui.bench.setup_drawing import SetupDrawing
from app.gui.widgets.form import mark
from app.gui.widgets.shortcuts import bind
from protocols.base.events import Asked


class PromptNotice(Notice):
    """Shows one prompt at a time. Enter is its first answer; every other one has its first letter for a key."""

    chosen = Signal(str)
    stopped = Signal()

    def __init__(self, parent: QWidget | None = None) -> None:
        super().__init__((Choice("Stop   (Esc)", self._stop, "stop"),), "prompt", "hand", parent)
        self._stop_button = self.buttons.pop()
        self._asked: Asked | None = None
        self._keys: list[QShortcut] = []
        self.drawing = SetupDrawing()
        self.laser = QLabel()
        mark(self.laser, "laser")
        self.laser.setMinimumWidth(self.laser.fontMetrics().horizontalAdvance("laser −0000.0 µm") * 2)
        self.laser.setAlignment(Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter)
        self.row.insertWidget(1, self.drawing)
        self.row.insertWidget(3, self.laser)
        self._answers = QHBoxLayout()
        self._answers.addStretch()
        self.row.removeWidget(self._stop_button)
        self._answers.addWidget(self._stop_button)
        self.text.addLayout(self._answers)

    def ask(self, asked: Asked | None) -> bool:
        """Show a prompt, or none; whether it is another one than before."""
        if asked == self._asked and self.isHidden() == (asked is None):
            return False
        self._asked = asked
        for key in self._keys:
            key.setEnabled(False)
            key.deleteLater()
        for button in self.buttons:
            button.hide()
            button.deleteLater()
        self._keys, self.buttons = [], []
        prompt = asked.prompt if asked is not None else None
        for at, words in enumerate(prompt.choices if prompt is not None else ()):
            self._add(words, "Enter" if at == 0 else words[0].upper())
        drawn = prompt is not None and self.drawing.show_prompt(prompt)
        self.drawing.setVisible(drawn)
        self.symbol.setVisible(not drawn)
        self.say(prompt.text if prompt is not None else "")
        return True

    def show_laser(self, displacement_um: float | None) -> None:
        """What the laser sees now."""
        words = "" if displacement_um is None else f"laser {round(displacement_um, 1) + 0.0:+.1f} µm".replace("-", "−")
        self.laser.setText(words)
        self.laser.setVisible(bool(words) and self._asked is not None and self._asked.prompt.hands_on)

    def _add(self, words: str, key: str) -> None:
        button = QPushButton(f"{words[:1].upper()}{words[1:]}   ({key})")
        button.clicked.connect(lambda: self.chosen.emit(words))
        self._answers.insertWidget(self._answers.count() - 2, button)
        button.show()  # in a notice that is seen already it would only be shown later, and Enter be off until then
        self.buttons.append(button)
        if key != "Enter":
            self._keys += bind(self, f"Answer: {words}", button.click, key)

    def _stop(self) -> None:
        self.stopped.emit()
