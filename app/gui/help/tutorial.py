"""Tutorials in the window: a band with one step at a time, ticked when the window shows that it was done; hints of the first run."""

import tomllib
from collections.abc import Callable
from importlib.resources import files

from pydantic import BaseModel
from PySide6.QtWidgets import QWidget

from app.gui.widgets import OverlayCard, Place, column, make_button, make_label, row
from app.session import BenchState, WindowState
from protocols import WIRING_CHECK
from protocols.base import Outcome

CONDITIONS: dict[str, Callable[[WindowState], bool]] = {
    "live": lambda view: view.bench_state is BenchState.LIVE,
    "good": lambda view: view.outcome is not None and view.outcome.verdict.outcome is Outcome.GOOD,
    "wiring good": lambda view: view.protocol == WIRING_CHECK and CONDITIONS["good"](view),
    "unsafe": lambda view: bool(view.unsafe),
    "safe again": lambda view: view.can_run and not view.unsafe and view.bench_state is not BenchState.UNSAFE,
    "real bench": lambda view: view.connected and not view.simulated,
}
"""Conditions under which a step is done, by the state of the window."""


class Step(BaseModel):
    """One step: instruction, and the page or condition that completes it; without both only the reader can tick it."""

    text: str
    page: str = ""
    done: str = ""

    def is_done(self, view: WindowState, page: str) -> bool:
        """Whether the window shows that it was done."""
        return page == self.page or (self.done in CONDITIONS and CONDITIONS[self.done](view))


class Tutorial(BaseModel):
    """A title and its steps."""

    title: str
    steps: tuple[Step, ...]


TUTORIALS = {
    name: Tutorial(**each)
    for name, each in tomllib.loads(files("app.gui.help").joinpath("tutorials.toml").read_text("utf-8")).items()
}
"""The tutorials by name."""


class TutorialBand(OverlayCard):
    """The current step of a tutorial, over the page; hidden while no tutorial is open."""

    def __init__(self) -> None:
        super().__init__("tutorial", QWidget(), Place.HINT, closable=False)
        self._name, self._at, self._done = "", 0, False
        self._view: WindowState | None = None
        self._page = ""
        self.title_label = make_label(kind="caption", wrap=False, name="tutorial.title")
        self.text_label = make_label(kind="hint", name="tutorial.text")
        self.back_button = make_button("&Back", lambda: self._go(-1), "choice", name="tutorial.back")
        self.next_button = make_button("&Next", lambda: self._go(1), "choice", name="tutorial.next")
        close = make_button("Close", self.close_tutorial, "choice", "Help has it again", "tutorial.close")
        head = row((self.title_label, 1), self.back_button, self.next_button, close, spacing=6)
        column(head, self.text_label, parent=self.content, margins=(16, 10, 16, 12), spacing=4)
        self.setAccessibleName("tutorial")

    @property
    def position(self) -> str:
        """The tutorial and its step, for `resume`; empty while no tutorial is open."""
        return f"{self._name}:{self._at}" if self._name else ""

    def start(self, name: str, at: int = 0) -> None:
        """Show a tutorial from a step on."""
        self._name, self._at, self._done = name, at, False
        self.open()
        self._show_step()

    def resume(self, position: str) -> None:
        """Show the step of a saved position, if there is one."""
        name, _, at = position.partition(":")
        if name in TUTORIALS and at.isdigit() and int(at) < len(TUTORIALS[name].steps):
            self.start(name, int(at))

    def close_tutorial(self) -> None:
        self._name = ""
        self.dismiss()

    def set_state(self, view: WindowState) -> None:
        """Tick the step if the window shows that it was done."""
        self._view = view
        self._check()

    def set_page(self, title: str) -> None:
        """Tick the step if the page shows that it was done."""
        self._page = title
        self._check()

    def _go(self, by: int) -> None:
        at = self._at + by
        if at >= len(TUTORIALS[self._name].steps):
            self.close_tutorial()
        elif at >= 0:
            self._at, self._done = at, False
            self._show_step()
            self._check()

    def _check(self) -> None:
        if not self._name or self._done or self._view is None:
            return
        if TUTORIALS[self._name].steps[self._at].is_done(self._view, self._page):
            self._done = True
            self._show_step()

    def _show_step(self) -> None:
        tutorial = TUTORIALS[self._name]
        count = len(tutorial.steps)
        self.title_label.setText(f"{tutorial.title}: step {self._at + 1} of {count}{'   ✓ done' if self._done else ''}")
        self.text_label.setText(tutorial.steps[self._at].text)
        self.back_button.setEnabled(self._at > 0)
        self.next_button.setText("&Finish" if self._at == count - 1 else "&Next")


WAITING_TEXT = "The bench is connecting; the measurement then starts automatically."
RUNNING_TEXT = (
    "The generator plays one frequency after the other, and each point falls on the model's curve. "
    "Esc stops at any time and brings the bench to rest."
)
FINISHED_TEXT = "Finished, and the bench is at rest. The run is stored: Ctrl+4 lists it, Enter opens it. F5 measures again; F1 lists every key."
ENDED_TEXT = "The run ended: {summary}. F5 measures again; F1 lists every key."


class FirstRunHint(OverlayCard):
    """Hint for the first run, hidden until `start`."""

    def __init__(self) -> None:
        super().__init__("hint", QWidget(), Place.HINT, closable=False)
        self._run_finished = False
        self.label = make_label(kind="hint", name="hint.text")
        dismiss = make_button("Got it", self.dismiss, "choice", name="hint.dismiss")
        row((self.label, 1), dismiss, parent=self.content, margins=(16, 10, 16, 12))

    def start(self) -> None:
        """Show the hint for the next run."""
        self._run_finished = False
        self.label.setText(WAITING_TEXT)
        self.open()

    def set_state(self, view: WindowState) -> None:
        """Show the text for the present stage of the run."""
        if self.isHidden():
            return
        if view.busy and self._run_finished:  # another run: the lesson is over
            self.dismiss()
        elif view.busy:
            self.label.setText(RUNNING_TEXT)
        elif (ended := view.outcome) is not None:
            self._run_finished = True
            good = ended.verdict.outcome is Outcome.GOOD
            self.label.setText(FINISHED_TEXT if good else ENDED_TEXT.format(summary=ended.summary))
