"""Controls of the simulated bench: its speed, and who answers its prompts."""

from collections.abc import Callable

from PySide6.QtCore import QSignalBlocker
from PySide6.QtWidgets import QButtonGroup, QLabel, QWidget

from app.gui.widgets import STRETCH, configure, make_choice, make_combo, row
from app.session import AnsweredBy, SimulationSettings, WindowState

SPEEDS: tuple[float | None, ...] = (1.0, 5.0, 20.0, None)


class SimulationControls(QWidget):
    """A row of speeds, and a list of who answers prompts.

    Args:
        settings: shown and changed; there may be several rows.
        change_speed: connects the bench at another speed; None is the virtual clock.
        name: beginning of the object names.
    """

    def __init__(
        self, settings: SimulationSettings, change_speed: Callable[[float | None], object], name: str = "simulation"
    ) -> None:
        super().__init__()
        self._settings = settings
        self.speed_buttons = {
            speed: configure(
                make_choice("max" if speed is None else f"{speed:g}×", _speed_tip(speed), checkable=True),
                f"{name}.speed-{'max' if speed is None else format(speed, 'g')}",
                accessibleName="virtual clock" if speed is None else f"{speed:g} times real speed",
            )
            for speed in SPEEDS
        }
        group = QButtonGroup(self)
        for speed, button in self.speed_buttons.items():
            group.addButton(button)
            button.clicked.connect(lambda _=False, speed=speed: change_speed(speed))
        self.answered_by_box = make_combo(
            f"{name}.answered-by",
            "who answers prompts",
            ((each, each) for each in AnsweredBy),
            toolTip="Practise the actions of prompts: an answer performs the action on the simulated bench",
        )
        self._show_settings()
        self.answered_by_box.currentIndexChanged.connect(self._on_answered_by)
        row(
            QLabel("Speed"),
            *self.speed_buttons.values(),
            16,
            QLabel("Prompts are answered by"),
            self.answered_by_box,
            STRETCH,
            parent=self,
            margins=(0, 0, 0, 4),
        )

    @property
    def first_widget(self) -> QWidget:
        """The widget that takes the keyboard first: the present speed."""
        shown = [button for button in self.speed_buttons.values() if button.isChecked()]
        return (shown or list(self.speed_buttons.values()))[0]

    def set_state(self, view: WindowState) -> None:
        """Allow a change of speed between runs; the virtual clock does not wait for a person."""
        for button in self.speed_buttons.values():
            button.setEnabled(view.can_run)
        self.answered_by_box.setEnabled(self._settings.speed is not None)
        self._show_settings()

    def _show_settings(self) -> None:
        for speed, button in self.speed_buttons.items():
            button.setChecked(speed == self._settings.speed)
        with QSignalBlocker(self.answered_by_box):
            self.answered_by_box.setCurrentIndex(self.answered_by_box.findData(self._settings.answered_by))

    def _on_answered_by(self) -> None:
        self._settings.answered_by = AnsweredBy(self.answered_by_box.currentData())


def _speed_tip(speed: float | None) -> str:
    if speed is None:
        return "As fast as this computer can, without waiting; the bench is connected again"
    return f"{speed:g} bench seconds in a second; the bench is connected again"
