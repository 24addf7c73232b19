"""Prompt card: what the operator does now, a drawing of it, the sensor's value and the answers."""

import math
import time
from collections.abc import Callable
from functools import partial

from PySide6.QtCore import Qt
from PySide6.QtGui import QAction
from PySide6.QtWidgets import QFrame, QPushButton, QWidget

from app.common import sentence_case, typeset
from app.gui.status.setup_drawing import SetupDrawing
from app.gui.widgets import (
    ActionInfo,
    IconView,
    OverlayCard,
    add_action,
    column,
    configure,
    make_button,
    make_label,
    row,
    set_style_kind,
    show_text,
)
from model import GRAVITY, Tactor
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Prompt, PromptShown

INPUT_GUARD_S = 0.5
"""An answer is ignored for this long after a question appeared: it was meant for something else."""

WEIGHING, LANDED_UM = ("place-weight", "remove-weight"), 2.0
"""Least change of the sensor's value when a weight is placed or taken off."""

ACTS = {DISABLE_HIGH_VOLTAGE.action: "Switch high voltage OFF", ENABLE_HIGH_VOLTAGE.action: "Switch high voltage ON"}
"""Acts of prompts whose text does not begin with it; the whole text stands below."""

ACT_LENGTH = 44
"""Largest number of characters of an act in the large size; longer ones are shown in the size of headings."""


class PromptCard(OverlayCard):
    """Shows one prompt at a time. Enter gives its first answer; each other answer has its first letter as shortcut.

    Args:
        on_answer: takes the answer.
    """

    def __init__(self, on_answer: Callable[[str], object]) -> None:
        self._on_answer = on_answer
        self._prompt: PromptShown | None = None
        self._answer_actions: list[QAction] = []
        self._shown_at_s = -math.inf
        self._laser_um: float | None = None
        self._laser_at_start_um: float | None = None
        self._asked_again = self._simulated = False
        self.buttons: list[QPushButton] = []
        self.head = configure(QFrame(), "prompt.head", kind="attention")
        title = make_label("Your turn", "heading", wrap=False)
        self.note_label = make_label(wrap=False, name="prompt.note")
        for label in (title, self.note_label):
            label.setProperty("on", "amber")
        hand = IconView(20, "hand", "#000000")
        row(hand, title, None, self.note_label, parent=self.head, margins=(16, 10, 16, 10), spacing=8)
        self.drawing = SetupDrawing()
        self.message_label = make_label(kind="act", name="notices.prompt.message")
        self.detail_label = make_label(kind="large", name="notices.prompt.detail")
        self.laser_label = make_label(kind="present", wrap=False, name="prompt.laser")
        self.laser_note = make_label(kind="note", wrap=False, name="prompt.laser-note")
        self.then_label = make_label(kind="note", wrap=False, name="prompt.then")
        self.again_label = make_label(kind="caution", name="prompt.again", visible=False)
        content = QWidget()
        super().__init__("notices.prompt", content, edge="amber_text", closable=False)
        laser = row(self.laser_label, self.laser_note, None, spacing=12)
        texts = column(self.message_label, self.detail_label, None, laser, self.again_label, spacing=8)
        self._answer_row = row(None, self.then_label, spacing=12)
        column(
            self.head,
            row((self.drawing, 0, Qt.AlignmentFlag.AlignTop), (texts, 1), margins=(20, 16, 20, 12), spacing=24),
            row((self._answer_row, 1), margins=(20, 0, 20, 16)),
            parent=content,
        )

    @property
    def accepts_input(self) -> bool:
        """Whether the prompt has been visible long enough to be read."""
        return time.monotonic() - self._shown_at_s >= INPUT_GUARD_S

    def show_prompt(self, event: PromptShown | None, note: str = "", simulated: bool = False, then: str = "") -> bool:
        """Show a prompt or none, and return whether it changed."""
        if event == self._prompt and self.isHidden() == (event is None):
            return False
        self._prompt, self._simulated, self._asked_again = event, simulated, False
        self._laser_at_start_um = self._laser_um
        for action in self._answer_actions:
            self.removeAction(action)
            action.deleteLater()
        for button in self.buttons:
            button.hide()
            button.deleteLater()
        self._answer_actions, self.buttons = [], []
        self.again_label.hide()
        if event is None:
            self.dismiss()
            return True
        prompt = event.prompt
        act, detail = (ACTS[prompt.action], prompt.text) if prompt.action in ACTS else _split(prompt.text)
        self.message_label.setText(act)
        set_style_kind(self.message_label, "act" if len(act) <= ACT_LENGTH else "heading")
        show_text(self.detail_label, detail)
        self.note_label.setText(note)
        self.then_label.setText(f"Then: {then}" if then else "")
        moved_um = _moved_um(prompt)
        self.laser_note.setText("laser now" + f"; moves by about {moved_um:g} µm" * bool(moved_um))
        for at, choice in enumerate(prompt.choices):
            self._add_answer(choice, "Enter" if at == 0 else choice[0].upper())
        self.drawing.setVisible(self.drawing.show_prompt(prompt))
        self._shown_at_s = time.monotonic()
        self.open()
        return True

    def show_laser(self, displacement_um: float | None) -> None:
        if displacement_um == self._laser_um:
            return
        self._laser_um = displacement_um
        if self._prompt is None:
            return
        if self._laser_at_start_um is None:
            self._laser_at_start_um = displacement_um
        text = "" if displacement_um is None else typeset(f"{displacement_um:+z.1f} µm")
        shown = bool(text) and self._prompt.prompt.hands_on
        self.laser_label.setText(text)
        self.laser_label.setVisible(shown)
        self.laser_note.setVisible(shown)

    def _answer(self, choice: str) -> None:
        if not self.accepts_input:
            return
        if self._prompt is not None and choice == self._prompt.prompt.choices[0] and self._saw_nothing():
            self._asked_again = True
            show_text(
                self.again_label, "The laser has seen nothing move. If it is done all the same, answer once more."
            )
            return
        self._on_answer(choice)

    def _saw_nothing(self) -> bool:
        """Whether a weight was to be moved and the sensor has seen nothing; a simulated one moves after the answer."""
        if self._asked_again or self._simulated or self._prompt is None:
            return False
        now, start = self._laser_um, self._laser_at_start_um
        return (
            self._prompt.prompt.action in WEIGHING
            and now is not None
            and start is not None
            and abs(now - start) < LANDED_UM
        )

    def _add_answer(self, choice: str, key: str) -> None:
        is_first = key == "Enter"
        kind, act = "go" if is_first else "main", partial(self._answer, choice)
        button = make_button(sentence_case(choice), act, kind, name=f"answer.{choice}", key=key)
        self._answer_row.insertWidget(len(self.buttons), button)
        button.show()  # in a card that is seen already it would only be shown later, and Enter be off until then
        self.buttons.append(button)
        if not is_first:
            info = ActionInfo(f"answer.{choice}", f"Answer: {choice}", (key,))
            self._answer_actions.append(add_action(self, info, button.click))


def _moved_um(prompt: Prompt) -> float:
    """Return to two digits how far the weight of a prompt bends the paper's tactor; 0 without one."""
    from model.response import load_compliance  # slow to import, and not needed when the window opens

    weight_n = GRAVITY * prompt.values.get("mass_kg", 0.0) * (prompt.action in WEIGHING)
    return float(f"{1e6 * weight_n * load_compliance(Tactor()):.2g}")


def _split(text: str) -> tuple[str, str]:
    """Return the act, which is the first sentence or clause, and the remaining text."""
    for mark in (". ", "; ", ": "):
        act, found, detail = text.partition(mark)
        if found and len(act) > 8:
            return act, sentence_case(detail)
    return text.removesuffix("."), ""
