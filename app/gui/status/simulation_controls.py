"""Controls of the simulated bench: its speed, and who answers its prompts."""

from collections.abc import Callable

from PySide6.QtWidgets import QWidget

from app.gui.face import set_length
from app.gui.widgets import Segments, column, make_label, row
from app.session import AnsweredBy, SimulationSettings, WindowState

SPEEDS: tuple[float | None, ...] = (1.0, 5.0, 20.0, None)
ANSWERED_BY = {
    AnsweredBy.USER: "You answer",
    AnsweredBy.USER_IN_CAMPAIGN: "You in campaigns",
    AnsweredBy.SIMULATION: "Simulated",
}


class SimulationControls(QWidget):
    """Choices of speed, and of who answers prompts.

    Args:
        settings: shown and changed; there may be several such controls.
        change_speed: connects the bench at another speed; None is the virtual clock.
        name: beginning of the object names.
    """

    def __init__(
        self, settings: SimulationSettings, change_speed: Callable[[float | None], object], name: str = "simulation"
    ) -> None:
        super().__init__()
        self._settings = settings
        self.speeds = Segments(
            f"{name}.speed", "speed", (("max" if each is None else f"{each:g}×", each) for each in SPEEDS)
        )
        for speed in SPEEDS:
            self.speeds.buttons[speed].setToolTip(_speed_tip(speed))
        self.speeds.chosen.connect(change_speed)
        self.answered_by = Segments(
            f"{name}.answered-by", "who answers prompts", ((text, each) for each, text in ANSWERED_BY.items())
        )
        self.answered_by.setToolTip(
            "Practise the actions of prompts: an answer performs the action on the simulated bench"
        )
        self.answered_by.chosen.connect(self.choose_answered_by)
        rows = []
        for text, segments in (("Speed", self.speeds), ("Prompts", self.answered_by)):
            label = make_label(text, wrap=False)
            set_length(label, width=56)
            rows.append(row(label, (segments, 1), spacing=8))
        column(*rows, parent=self, spacing=8)
        self._show_settings()

    @property
    def first_widget(self) -> QWidget:
        """The widget that takes the keyboard first: the present speed."""
        return self.speeds.buttons.get(self._settings.speed) or self.speeds.buttons[SPEEDS[0]]

    def set_state(self, view: WindowState) -> None:
        """Allow a change of speed between runs; the virtual clock does not wait for a person."""
        for button in self.speeds.buttons.values():
            button.setEnabled(view.can_run)
        self.answered_by.setEnabled(self._settings.speed is not None)
        self._show_settings()

    def choose_answered_by(self, who: AnsweredBy) -> None:
        """Let somebody else answer prompts."""
        self._settings.answered_by = who
        self._show_settings()

    def on_list_opened(self) -> None:
        """Let the user answer from now on: who looks at faults practises what is asked then."""
        if self._settings.answered_by is AnsweredBy.USER_IN_CAMPAIGN:
            self.choose_answered_by(AnsweredBy.USER)

    def _show_settings(self) -> None:
        self.speeds.select(self._settings.speed)
        self.answered_by.select(self._settings.answered_by)


def _speed_tip(speed: float | None) -> str:
    if speed is None:
        return "As fast as this computer can, without waiting; the bench is connected again"
    return f"{speed:g} bench seconds in a second; the bench is connected again"
