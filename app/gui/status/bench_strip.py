"""Strip of the bench, of one height in every state: sign, measured volts, aim, run, Pause and STOP."""

import time
from dataclasses import dataclass, replace

from PySide6.QtCore import QRectF, Qt
from PySide6.QtGui import QColor, QFontMetricsF, QPainter, QPaintEvent, QResizeEvent
from PySide6.QtWidgets import QAbstractButton, QWidget

from app.common import outcome_severity, sentence_case
from app.gui.face import (
    CENTRE,
    STRIP_HEIGHT,
    Tokens,
    class_of,
    draw_box,
    draw_hatch,
    draw_icon,
    draw_ring,
    draw_text,
    painting,
    px,
    set_length,
    text_font,
    text_width,
    tokens,
)
from app.gui.status.session_controller import SessionController
from app.gui.widgets import configure
from app.session import KNOWN_S, StripView, WindowState

REPAINT_S = 0.2
"""Interval at which the age of the measured volts and the time left are painted anew."""

NARROW_RUN = 110
"""Width of the run's column, in lengths of the design, below which it says the least."""

SWITCH_OFF, OTHER_VOLTAGE = "Switch HV off", "card sees another voltage"
"""What a column says that is too narrow for the whole sentence."""

BLACK, WHITE = "#000000", "#ffffff"


@dataclass(frozen=True, slots=True)
class Look:
    """How a state looks.

    Attributes:
        word: the sign's.
        icon: its shape.
        ground: token of the sign's colour.
        tint: token of the colour of the rest; the same as `ground` where the whole strip has one.
        hazard: whether the left edge has stripes: high voltage is on, or may be.
    """

    word: str
    icon: str
    ground: str = "grey"
    tint: str = "surface"
    hazard: bool = False


LOOKS: dict[str, Look] = {
    "connecting": Look("CONNECT", "connect"),
    "not armed": Look("NOT ARMED", "not-armed"),
    "arming": Look("ARMING", "arming", "amber", "amber_tint"),
    "live": Look("LIVE", "live", "amber", "amber", hazard=True),
    "pausing": Look("PAUSING", "pause", "amber", "amber", hazard=True),
    "paused": Look("PAUSED", "pause", "amber", "amber_tint", hazard=True),
    "hv off": Look("HV OFF", "hv-off", "green", "green_tint"),
    "drive lost": Look("DRIVE LOST", "danger", "red", "red", hazard=True),
    "going to rest": Look("TO REST", "to-rest", "amber", "amber_tint", hazard=True),
    "at rest": Look("AT REST", "rest", "green", "green_tint"),
    "unsafe": Look("UNSAFE", "danger", "red", "red", hazard=True),
    "no bench": Look("NO BENCH", "no-bench"),
}
"""By the word of a state. The sign is told apart by word and shape, its colour comes on top."""


def look_of(view: StripView) -> Look:
    """Return how a strip looks: red is UNSAFE or DRIVE LOST only; volts off rest before the first arming are amber."""
    look = LOOKS[str(view.state)]
    if not view.danger:
        return look
    if view.state == "not armed" and view.age_s <= KNOWN_S:
        return replace(look, tint="amber_tint")
    return look if look.icon == "danger" else LOOKS["unsafe"]


def stops_by_escape(state: str) -> bool:
    """Whether Esc is STOP: from arming until rest is measured. Otherwise it closes what lies on top."""
    return str(state) in ("arming", "live", "pausing", "paused", "hv off", "drive lost", "going to rest")


def on_ground(ground: str, colors: Tokens) -> str:
    """Return the colour of text on the ground of a token."""
    return {"amber": BLACK, "surface": colors.text, "amber_tint": colors.text, "green_tint": colors.text}.get(
        ground, WHITE
    )


class StripButton(QAbstractButton):
    """Pause or STOP: a word, and the key below it.

    Args:
        name: object name.
        is_stop: filled with red; else an outline.
    """

    def __init__(self, name: str, is_stop: bool, parent: QWidget) -> None:
        super().__init__(parent)
        self.key = ""
        self.ground = "surface"
        """Token of the strip's colour below the button."""
        self._is_stop = is_stop
        configure(self, name, focusPolicy=Qt.FocusPolicy.TabFocus)

    def show_texts(self, word: str, key: str, ground: str) -> None:
        """Show a word with its key on a ground."""
        if (word, key, ground) != (self.text(), self.key, self.ground):
            self.key, self.ground = key, ground
            self.setText(word)
            self.setAccessibleName(f"{word}, {key}")
            self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors = tokens()
        fill, edge, ink = self._colors(colors)
        kind, small = ("stop", "mark") if self._is_stop else ("heading", "caption")
        wide = text_width(self.text(), kind) > self.width() - px(8)
        faint = {"amber": BLACK, "red": WHITE}.get(self.ground, colors.text2)
        with painting(self) as painter:
            draw_box(painter, QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), px(6), fill, edge)
            if self.hasFocus():
                draw_ring(painter, self.rect().adjusted(2, 2, -2, -2), ink)
            word = QRectF(0, px(5), self.width(), px(22))
            draw_text(painter, word, self.text(), ink, small if wide else kind, CENTRE)
            draw_text(
                painter,
                word.translated(0, px(20)),
                self.key,
                ink if self._is_stop or self.isEnabled() else faint,
                "",
                CENTRE,
            )

    def _colors(self, colors: Tokens) -> tuple[str, str, str]:
        """Return fill, edge and text."""
        if self._is_stop:
            if self.ground == "red":
                return WHITE, WHITE, colors.red
            return colors.red, WHITE if self.ground == "amber" else colors.red_line, WHITE
        if self.ground in ("amber", "red"):
            ink = BLACK if self.ground == "amber" else WHITE
            faint = QColor(ink)
            faint.setAlpha(160)
            shown = ink if self.isEnabled() else faint.name(QColor.NameFormat.HexArgb)
            return "transparent", shown, shown
        return colors.surface, colors.outline, colors.text if self.isEnabled() else colors.text2


class BenchStrip(QWidget):
    """The strip. It is painted from one value; only Pause and STOP are widgets.

    Args:
        controller: executes Pause and STOP.
    """

    def __init__(self, controller: SessionController) -> None:
        super().__init__()
        self._controller = controller
        self._state: WindowState | None = None
        self._painted_s = 0.0
        self.elided: list[str] = []
        """Texts that the last paint had no place for."""
        self.view: StripView | None = None
        """What is shown."""
        self.pause_button = StripButton("status.pause", is_stop=False, parent=self)
        self.pause_button.clicked.connect(lambda _=False: controller.toggle_pause())
        self.stop_button = StripButton("status.stop", is_stop=True, parent=self)
        self.stop_button.clicked.connect(lambda _=False: controller.stop())
        configure(
            self,
            "strip",
            toolTip="The volts at the specimen are computed from what the card measures at the amplifier's input",
        )
        self.setAttribute(Qt.WidgetAttribute.WA_OpaquePaintEvent)
        set_length(self, height=STRIP_HEIGHT)

    def set_state(self, view: WindowState) -> None:
        self._state = view
        self.show_view(self._controller.strip(), view)

    def tick(self) -> None:
        """Paint other volts at once, their age and the time left every REPAINT_S; called at every tick of the window."""
        if self.view is None or self._state is None:
            return
        view = self._controller.strip()
        if view.measured != self.view.measured or (
            view != self.view and time.monotonic() - self._painted_s >= REPAINT_S
        ):
            self.show_view(view, self._state)

    def show_view(self, view: StripView, state: WindowState) -> None:
        """Show what is known of the bench."""
        look, self._painted_s = look_of(view), time.monotonic()
        changed, self.view = view != self.view, view
        self.stop_button.show_texts("STOP", "F12 or Esc" if stops_by_escape(view.state) else "F12", look.tint)
        self.stop_button.setToolTip("Go to rest and end the run: F12" + " or Esc" * stops_by_escape(view.state))
        self.pause_button.show_texts("Resume" if state.paused else "Pause", "F8", look.tint)
        self.pause_button.setEnabled(state.can_pause)
        self.pause_button.setToolTip(
            "Measure on, from the start of the interrupted entry: F8"
            if state.paused
            else "Go to rest and wait there; the present entry is measured again from its start: F8"
        )
        if changed:
            self.setAccessibleName(
                f"{look.word}; {view.measured} {view.caption}; {view.act}; aim {view.aim}; {view.run.title}, {view.run.note}"
            )
            self.update()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        grid, top, height = class_of(self), px(8), px(48)
        right = self.width() - px(12)
        self.stop_button.setGeometry(right - px(grid.stop), top, px(grid.stop), height)
        right = self.stop_button.x() - px(grid.gap)
        self.pause_button.setGeometry(right - px(grid.pause), top, px(grid.pause), height)

    def paintEvent(self, _event: QPaintEvent) -> None:
        if self.view is None:
            return
        view, look, colors, grid = self.view, look_of(self.view), tokens(), class_of(self)
        self.elided = []
        ink = on_ground(look.tint, colors)
        faint = ink if look.tint in ("amber", "red") else colors.text2
        rule = QColor(ink)
        rule.setAlpha(60)
        with painting(self) as painter:
            painter.fillRect(self.rect(), QColor(getattr(colors, look.tint)))
            self._draw_sign(painter, look, colors, px(grid.sign))
            left = px(grid.sign) + px(grid.gap)
            self._draw_measured(
                painter, left, px(grid.measured), ink if view.present or look.tint == "red" else faint, faint
            )
            for width in (grid.measured, grid.aim):
                left += px(width) + px(grid.gap)
                painter.fillRect(QRectF(left, px(9), 1, self.height() - px(18)), rule)
                left += 1 + px(grid.gap)
                if width == grid.measured:
                    self._draw_aim(painter, left, px(grid.aim), ink, faint)
            self._draw_run(painter, left, self.pause_button.x() - px(grid.gap) - left, ink, faint)
            painter.fillRect(QRectF(0, self.height() - 1, self.width(), 1), QColor(colors.line))

    def _draw_sign(self, painter: QPainter, look: Look, colors: Tokens, width: int) -> None:
        ground = QColor(getattr(colors, look.ground))
        painter.fillRect(QRectF(0, 0, width, self.height()), ground)
        ink = on_ground(look.ground, colors)
        if look.hazard:
            draw_hatch(painter, QRectF(0, 0, px(10), self.height()), ink, ground, 10.0)
        side = px(28)
        draw_icon(painter, look.icon, QRectF(px(15), (self.height() - side) / 2, side, side), ink)
        draw_text(painter, QRectF(px(48), 0, width - px(48), self.height()), look.word, ink, "sign")

    def _draw_measured(self, painter: QPainter, left: int, width: int, ink: str, faint: str) -> None:
        assert self.view is not None
        view, captions = self.view, _shortened(sentence_case(self.view.caption))
        if view.act and not view.danger:  # such as that high voltage is still on
            age = view.caption.rpartition(", ")[2]
            captions = (f"{view.act}, {age}", view.act, sentence_case(view.act.rpartition(": ")[2]))
        self._draw_line(painter, QRectF(left, px(7), width, px(18)), captions, "", faint)
        volts = (view.measured or "no value",)
        self._draw_line(painter, QRectF(left, px(23), width, px(34)), volts, "present", ink)

    def _draw_aim(self, painter: QPainter, left: int, width: int, ink: str, faint: str) -> None:
        assert self.view is not None
        what, _, volts = self.view.aim.rpartition(", ")
        lines = _shortened(f"Aim: {what or 'none'}")
        self._draw_line(painter, QRectF(left, px(7), width, px(18)), lines, "", faint)
        self._draw_line(painter, QRectF(left, px(28), width, px(22)), (volts or "—",), "main", ink)

    def _draw_run(self, painter: QPainter, left: int, width: int, ink: str, faint: str) -> None:
        assert self.view is not None
        run, narrow = self.view.run, width < px(NARROW_RUN)
        in_run = bool(run.fraction) and run.outcome is None and not self.view.danger
        titles, notes = _shortened(sentence_case(run.title)), _shortened(sentence_case(run.note))
        titles += (run.title.partition(" · ")[0], run.title.partition(" of ")[0])
        if self.view.danger:
            act, _, why = self.view.act.partition("; ")
            # F4 answers the card of that state, F6 measures rest again.
            key = (
                "" if self.view.state != "unsafe" else "F4" if self._state is not None and self._state.unsafe else "F6"
            )
            note = OTHER_VOLTAGE if why else run.note
            titles, notes = (act, SWITCH_OFF), _shortened(sentence_case(f"Then {key}; {note}" if key else note))
            if narrow:
                titles, notes = ("Switch HV",), (f"off, {key}" if key else "off",)
        elif narrow and in_run:
            points, _, rest = run.note.partition(", ")
            titles, notes = (points.removesuffix(" points"),), (rest,)
        elif narrow and run.outcome is not None:
            titles, notes = (run.note.partition(", ")[0],), titles
        elif narrow and self.view.state == "connecting":
            begin, _, rest = run.note.partition(", ")[0].partition(" the ")
            titles, notes = (sentence_case(begin),), (f"the {rest}", rest.rpartition(" ")[2])
        elif run.outcome is None and not run.fraction:
            titles = (*titles, "No run")
        colored = not self.view.danger and look_of(self.view).tint not in ("amber", "red") and run.outcome is not None
        color = tokens().severity_color(outcome_severity(run.outcome)) if colored and run.outcome else faint
        self._draw_line(painter, QRectF(left, px(8), width, px(20)), titles, "heading", ink)
        self._draw_line(painter, QRectF(left, px(27), width, px(18)), notes, "", color)
        if in_run:
            track = QColor(ink)
            track.setAlpha(50)
            painter.fillRect(QRectF(left, px(50), width, px(4)), track)
            painter.fillRect(QRectF(left, px(50), width * min(run.fraction, 1.0), px(4)), QColor(ink))

    def _draw_line(self, painter: QPainter, area: QRectF, texts: tuple[str, ...], kind: str, color: str) -> None:
        """Draw the first of several texts that fits, elided if none does."""
        metrics = QFontMetricsF(text_font(kind))
        text = next((each for each in texts if metrics.horizontalAdvance(each) <= area.width() + 1), "")
        if not text and texts[-1]:
            self.elided.append(texts[-1])
            text = metrics.elidedText(texts[-1], Qt.TextElideMode.ElideRight, area.width())
        draw_text(painter, area, text, color, kind)


def _shortened(text: str) -> tuple[str, ...]:
    """Return a text, and what is left of it without its last parts."""
    texts = [text]
    for mark in ("; ", ", "):
        while mark in texts[-1]:
            texts.append(texts[-1].rpartition(mark)[0])
    return tuple(texts)
