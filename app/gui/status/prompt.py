"""Operator prompt: instruction, drawing of the set-up, laser reading and answers."""

from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction

from app.gui.status.notice import Notice
from app.gui.status.setup_drawing import SetupDrawing
from app.gui.widgets import STRETCH, ActionInfo, add_action, make_button, make_label, row, shortcut_label
from protocols.base import PromptShown


class PromptNotice(Notice):
    """Shows one prompt at a time. Enter gives its first answer; each other answer has its first letter as shortcut."""

    def __init__(self, on_answer: Callable[[str], object], on_stop: Callable[[], object]) -> None:
        super().__init__("notices.prompt", "prompt", "hand")
        self._on_answer = on_answer
        self._prompt: PromptShown | None = None
        self._answer_actions: list[QAction] = []
        self.drawing = SetupDrawing()
        self.laser_label = make_label(
            kind="laser",
            wrap=False,
            name="prompt.laser",
            alignment=Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter,
        )
        self.laser_label.setMinimumWidth(self.laser_label.fontMetrics().horizontalAdvance("laser −0000.0 µm") * 2)
        self.row.insertWidget(1, self.drawing)
        self.row.addWidget(self.laser_label)
        stop_button = make_button(shortcut_label("Stop", "escape"), on_stop, "stop", name="prompt.stop")
        self._answer_row = row(STRETCH, stop_button)
        self.text_layout.addLayout(self._answer_row)

    def show_prompt(self, event: PromptShown | None) -> bool:
        """Show a prompt or none, and return whether it changed."""
        if event == self._prompt and self.isHidden() == (event is None):
            return False
        self._prompt = event
        for action in self._answer_actions:
            self.removeAction(action)
            action.deleteLater()
        for button in self.buttons:
            button.hide()
            button.deleteLater()
        self._answer_actions, self.buttons = [], []
        prompt = event.prompt if event is not None else None
        for at, choice in enumerate(prompt.choices if prompt is not None else ()):
            self._add_answer(choice, "Enter" if at == 0 else choice[0].upper())
        drawn = prompt is not None and self.drawing.show_prompt(prompt)
        self.drawing.setVisible(drawn)
        self.symbol.setVisible(not drawn)
        self.show_message(prompt.text if prompt is not None else "")
        return True

    def show_laser(self, displacement_um: float | None) -> None:
        """Show the present laser reading."""
        text = "" if displacement_um is None else f"laser {round(displacement_um, 1) + 0.0:+.1f} µm".replace("-", "−")
        self.laser_label.setText(text)
        self.laser_label.setVisible(bool(text) and self._prompt is not None and self._prompt.prompt.hands_on)

    def _add_answer(self, choice: str, key: str) -> None:
        label = f"{choice[:1].upper()}{choice[1:]}   ({key})"
        button = make_button(label, partial(self._on_answer, choice), name=f"answer.{choice}")
        self._answer_row.insertWidget(self._answer_row.count() - 2, button)
        button.show()  # in a notice that is seen already it would only be shown later, and Enter be off until then
        self.buttons.append(button)
        if key != "Enter":
            info = ActionInfo(f"answer.{choice}", f"Answer: {choice}", (key,))
            self._answer_actions.append(add_action(self, info, button.click))
