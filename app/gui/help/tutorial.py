"""Tutorials in the window: a band with one step at a time, ticked when the window shows that it was done; hints of the first run."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtWidgets import QWidget

from app.gui.widgets import OverlayCard, Place, column, make_button, make_label, row
from app.session import BenchState, WindowState
from protocols.base import Outcome

IsDone = Callable[[WindowState, str], bool]
"""Whether a step is done, by the state of the window and the title of its page."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step: instruction, and test of its completion."""

    text: str
    is_done: IsDone | None = None
    """None for a step that only the reader can tick."""


@dataclass(frozen=True, slots=True)
class Tutorial:
    """A title and its steps."""

    title: str
    steps: tuple[Step, ...]


def _on_page(title: str) -> IsDone:
    return lambda _, page: page == title


TUTORIALS = {
    "tour": Tutorial(
        "Ten minutes on the simulated bench",
        (
            Step(
                "Press F9. Choose the speed 1× and let prompts be answered by 'me': you will do what an operator does. Press F9 again, and "
                "Ctrl+1 for the page Measure.",
                _on_page("Measure"),
            ),
            Step(
                "The protocol is Sine dwell, with the paper's 18 frequencies. Press F5. The program asks you to switch the high voltage off: "
                "Enter. It measures rest, then asks you to switch it on: Enter.",
                lambda view, _: view.bench_state is BenchState.LIVE,
            ),
            Step(
                "LIVE, in yellow and black: there is high voltage on the specimen. Each point falls on the model's curve. F8 pauses at rest "
                "and resumes, Esc stops. Wait for the end, half a minute.",
                lambda view, _: view.outcome is not None and view.outcome.verdict.outcome is Outcome.GOOD,
            ),
            Step(
                "AT REST in green was measured, not assumed. The result card has the verdict and the key figure: a natural frequency near 160 Hz, a "
                "damping ratio near 0.22, each with its standard error. Choose 'lower plot: residual' above the response: the points depart from the "
                "curve in a pattern. It is the paper's tactor, and this one has other values, creep and hysteresis."
            ),
            Step(
                "Now a fault. Press F5 and answer as before. When the sign says LIVE press F9 and tick 'The cable between generator and "
                "amplifier is off'. The amplifier's input is then pulled to 0 V, which is −500 V on the specimen.",
                lambda view, _: bool(view.unsafe),
            ),
            Step(
                "UNSAFE: no program can bring this bench to rest, and the message says what to do by hand, now. On a real bench you switch the "
                "high voltage off at the amplifier. Here: 'Clear all faults' (Shift+F9), F4 to acknowledge. The sign stays UNSAFE until a run has measured "
                "rest: F5, answer as before, and Esc when the sign is LIVE.",
                lambda view, _: view.can_run and not view.unsafe and view.bench_state is not BenchState.UNSAFE,
            ),
            Step(
                "Nothing measured was lost: press Ctrl+4. The list has all runs. Select a good one and press E: its points lie over the "
                "model's curve on the page Explore.",
                _on_page("Explore"),
            ),
            Step(
                "Press Ctrl+F: the model is fitted to the run, with hysteresis and creep, and each fitted value has its error. Then choose 'On skin' and move "
                "the slider 'stiffness k_s' for a stiffer skin. Ctrl+Z takes it back."
            ),
            Step(
                "A specimen's measurements, in the order in which they need each other, are a campaign: Ctrl+2. F1 explains every key and word, "
                "Ctrl+K finds commands, protocols, runs and settings by name."
            ),
        ),
    ),
    "own-bench": Tutorial(
        "Set up my own bench",
        (
            Step(
                "Read the safety notes first: F1, the group at the top. The amplifier's high voltage stays off until the last step. Press Ctrl+5 "
                "for the page Bench, then 'New bench', and type its name.",
                _on_page("Bench"),
            ),
            Step(
                "Type the addresses of instruments on the LAN beside 'Scan' (host or host:port), and the address of NI's device server if the card is in "
                "another computer. Press 'Scan': the instruments found are filled in; if there are several of a kind, choose one in its tile."
            ),
            Step(
                "Fill in what no program can detect: the amplifier's range and slopes (its characteristic is drawn as you type), the sensor's name, "
                "gain and the volts that mean 'out of range'. Values may carry a unit. Then 'Save and connect'.",
                lambda view, _: view.connected and not view.simulated,
            ),
            Step(
                "Each tile has its instrument's identity, state and live value; nothing is driven. A tile that is not ready says what to do. Press "
                "'Live view, level and tone by hand' to align the laser: aim at 50 % of its range."
            ),
            Step(
                "Press 'Calibrate …' in the sensor's tile. Put the target at a known position, type it with its uncertainty, wait until the volts "
                "are still, 'Take point'; two or more. Then 'Use this calibration' and 'Save and connect'."
            ),
            Step(
                "Press 'Commission', and confirm that the high voltage is off. The source plays what its driver assumes, and the card measures it. "
                "Without a record of it no high voltage is switched on. Every row must pass."
            ),
            Step(
                "Disconnect the specimen and press 'Check wiring'. Answer the prompts: this is the first time with high voltage. Each row that "
                "failed says what to mend; repeat until all pass.",
                lambda view, _: (
                    view.protocol == "wiring-check"
                    and view.outcome is not None
                    and view.outcome.verdict.outcome is Outcome.GOOD
                ),
            ),
            Step(
                "Connect the specimen. A sine dwell of 1 V peak to peak is a good first run: Ctrl+1, F5. The bench is opened again at the next start."
            ),
        ),
    ),
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
        is_done = TUTORIALS[self._name].steps[self._at].is_done
        if is_done is not None and is_done(self._view, self._page):
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
