"""Face of the window: nothing moves, fonts and colours are those of the design, keys mean one thing in each state."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product
from pathlib import Path

import pytest
from PySide6.QtCore import QCoreApplication, QEvent, QObject, QPoint, QRect, QSize, Qt
from PySide6.QtGui import QColor, QFontInfo, QImage
from PySide6.QtTest import QTest
from PySide6.QtWidgets import (
    QAbstractButton,
    QApplication,
    QComboBox,
    QLabel,
    QLineEdit,
    QPlainTextEdit,
    QPushButton,
    QTableWidget,
    QWidget,
)

from app.gui.face import DARK, FAMILY, LIGHT, SIZES_PX, Tokens, px, size_class, style_sheet, text_scale
from app.gui.face.tokens import COLORS
from app.gui.plots import color_of, curve_tone
from app.gui.shell.page_host import MEASURE
from app.gui.status.bench_strip import LOOKS, BenchStrip, look_of
from app.gui.widgets import column, configure
from app.session import BenchState
from app.session.strip import RunLine, StripView
from protocols.base import Outcome, Prompt, PromptShown, RunPaused
from tests.helpers.main_window import OpenStage, Stage, find, sign, until, word
from tests.helpers.session_events import AT_REST, LIVE, LOST, OPENED, STARTED, STOPPED

SIZES = (QSize(900, 560), QSize(1093, 614), QSize(1366, 768), QSize(1920, 1080), QSize(2560, 1440))
WEIGHT = Prompt(
    "place-weight", "Place the 200 g weight on the centre; the laser sees it land.", {"mass_kg": 0.2}, hands_on=True
)
EDITORS = (QLineEdit, QPlainTextEdit, QComboBox)
STATES = ("idle", "arming", "live", "paused", "prompt", "unsafe", "faults", "log", "closing", "palette", "settings")


def reach(stage: Stage, state: str) -> Callable[[], object]:
    """Bring a window from idle into a state; return what takes it back."""
    window = stage.window
    if state in ("arming", "live", "paused", "prompt", "unsafe", "closing"):
        window.start_run()
        stage.happen(STARTED)
    if state in ("live", "paused", "prompt", "unsafe", "closing"):
        stage.happen(*LIVE)
    match state:
        case "paused":
            stage.happen(RunPaused("the card sees 2.500 V"))
        case "prompt":
            window.adapter.mailbox.show(7, WEIGHT)
            stage.happen(PromptShown(7, WEIGHT))
        case "unsafe":
            stage.happen(*LOST)
        case "closing":
            window.notices.ask_to_close(window.state)
        case "faults":
            stage.press(Qt.Key.Key_F9)
        case "log":
            stage.press(Qt.Key.Key_J, Qt.KeyboardModifier.ControlModifier)
        case "palette":
            window.central.show_palette()
        case "settings":
            window.central.show_settings()

    def back() -> None:
        window.notices.cancel_closing()
        window.adapter.mailbox.clear() if hasattr(window.adapter.mailbox, "clear") else None
        if window.state.busy:
            stage.happen(*STOPPED)
        window.controller.acknowledge()
        while window.central.close_topmost():
            pass
        window.central.show_pages()

    return back


def place_of(widget: QWidget) -> QRect:
    return QRect(widget.mapTo(widget.window(), QPoint(0, 0)), widget.size())


@pytest.mark.parametrize("size", SIZES, ids=lambda size: f"{size.width()}x{size.height()}")
def test_page_and_stop_are_at_the_same_place_in_every_state(stage: Stage, size: QSize) -> None:
    window = stage.window
    stage.happen(OPENED)
    window.resize(size)
    QCoreApplication.processEvents()
    pages, stops, strips = set(), set(), set()
    for state in STATES:
        back = reach(stage, state)
        QCoreApplication.processEvents()
        pages.add(place_of(window.tabs).getRect())
        stops.add(place_of(window.strip.stop_button).getRect())
        strips.add(place_of(window.strip).getRect())
        back()
    grid = size_class(size.width())
    assert pages == {(grid.rail, 90, size.width() - grid.rail, size.height() - 90 - 28)}
    assert strips == {(0, 26, size.width(), 64)}
    assert stops == {(size.width() - 12 - grid.stop, 34, grid.stop, 48)}


class EventCounter(QObject):
    def __init__(self, kind: QEvent.Type, *widgets: QWidget) -> None:
        super().__init__()
        self._kind, self.count = kind, 0
        for widget in widgets:
            widget.installEventFilter(self)

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        self.count += event.type() == self._kind
        return False


@pytest.mark.deep
def test_an_open_overlay_is_laid_out_once_and_then_at_rest(stage: Stage) -> None:
    stage.happen(OPENED)
    for state in ("prompt", "unsafe", "faults", "log", "closing", "palette", "settings"):
        back = reach(stage, state)
        for _ in range(20):  # what was requested by the opening
            QCoreApplication.processEvents()
        every = [each.content for each in stage.window.central.opened]
        counter = EventCounter(QEvent.Type.LayoutRequest, *every)
        for _ in range(50):
            QCoreApplication.processEvents()
        assert every, state
        assert counter.count <= 5, state  # a card that places itself again at each request has 50
        back()


def test_opening_an_overlay_lays_no_page_out_again(stage: Stage) -> None:
    stage.happen(OPENED)
    page = stage.window.measure_page
    counter = EventCounter(
        QEvent.Type.Resize, page, page.run_panel, page.live_pane, stage.window.tabs, stage.window.central
    )
    for state in ("prompt", "unsafe", "faults", "log", "closing", "palette", "settings"):
        back = reach(stage, state)
        QCoreApplication.processEvents()
        assert stage.window.central.opened, state
        back()
    assert counter.count == 0


@pytest.mark.deep
def test_overlays_never_cover_strip_rail_status_line_nor_run(stage: Stage) -> None:
    stage.happen(OPENED)
    window = stage.window
    for size in SIZES[:3]:
        window.resize(size)
        for state in ("prompt", "unsafe", "faults", "log", "closing", "palette", "settings"):
            back = reach(stage, state)
            QCoreApplication.processEvents()
            page = window.central.rect()
            for overlay in window.central.opened:
                assert page.contains(overlay.geometry()), (state, size)
                assert overlay.parent() is window.central
            if state in ("faults", "log", "settings"):
                run = place_of(find(window, "measure.run"))
                assert not any(run.intersects(place_of(each)) for each in window.central.opened), (state, size)
            back()


def visible_texts(window: QWidget) -> Iterator[QWidget]:
    for widget in window.findChildren(QWidget):
        if widget.isVisible() and isinstance(widget, QLabel | QAbstractButton):
            yield widget


@pytest.mark.deep
@pytest.mark.parametrize("percent", ["100", "125"])
def test_fonts_have_four_sizes_and_one_family(open_stage: OpenStage, settings: object, percent: str) -> None:
    stage = open_stage(ahead=True)
    window = stage.window
    until(lambda: len(window.tabs.created_pages) == window.tabs.count(), "for the pages")
    window.look.set_text_size(percent)
    allowed = {round(size * text_scale()) for size in SIZES_PX}
    stage.happen(OPENED)
    for page in range(window.tabs.count()):
        window.tabs.setCurrentIndex(page)
        for state in ("idle", "prompt", "unsafe", "faults", "log", "settings"):
            back = reach(stage, state)
            QCoreApplication.processEvents()
            editors = [each for each in window.findChildren(QWidget) if isinstance(each, EDITORS) and each.isVisible()]
            for widget in (*visible_texts(window), *editors):
                where = (page, state, type(widget).__name__, widget.objectName(), str(widget.property("text"))[:30])
                if widget.property("kind") != "command":
                    assert QFontInfo(widget.font()).family() == FAMILY, where
                assert widget.font().pixelSize() in allowed, where
            back()
    window.look.set_text_size("100")


def luminance(color: QColor) -> float:
    def linear(share: float) -> float:
        return share / 12.92 if share <= 0.03928 else ((share + 0.055) / 1.055) ** 2.4

    red, green, blue = (linear(part) for part in (color.redF(), color.greenF(), color.blueF()))
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str | QColor, other: str | QColor) -> float:
    light, dark = sorted((luminance(QColor(one)), luminance(QColor(other))), reverse=True)
    return (light + 0.05) / (dark + 0.05)


PAGES, TINTS = ("surface", "window"), ("green_tint", "amber_tint", "accent_tint", "sunken")
CONTRASTS = (
    (("text", "text2", "accent_text", "green_text", "amber_text", "red_text"), PAGES, 4.5),
    (("text", "text2"), TINTS, 4.5),
    (("green_text",), ("green_tint",), 4.5),
    (("amber_text",), ("amber_tint",), 4.5),
    (("accent_text",), ("accent_tint",), 4.5),
    (("outline", "accent_text", "red_line", "ink", "model"), PAGES, 3.0),
    (("ink", "model"), ("band",), 3.0),
    (("sand_text",), ("sand", "sand2"), 4.5),
    (("#ffffff",), ("accent", "green", "red", "grey", "violet", "violet2"), 4.5),
    (("#000000",), ("amber",), 4.5),
)
"""Texts, marks and outlines, the grounds that they stand on, and their least contrast there."""

DECORATION = {"line"}


@pytest.mark.parametrize("colors", [LIGHT, DARK], ids=["light", "dark"])
def test_contrast_of_every_token(colors: Tokens) -> None:
    judged = set[str]()
    for inks, grounds, least in CONTRASTS:
        for ink, ground in product(inks, grounds):
            assert contrast(getattr(colors, ink, ink), getattr(colors, ground)) >= least, (ink, ground)
            judged |= {ink, ground}
    assert {each for each in judged if not each.startswith("#")} == set(COLORS) - DECORATION
    for layer in colors.layers:
        assert contrast(layer, colors.surface) >= 4.5


def test_contrast_of_the_colours_of_further_curves(stage: Stage) -> None:
    for appearance in ("light", "dark"):
        stage.window.look.set_appearance(appearance)
        for at in range(12):
            assert contrast(color_of(curve_tone(at)), color_of("surface")) >= 3.0, (appearance, at)


def contrast_in(image: QImage) -> float:
    """Return the largest contrast between the most frequent colour of a picture and any other one."""
    counted: dict[int, int] = {}
    for x in range(image.width()):
        for y in range(image.height()):
            pixel = image.pixel(x, y)
            counted[pixel] = counted.get(pixel, 0) + 1
    ground = QColor.fromRgb(max(counted, key=lambda pixel: counted[pixel]))
    return max(contrast(QColor.fromRgb(pixel), ground) for pixel in counted)


@pytest.mark.parametrize("appearance", ["light", "dark"])
def test_contrast_of_the_rendered_strip(stage: Stage, appearance: str) -> None:
    window = stage.window
    window.look.set_appearance(appearance)
    stage.happen(OPENED)
    for state in ("idle", "live", "paused", "unsafe"):
        back = reach(stage, state)
        QCoreApplication.processEvents()
        grid, pause = size_class(window.width()), window.strip.pause_button.x()
        left = grid.sign + grid.gap
        places = {
            "sign": QRect(12, 4, grid.sign - 16, 56),
            "volts": QRect(left, 24, grid.measured, 32),
            "caption": QRect(left, 8, grid.measured, 16),
            "run": QRect(pause - 300, 8, 280, 36),
            "stop": place_of(window.strip.stop_button).translated(0, -window.strip.y()).adjusted(20, 6, -20, -6),
        }
        for name, place in places.items():
            assert contrast_in(window.strip.grab(place).toImage()) >= (
                4.5 if name != "run" or state != "idle" else 1.0
            ), (
                state,
                name,
            )
        back()


def test_the_style_sheet_has_no_sizes_and_a_resize_sets_none(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    for colors in (LIGHT, DARK):
        sheet = style_sheet(colors)
        assert "font-size" not in sheet
        assert "pt" not in sheet.replace("option", "")
    stage.happen(OPENED)
    styles: list[str] = []
    monkeypatch.setattr(type(stage.window), "setStyleSheet", lambda _, sheet: styles.append(sheet))
    for size in SIZES:
        stage.window.resize(size)
        QCoreApplication.processEvents()
    assert styles == []


def test_states_are_told_apart_by_word_and_shape() -> None:
    assert set(LOOKS) >= {str(state) for state in BenchState}
    looks = list(LOOKS.values())
    assert len({look.word for look in looks}) == len(looks)
    danger = {look.word for look in looks if look.icon == "danger"}
    assert danger == {word(BenchState.DRIVE_LOST), word(BenchState.UNSAFE)}
    shapes = [look.icon for look in looks if look.icon not in ("danger", "pause")]
    assert len(shapes) == len(set(shapes))


AT, IF_ON = "at the specimen, 0.1 s ago", "if the high voltage is on, 0.1 s ago"
OFF = "Switch the high voltage OFF at the amplifier now"
RUN = RunLine("Sine dwell · 155 Hz", "7 of 18 points, 12 s left", 0.4)
NO_RUN, GOOD = (
    RunLine("simulated bench", "no run yet"),
    RunLine("✓ GOOD", "Sine dwell, 18 of 18 points", 1.0, Outcome.GOOD),
)
LOST_RUN = RunLine("⚠ UNSAFE", "Sine dwell, 5 of 18 points", 0.3, Outcome.UNSAFE)
VIEWS = {
    "connecting": StripView("connecting", False, "", "not measured yet", 9e9, "", "", NO_RUN),
    "not armed": StripView("not armed", False, "about 0 V", IF_ON, 0.1, "", "", NO_RUN),
    "off rest": StripView("not armed", True, "about −500 V", IF_ON, 0.1, "", OFF, NO_RUN),
    "arming": StripView("arming", False, "about 0 V", IF_ON, 0.1, "measure rest, 0 V", "", RUN),
    "live": StripView("live", False, "−500 … +1500 V", AT, 0.1, "sine, 155 Hz, −500 … +1500 V", "", RUN),
    "pausing": StripView("pausing", False, "−500 … +1500 V", AT, 0.1, "rest, 0 V", "", RUN),
    "paused": StripView("paused", False, "0 V", AT, 0.1, "rest, 0 V", "High voltage is still on", RUN),
    "hv off": StripView("hv off", False, "0 V", AT, 0.1, "high voltage off, 0 V", "", RUN),
    "drive lost": StripView("drive lost", True, "about −500 V", IF_ON, 0.1, "sine, 155 Hz, −500 … +1500 V", f"{OFF}; x", RUN),
    "going to rest": StripView("going to rest", False, "−212 V", AT, 0.1, "rest, 0 V", "", RUN),
    "at rest": StripView("at rest", False, "0 V", AT, 0.1, "rest, 2.500 V, 0 V", "", GOOD),
    "unsafe": StripView("unsafe", True, "about −500 V", IF_ON, 0.1, "rest, not reached, 0 V", OFF, LOST_RUN),
    "card gone": StripView("unsafe", True, "unknown", "last −500 … +1500 V, 4 s ago", 4.0, "rest, no answer, 0 V", OFF, LOST_RUN),
    "no bench": StripView("no bench", False, "", "nothing measures", 9e9, "", "", NO_RUN),
}  # fmt: skip


def test_red_is_unsafe_and_drive_lost_alone() -> None:
    for view in VIEWS.values():
        look = look_of(view)
        assert ("red" in (look.ground, look.tint)) == (
            look.word in (word(BenchState.UNSAFE), word(BenchState.DRIVE_LOST))
        )
        unread = replace(view, danger=True, measured="unknown", age_s=4.0)
        assert look_of(unread).tint == "red", "a danger is red, with one of these words"
    strays = look_of(VIEWS["off rest"])
    assert (strays.word, strays.ground, strays.tint) == (word(BenchState.IDLE), "grey", "amber_tint")


@pytest.mark.parametrize("name", VIEWS)
def test_the_strip_has_a_place_for_every_text_of_every_state(stage: Stage, name: str) -> None:
    strip = stage.window.strip
    for size in SIZES:
        stage.window.resize(size)
        QCoreApplication.processEvents()
        strip.show_view(VIEWS[name], stage.window.state)
        strip.grab()
        assert strip.elided == [], size


def test_the_strip_is_painted_when_a_text_of_it_changes_only(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    strip, fresh = stage.window.strip, VIEWS["live"]
    painted = EventCounter(QEvent.Type.Paint, strip)

    def paints(view: StripView) -> int:
        monkeypatch.setattr(stage.window.controller, "strip", lambda: view)
        strip.show_view(view, stage.window.state)
        painted.count = 0
        QCoreApplication.processEvents()
        return painted.count

    assert paints(fresh) == 1
    answers = {"card": "ready; last answer 0.1 s ago"}
    assert paints(replace(fresh, age_s=0.2, instruments=answers)) == 0, "no text of the strip shows these"
    assert paints(replace(fresh, measured="0 V")) == 1


def test_escape_is_stop_from_arming_until_rest_is_measured_and_says_so_only_then(stage: Stage) -> None:
    stage.happen(OPENED)
    window, stop = stage.window, stage.window.strip.stop_button
    assert stop.key == "F12"
    stage.press(Qt.Key.Key_F9)
    stage.press(Qt.Key.Key_Escape)
    assert not window.central.opened
    assert stage.session.stops == 0, "at rest it closes what lies on top"
    window.start_run()
    stage.happen(STARTED)
    assert (sign(window), stop.key) == ("ARMING", "F12 or Esc")
    stage.happen(*LIVE)
    assert stop.key == "F12 or Esc"
    stage.press(Qt.Key.Key_F9)
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == 1, "in a run it always stops"
    assert window.central.opened, "and closes nothing"
    assert (sign(window), stop.key) == (word(BenchState.GOING_TO_REST), "F12 or Esc")
    stage.happen(*STOPPED)
    assert (sign(window), stop.key) == (word(BenchState.AT_REST), "F12")
    stage.press(Qt.Key.Key_Escape)
    assert stage.session.stops == 1
    assert not window.central.opened


def test_enter_and_escape_answer_nothing_while_unsafe(stage: Stage) -> None:
    stage.happen(OPENED)
    reach(stage, "unsafe")
    for key in (Qt.Key.Key_Return, Qt.Key.Key_Space, Qt.Key.Key_Escape):
        stage.press(key)
        assert find(stage.window, "notices.unsafe").isVisible()
    stage.press(Qt.Key.Key_F4)
    assert not find(stage.window, "notices.unsafe").isVisible()


@pytest.mark.deep
def test_the_content_of_a_card_stays_inside_its_edge_when_the_text_size_changes(stage: Stage) -> None:
    stage.happen(OPENED)
    reach(stage, "unsafe")
    card, band = find(stage.window, "notices.unsafe"), find(stage.window, "unsafe.band")
    for size in ("125", "100"):
        stage.window.look.set_text_size(size)
        QCoreApplication.processEvents()
        left = band.mapTo(card, QPoint(0, 0)).x()
        assert left > 0
        assert left + band.width() <= card.width() - left


def test_a_key_cap_holds_its_key_at_every_text_size(stage: Stage) -> None:
    button = find(stage.window, "status.log")
    before = button.iconSize().width()
    stage.window.look.set_text_size("125")
    assert button.iconSize().width() == pytest.approx(before * text_scale(), abs=1)
    assert text_scale() > 1
    stage.window.look.set_text_size("100")
    assert button.iconSize().width() == before


@pytest.mark.deep
def test_hidden_pages_and_tool_icons_follow_the_text_size(open_stage: OpenStage) -> None:
    stage = open_stage(ahead=True)
    window = stage.window
    until(lambda: len(window.tabs.created_pages) == window.tabs.count(), "for the pages")
    window.resize(1400, 840)
    for at in range(window.tabs.count()):
        window.tabs.setCurrentIndex(at)
        QCoreApplication.processEvents()
    tool, read = find(window, "plot.more"), find(window, "laboratory.count")
    until(read.text, "for the runs of the laboratory")
    window.tabs.setCurrentIndex(0)

    def widths() -> list[int]:
        return [page.minimumSizeHint().width() for page in window.tabs.created_pages.values()]

    before, icon = widths(), tool.iconSize().width()
    window.look.set_text_size("150")
    QCoreApplication.processEvents()
    assert tool.iconSize().width() == pytest.approx(icon * text_scale(), abs=1)
    window.look.set_text_size("100")
    QCoreApplication.processEvents()
    assert (widths(), tool.iconSize().width()) == (before, icon)


def test_red_is_inside_stop_alone_at_rest_and_violet_inside_the_ribbon(stage: Stage) -> None:
    stage.happen(OPENED)
    reach(stage, "live")
    stage.happen(*AT_REST if isinstance(AT_REST, tuple) else (AT_REST,), *STOPPED)
    window = stage.window
    for part in (window.rail, window.status_line, window.strip, window.ribbon):
        image = part.grab().toImage()
        stop = place_of(window.strip.stop_button).translated(-place_of(part).topLeft())
        for x in range(0, image.width(), 3):
            for y in range(0, image.height(), 2):
                color = image.pixelColor(x, y)
                if color.hsvSaturationF() <= 0.6 or color.valueF() < 0.2:
                    continue
                hue = color.hue()
                if min(hue, 360 - hue) <= 10:
                    assert part is window.strip, part
                    assert stop.contains(x, y), (part.objectName(), x, y, color.name())


def test_the_last_event_stands_in_the_status_line_and_can_be_undone(stage: Stage) -> None:
    from app.gui.widgets import tell

    undone: list[bool] = []
    tell(stage.window.tabs, "Static loading accepted", lambda: undone.append(True))
    line = stage.window.status_line
    assert (line.label.text(), line.undo_button.isVisible()) == ("Static loading accepted", True)
    line.undo_button.click()
    assert undone == [True]
    assert not line.undo_button.isVisible()


def test_an_error_stays_in_the_status_line_until_the_log_was_opened(stage: Stage) -> None:
    from app.common import Severity
    from app.gui.widgets import tell

    tell(stage.window, "The card is gone", severity=Severity.ERROR)
    tell(stage.window, "150 Hz: measured")
    assert stage.window.status_line.label.text() == "The card is gone"
    stage.window.toggle_log()
    tell(stage.window, "155 Hz: measured")
    assert stage.window.status_line.label.text() == "155 Hz: measured"


def test_tab_reaches_the_rail_the_strip_and_the_drawers_with_a_ring_of_two_pixels(stage: Stage) -> None:
    stage.happen(OPENED)
    window = stage.window
    for widget in (*window.rail.buttons, window.strip.stop_button, window.ribbon, window.status_line.log_button):
        before = widget.grab().toImage()
        widget.setFocus(Qt.FocusReason.TabFocusReason)
        QCoreApplication.processEvents()
        assert widget.hasFocus(), widget
        after = widget.grab().toImage()
        changed = sum(
            before.pixel(x, y) != after.pixel(x, y) for x in range(after.width()) for y in range(after.height())
        )
        assert changed > 2 * (after.width() + after.height()), widget.objectName()


def test_not_now_leads_to_measure(stage: Stage) -> None:
    stage.window.tabs.setCurrentIndex(4)
    stage.window.central.show_welcome()
    find(stage.window, "welcome.close").click()
    assert stage.window.tabs.currentIndex() == MEASURE
    assert not stage.window.central.is_covered


def test_the_log_follows_whatever_its_size_and_stops_for_a_reader_only(stage: Stage) -> None:
    from protocols.base import LogMessage

    window, log = stage.window, stage.window.log.view
    window.toggle_log()
    stage.happen(OPENED, *(LogMessage(f"line {at}") for at in range(60)))
    bar = log.verticalScrollBar()
    for size in (SIZES[3], SIZES[0], SIZES[2]):
        window.resize(size)
        QCoreApplication.processEvents()
        assert bar.value() == bar.maximum()
        assert log.following
    QTest.keyClick(log, Qt.Key.Key_PageUp)
    until(lambda: not log.following, "for the reader")
    where = bar.value()
    stage.happen(LogMessage("one more"), LogMessage("and one more"))
    assert bar.value() == where, "reading is not disturbed"
    assert "2 newer lines" in log.newest_button.text()
    log.newest_button.click()
    assert bar.value() == bar.maximum()
    assert not log.newest_button.isVisible()


def test_the_smallest_window_is_900_by_540(stage: Stage, tmp_path: Path) -> None:
    stage.window.resize(300, 200)
    QCoreApplication.processEvents()
    assert stage.window.size() == QSize(900, 540)
    assert isinstance(stage.window.strip, BenchStrip)
    assert QApplication.font().pixelSize() == 12


def test_the_rail_has_the_width_of_the_window_s_class_after_another_text_size(stage: Stage) -> None:
    window = stage.window
    for percent, width, rail in (("125", 1250, 70), ("100", 900, 56)):
        window.look.set_text_size(percent)
        window.resize(width, 720)
        QCoreApplication.processEvents()
        assert window.rail.width() == rail
    window.look.set_text_size("100")


@pytest.mark.deep
def test_heads_of_the_runs_are_whole_after_another_text_size(stage: Stage) -> None:
    window = stage.window
    window.resize(1900, 900)
    stage.press(Qt.Key.Key_4, Qt.KeyboardModifier.ControlModifier)
    table = window.tabs.runs.list.table
    until(table.isVisible, "for the table")
    for percent in ("125", "100"):
        window.look.set_text_size(percent)
        QCoreApplication.processEvents()
        header = table.horizontalHeader()
        for at in range(header.count()):
            text = str(table.model().headerData(at, Qt.Orientation.Horizontal) or "")
            assert header.isSectionHidden(at) or header.fontMetrics().horizontalAdvance(text) < header.sectionSize(
                at
            ), (percent, text)
        assert table.verticalHeader().defaultSectionSize() == px(40)


CHECKABLE = ("choice", "chip", "segment")


@pytest.mark.parametrize("theme", [LIGHT, DARK], ids=["light", "dark"])
def test_the_focus_ring_has_two_pixels_on_every_side_of_a_control(qt: QApplication, theme: Tokens) -> None:
    window = QWidget(styleSheet=style_sheet(theme))
    kinds = ("", *CHECKABLE, "tool", "link", "primary", "go", "stop")
    controls: list[QWidget] = [*(configure(QPushButton("Text"), kind=kind) for kind in kinds)]
    controls += [configure(QPushButton("Text", checkable=True, checked=True), kind=kind) for kind in CHECKABLE]
    column(*controls, QLineEdit(), QComboBox(), QPlainTextEdit(), QTableWidget(2, 2), parent=window)
    window.show()
    window.activateWindow()
    rings = {QColor(theme.accent_text).rgb(), QColor(theme.text).rgb()}
    for control in window.findChildren(QWidget, options=Qt.FindChildOption.FindDirectChildrenOnly):
        control.setFocus()
        QCoreApplication.processEvents()
        image, (right, bottom) = control.grab().toImage(), (control.width() - 1, control.height() - 1)
        across, down = right // 2, bottom // 2
        ends = [(at, down) for at in (0, 1, right - 1, right)] + [(across, at) for at in (0, 1, bottom - 1, bottom)]
        assert {image.pixelColor(*at).rgb() for at in ends} <= rings, control.property("kind")
    window.deleteLater()
