"""Card of the unsafe state: what to do by hand, in order; what was measured; and how it ends."""

from collections.abc import Callable

from PySide6.QtCore import QPointF, QRectF, QSize, Qt
from PySide6.QtGui import QColor, QPainter, QPaintEvent, QPolygonF
from PySide6.QtWidgets import QFrame, QWidget

from app.common import typeset
from app.gui.face import CENTRE, LEFT, draw_box, draw_text, painting, px, set_length, text_width, tokens
from app.gui.widgets import SELECTABLE, OverlayCard, column, configure, make_button, make_label, row, show_text
from app.session import WindowState, format_measured_volts
from drivers import MANUAL_SHUTDOWN_INSTRUCTIONS
from model import AmplifierMap

HEADING = "High voltage may be on the specimen"
ACTS = (
    ("Switch the amplifier’s high voltage OFF", "At the amplifier itself. Do it now; the program cannot."),
    ("Wait until the amplifier’s display reads 0 V", "Only the display tells; waiting alone does not."),
    ("Until then, touch neither the specimen nor the cables", "Nor the generator’s cable: plugging it may drive the amplifier."),
)  # fmt: skip
"""The instructions of `MANUAL_SHUTDOWN_INSTRUCTIONS` as acts, with what belongs to each."""


class AmplifierFront(QWidget):
    """Schematic front of an amplifier: its display, its switch and its output."""

    def __init__(self) -> None:
        super().__init__()
        set_length(self, 200, 132)
        self.setAccessibleName("amplifier: 1 its switch, 2 its display")

    def paintEvent(self, _event: QPaintEvent) -> None:
        colors = tokens()

        def box(x: float, y: float, width: float, height: float) -> QRectF:
            return QRectF(px(x), px(y), px(width), px(height))

        with painting(self) as painter:
            draw_box(painter, QRectF(self.rect()).adjusted(0.5, 0.5, -0.5, -0.5), px(8), colors.window, colors.line)
            for area, corner, fill, edge, width in (
                (box(16, 16, 96, 40), 4, "#12161c", "transparent", 1),
                (box(132, 16, 52, 40), 6, colors.red, "transparent", 1),
                (box(24, 93, 20, 20), 10, "transparent", colors.text2, 2),
                (box(32, 101, 4, 4), 2, colors.text2, "transparent", 1),
            ):
                draw_box(painter, area, px(corner), fill, edge, width)
            for area, text, color, kind, align in (
                (box(16, 16, 88, 40), "0 V", "white", "present", Qt.AlignmentFlag.AlignRight | Qt.AlignmentFlag.AlignVCenter),
                (box(132, 16, 52, 40), "OFF", "white", "stop", CENTRE),
                (box(16, 62, 80, 20), "2 display", colors.text2, "", LEFT),
                (box(132, 62, 60, 20), "1 switch", colors.text2, "", LEFT),
                (box(54, 93, 80, 20), "HV out", colors.text2, "", LEFT),
            ):  # fmt: skip
                draw_text(painter, area, text, color, kind, align)


class NumberDisc(QWidget):
    """A number in a red disc."""

    def __init__(self, number: int) -> None:
        super().__init__()
        self._number = number
        set_length(self, 36, 36)

    def paintEvent(self, _event: QPaintEvent) -> None:
        with painting(self) as painter:
            draw_box(painter, QRectF(self.rect()), self.width() / 2, tokens().red)
            draw_text(painter, self.rect(), str(self._number), "white", "heading", CENTRE)


class InputScale(QWidget):
    """Volts at the amplifier's input on a scale with rest marked."""

    def __init__(self, amplifier: AmplifierMap) -> None:
        super().__init__()
        self._amplifier = amplifier
        self._volts: tuple[float, float] | None = None
        self.setAccessibleName("volts at the amplifier's input")

    def sizeHint(self) -> QSize:
        return QSize(px(400), px(48))

    def show_volts(self, volts: tuple[float, float] | None) -> None:
        """Show lowest and highest volts; None: nothing measured."""
        if volts != self._volts:
            self._volts = volts
            self.update()

    def paintEvent(self, _event: QPaintEvent) -> None:
        with painting(self) as painter:
            self._paint(painter)

    def _paint(self, painter: QPainter) -> None:
        colors, amplifier = tokens(), self._amplifier
        left, right, y = px(20), self.width() - px(20), px(14)

        def place(volts: float) -> float:
            share = (volts - amplifier.low_v) / (amplifier.high_v - amplifier.low_v)
            return left + min(max(share, 0.0), 1.0) * (right - left)

        draw_box(painter, QRectF(left, y - px(4), right - left, px(8)), px(4), colors.line)
        draw_box(painter, QRectF(place(amplifier.rest_v) - px(5), y - px(8), px(10), px(16)), 2, colors.green)
        below = QRectF(0, y + px(12), self.width(), px(18))
        rest = f"{amplifier.rest_v:.3f} is rest"
        used = float(px(20))
        if self._volts is not None:
            low = self._volts[0]
            painter.setBrush(QColor(colors.red_line))
            painter.setPen(Qt.PenStyle.NoPen)
            at = place(low)
            painter.drawPolygon(
                QPolygonF([QPointF(at, y - px(7)), QPointF(at - px(7), y + px(6)), QPointF(at + px(7), y + px(6))])
            )
            specimen = float(amplifier.specimen_v([low])[0])
            text = typeset(f"{low:z.3f} now, about {format_measured_volts(specimen, specimen)}")
            left_of = min(max(at - px(8), px(2)), self.width() / 2)
            at_left = below.adjusted(left_of, 0, 0, 0)
            used = left_of + px(12) + draw_text(painter, at_left, text, colors.red_text, "caption")
        width = text_width(rest)
        at_rest = max(place(amplifier.rest_v) - width / 2, used)
        draw_text(painter, below.adjusted(at_rest, 0, 0, 0), rest, colors.text2)
        if at_rest + width < right - px(16):
            end = below.adjusted(0, 0, -px(16), 0)
            draw_text(painter, end, f"{amplifier.high_v:g}", colors.text2, align=Qt.AlignmentFlag.AlignRight)


class UnsafeCard(OverlayCard):
    """No button takes the keyboard: only F4, F6 or a click answer it.

    Args:
        amplifier: characteristic of the amplifier.
        acknowledge: the operator has read the message, and switched the high voltage off.
        measure_again: opens the bench again and measures rest.
    """

    def __init__(
        self, amplifier: AmplifierMap, acknowledge: Callable[[], object], measure_again: Callable[[], object]
    ) -> None:
        content, footer = QWidget(), QWidget()
        super().__init__(
            "notices.unsafe", content, width=880, edge="red_line", closable=False, washed=True, footer=footer
        )
        self.message_label = make_label(HEADING, "act", name="notices.unsafe.message")
        self.message_label.setProperty("tone", "bad")
        self.detail_label = make_label(name="notices.unsafe.detail", textInteractionFlags=SELECTABLE)
        self.scale = InputScale(amplifier)
        self.measured_label = make_label(name="unsafe.measured")
        self.buttons = [
            make_button("I have switched it off", acknowledge, "go", name="unsafe.acknowledge", key="F4"),
            make_button("Measure rest again", measure_again, "main", name="unsafe.measure", key="F6"),
        ]
        for button in self.buttons:
            button.setFocusPolicy(Qt.FocusPolicy.NoFocus)
        acts = []
        for number, (act, note) in enumerate(ACTS, 1):
            texts = column(make_label(act, "heading"), make_label(note, "note"), spacing=0)
            acts.append(row(NumberDisc(number), (texts, 1), spacing=16))
        band = configure(QFrame(), "unsafe.band", kind="band")
        row(
            (column(make_label("Amplifier’s input, V", wrap=False), self.scale, spacing=0), 3),
            (self.measured_label, 2),
            parent=band,
            margins=(24, 8, 24, 4),
            spacing=24,
        )
        stays = make_label("The sign stays until rest is measured.", "note", wrap=False)
        column(
            column(
                self.message_label,
                self.detail_label,
                row((AmplifierFront(), 0, Qt.AlignmentFlag.AlignTop), (column(*acts, spacing=10), 1), spacing=32, margins=(0, 8, 0, 0)),
                margins=(24, 14, 24, 10),
                spacing=4,
            ),
            band,
            parent=content,
        )  # fmt: skip
        row(*self.buttons, None, stays, parent=footer, margins=(24, 12, 24, 12), spacing=12)

    def show_state(self, view: WindowState) -> None:
        """Show what is known, or hide the card where nothing is unsafe."""
        if not view.unsafe:
            self.dismiss()
            return
        whole = typeset(view.unsafe.removeprefix(MANUAL_SHUTDOWN_INSTRUCTIONS).lstrip(". "))
        detail = whole.partition(" The run had failed before:")[0]  # the result card and the log have it
        show_text(self.detail_label, detail)
        self.detail_label.setToolTip(whole)
        if self.isHidden():
            self.open()

    def show_volts(self, volts: tuple[float, float] | None, age_s: float = 0.0) -> None:
        """Show what the card measured at the amplifier's input, and how long ago."""
        self.scale.show_volts(volts)
        seen = (
            "nothing is measured" if volts is None else typeset(f"lowest {volts[0]:z.3f} V, highest {volts[1]:z.3f} V")
        )
        when = "" if volts is None else f", {age_s:.1f} s ago"
        text = f"Measured by the card{when}\n{seen}\nMend after step 2 what the message names"
        if text != self.measured_label.text():
            self.measured_label.setText(text)
