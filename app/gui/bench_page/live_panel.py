"""Live view of the Bench page: traces, and a level or a tone played by hand."""

from collections.abc import Callable
from functools import partial

from PySide6.QtWidgets import QFrame, QHBoxLayout, QLineEdit, QWidget

from app.common import UsageError
from app.gui.plots import TimePlot
from app.gui.widgets import StatusLine, column, configure, make_button, make_label, make_line_edit, make_panel, row
from app.live import LiveFeed
from app.session import build_protocol
from model import AmplifierMap
from protocols import HELD_LEVELS, PROTOCOLS, TONES
from protocols.base import Protocol

ABOUT_TEXT = (
    "A level or a tone by hand is a run like any other: it is armed with the prompts for high voltage, kept within the drive limits, stored, "
    "and ramped to rest at its end, by Stop (Esc, F12) and by every failure."
)


class LivePanel(QFrame):
    """The live view; the traces are made when it is first shown.

    Args:
        feed: of the samples.
        amplifier: of the open bench.
        simulated: whether it is simulated.
        run: starts the run of a protocol.
    """

    def __init__(
        self, feed: LiveFeed, amplifier: AmplifierMap, simulated: bool, run: Callable[[Protocol], object]
    ) -> None:
        super().__init__()
        self._simulated, self._run = simulated, run
        self._make_plot: Callable[[], TimePlot] = lambda: TimePlot(feed, amplifier)
        self.plot: TimePlot | None = None
        level, level_s, frequency, swing, tone_s = (
            make_line_edit(f"bench.hand.{name}", label, text=text, toolTip=label, minimumWidth=60, maximumWidth=90)
            for name, label, text in (
                ("level", "level at the amplifier's input in V", f"{amplifier.rest_v + 0.1:g}"),
                ("level-s", "duration of the level in s", "10"),
                ("frequency", "frequency of the tone in Hz", "100"),
                ("swing", "peak to peak at the amplifier's input in V", "0.2"),
                ("tone-s", "duration of the tone in s", "10"),
            )
        )
        held, played = (
            {"levels_v": level, "hold_s": level_s},
            {"frequencies_hz": frequency, "peak_to_peak_v": swing, "record_s": tone_s},
        )
        hold = partial(self._request, HELD_LEVELS, held, repeats=1, order="up", rest_s=0.5)
        self.level_button = make_button("Hold level", hold, name="bench.hand.hold")
        self.tone_button = make_button("Play tone", partial(self._request, TONES, played), name="bench.hand.play")
        self.message_label = configure(StatusLine(), "bench.hand.message")
        self._place = QWidget()
        self._place_layout = column(parent=self._place)
        self._place.setMinimumHeight(240)
        make_panel(
            make_label("Live view", "heading", wrap=False),
            self._place,
            make_label(ABOUT_TEXT),
            _sentence("Level", level, "V for", level_s, "s", self.level_button),
            _sentence("Tone", frequency, "Hz,", swing, "V peak to peak for", tone_s, "s", self.tone_button),
            self.message_label,
            frame=self,
        )

    def tick(self) -> None:
        """Redraw the traces."""
        if self.plot is None:
            self.plot = self._make_plot()
            self.plot.show_simulated(self._simulated)
            self._place_layout.addWidget(self.plot)
        self.plot.tick()

    def _request(self, name: str, edits: dict[str, QLineEdit], **others: object) -> None:
        """Start a run of a protocol with typed parameters, and with others."""
        typed = {key: edit.text().strip() for key, edit in edits.items()}
        try:
            protocol = build_protocol(PROTOCOLS[name], typed | others)
        except UsageError as error:
            self.message_label.show_message(str(error), is_error=True)
            return
        self.message_label.show_message("")
        self._run(protocol)


def _sentence(*parts: QWidget | str) -> QHBoxLayout:
    """Return a row of words and fields."""
    return row(*(make_label(part, wrap=False) if isinstance(part, str) else part for part in parts), None)
