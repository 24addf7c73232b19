"""Every page of the window at five sizes and one scale factor, searched for texts that are cut, overlap or are out of reach.

    python -m tests.helpers.size_matrix --scale 1.25 [--pictures FOLDER]

A process has one scale factor. Prints one line for each fault, and exits with 1 if there is one.
"""

import argparse
import json
import os
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, cast

if TYPE_CHECKING:
    from PySide6.QtCore import QRect
    from PySide6.QtWidgets import QWidget

    from app.gui.shell.main_window import MainWindow

SIZES = ((900, 560), (1093, 614), (1366, 768), (1920, 1080), (2560, 1440))
SCREEN = (2560, 1440)
SCALES = (1.0, 1.25, 1.5, 2.0)
ALWAYS_WHOLE = ("strip", "status", "status.stop", "status.pause")
"""Strip, status line, Stop and Pause: never cut, never scrolled away."""

STATES = {
    "idle": range(6),
    "finished": range(6),
    "adding": (1,),
    "stopped": (0, 1, 3),
    "prompt": (0, 1),
    "live": (0, 4),
    "unsafe": (0, 4),
}
"""States with the pages that are looked at, every second one in dark. A campaign is open, and its result is to be accepted."""
MAX_PAGES_AT_TWO_SIZES = 3
WEIGHT = "Put the 200 g weight on the centre of the tactor, and wait until it rests."
SIDEWAYS_BELOW = 900
"""Only a narrower window scrolls its pages sideways."""


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scale", type=float, default=1.0, choices=SCALES)
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each page at each size")
    options = parser.parse_args()
    with tempfile.TemporaryDirectory(prefix="tactor-bench-") as folder:
        screen = Path(folder, "screen.json")
        size = {"width": SCREEN[0], "height": SCREEN[1]}
        screen.write_text(
            json.dumps(
                {
                    "synchronousWindowSystemEvents": False,
                    "windowFrameMargins": True,
                    "screens": [
                        {"name": "screen", "x": 0, "y": 0, **size, "logicalDpi": 96, "logicalBaseDpi": 96, "dpr": 1.0}
                    ],
                }
            )
        )
        os.environ |= {
            "QT_QPA_PLATFORM": f"offscreen:configfile={screen}",
            "QT_SCALE_FACTOR": f"{options.scale:g}",
            **{f"XDG_{name}_HOME": folder for name in ("CONFIG", "CACHE", "DATA", "STATE")},
        }
        found = 0
        for fault in _faults(Path(folder), options.scale, options.pictures):
            print(fault, flush=True)
            found += 1
    print(f"{options.scale:.0%}: {found or 'no'} faults")
    return int(found > 0)


def _faults(folder: Path, scale: float, pictures: Path | None) -> Iterator[str]:
    """Yield the faults of every page in every state, size and theme."""
    from PySide6.QtCore import QSettings
    from PySide6.QtGui import QAction
    from PySide6.QtWidgets import QApplication

    from app.campaign.campaign import Campaign
    from app.campaign.plan import PAPER_ITEMS, CampaignItem, campaign_path
    from app.config.bench_file import load_bench
    from app.gui.application import qt_application
    from app.gui.face import DARK, LIGHT
    from app.gui.face.typeface import LARGE_SCREEN
    from app.gui.shell.page_host import TITLES
    from protocols.base import Prompt, PromptAnswered, PromptShown
    from protocols.measurements.sine_dwell import SineDwell
    from tests.helpers.main_window import Bench, until, whole_window
    from tests.helpers.session_events import LIVE, LOST
    from tests.helpers.text_places import faults_of_window

    qt_application()
    settings = QSettings(str(folder / "settings.ini"), QSettings.Format.IniFormat)
    settings.setValue("window/text-size", "100")
    config, runs = load_bench("ideal"), folder / "runs"
    runs.mkdir()
    dwell = CampaignItem("dwell", "sine-dwell", {"frequencies_hz": (100.0, 160.0)})
    Campaign.create(runs, "T7", True, (dwell, *PAPER_ITEMS[:4]))
    settings.setValue("campaign/open", str(campaign_path(runs, "T7")))
    bench = Bench(config)
    with whole_window(bench, config, SineDwell(frequencies_hz=(100.0, 160.0)), runs, settings) as window:
        until(lambda: len(window.tabs.created_pages) == window.tabs.count(), "for the pages")
        campaign, weight = window.tabs.campaign, Prompt("place-weight", WEIGHT, {"mass_kg": 0.2})
        for at, (state, pages) in enumerate(STATES.items()):
            theme = (LIGHT, DARK)[at % 2]
            window.look.set_appearance("dark" if theme is DARK else "light")
            if state in ("finished", "stopped"):
                bench.at_a_point = lambda _, stops=state == "stopped": bench.session.stop() if stops else None
                window.tabs.setCurrentIndex(0)
                window.start_run()
                until(lambda: window.state.busy, "for the run")
                until(lambda: not window.state.busy, "for the end of the run")
                _select_newest(window)
                until(lambda: campaign.board.details.review is not None, "for the result")
            if state == "adding":
                window.tabs.setCurrentIndex(1)
                campaign.findChild(QAction, "campaign.add").trigger()
            else:
                campaign.go_back()
            shown = {"prompt": (*LIVE, PromptShown(1, weight)), "live": (PromptAnswered(1, "done"),), "unsafe": LOST}
            for event in shown.get(state, ()):
                window.adapter.observe(event)
            if state == "prompt":
                window.adapter.mailbox.show(1, weight)
            window.tick()
            held = [size for size in SIZES if size[0] * scale <= SCREEN[0] and size[1] * scale <= SCREEN[1]]
            for width, height in held if len(pages) > MAX_PAGES_AT_TWO_SIZES else held[::2]:
                large = width >= LARGE_SCREEN.width() and height >= LARGE_SCREEN.height()
                window.look.set_text_size("125" if large else "100")  # as "automatic" does on such a screen
                window.resize(width, height)
                for page in pages:
                    window.tabs.setCurrentIndex(page)
                    where = f"{width}x{height} {scale:.0%} {state} {TITLES[page]}"
                    for _ in range(4):
                        QApplication.processEvents()
                    if pictures is not None:
                        pictures.mkdir(parents=True, exist_ok=True)
                        name = f"{where.replace(' ', '-')}-{'light' if theme is LIGHT else 'dark'}.png"
                        window.grab().save(str(pictures / name))
                    found = [*cut_widgets(window), *faults_of_window(window)]
                    for _ in range(20 * bool(found)):  # a value that came this moment: its layout is not done
                        QApplication.processEvents()
                        time.sleep(0.01)
                    yield from (
                        f"{where}: {fault}"
                        for fault in (*cut_widgets(window), *faults_of_window(window))
                        if fault in found
                    )


def _select_newest(window: "MainWindow") -> None:
    """Select the last run on the page Runs, and wait for its card."""
    from tests.helpers.main_window import until

    assert window.state.outcome is not None
    runs, newest = window.tabs.runs, Path(window.state.outcome.path).name
    window.tabs.setCurrentIndex(3)
    until(lambda: any(entry.name == newest for entry in runs.list.model.summaries), "for the list")
    runs.list.select_paths([entry.path for entry in runs.list.model.summaries if entry.name == newest])
    until(lambda: runs.details.card.isVisibleTo(window), "for the card of the run")


def cut_widgets(window: "MainWindow") -> Iterator[str]:
    """Yield what is cut, out of reach, or elided although it must not be."""
    from PySide6.QtWidgets import QAbstractButton, QCheckBox, QComboBox, QLabel, QLineEdit, QScrollArea, QWidget

    from app.common import PLAIN_NUMBER, TRUE_MINUS
    from app.gui.face import CLASS_S, class_of
    from app.gui.shell.rail import RailButton
    from app.gui.widgets.labels import ElidedLabel

    least = window.minimumSizeHint()
    if least.width() > window.width() or least.height() > window.height():
        yield f"the window is {window.width()} x {window.height()} and its contents need {least.width()} x {least.height()}"
    page = cast("QWidget", window.tabs.current_page)
    area = cast("QWidget", page.parentWidget()).parentWidget()
    if isinstance(area, QScrollArea) and window.width() >= SIDEWAYS_BELOW and area.horizontalScrollBar().maximum():
        yield f"the page scrolls sideways: it needs {page.minimumSizeHint().width()} points of {area.width()}"
    for name in ALWAYS_WHOLE:
        widget = window.findChild(QWidget, name)
        if widget is None or not widget.isVisible():
            yield f"{name} is not visible"
        elif widget.visibleRegion().boundingRect() != widget.rect():
            yield f"{name} is cut: {widget.visibleRegion().boundingRect()} of {widget.rect()}"
    for widget in window.findChildren(QWidget):
        if not widget.isVisible() or not isinstance(widget, QAbstractButton | QComboBox | QLabel | QLineEdit):
            continue
        who = f"{type(widget).__name__} {widget.objectName() or repr(widget.property('text'))}"
        outside = _outside(widget)
        if outside:
            yield f"{who} is cut by {outside}"
        if isinstance(widget, RailButton) and class_of(window) is CLASS_S:
            continue  # an icon alone
        if isinstance(widget, QAbstractButton) and widget.text():
            needed = max(map(widget.fontMetrics().horizontalAdvance, widget.text().split("\n")))
            if not widget.icon().isNull():
                needed += widget.iconSize().width()
            if isinstance(widget, QCheckBox):
                needed = widget.minimumSizeHint().width()
            if needed > widget.width():
                yield f"{who}: {widget.text()!r} needs {needed} of {widget.width()} points"
        elif isinstance(widget, QComboBox) and widget.minimumContentsLength() == 0:
            needed = widget.fontMetrics().horizontalAdvance(widget.currentText())
            if needed > widget.width() - 24:
                yield f"{who}: {widget.currentText()!r} needs {needed} of {widget.width() - 24} points"
        elif isinstance(widget, QLineEdit) and PLAIN_NUMBER.fullmatch(widget.text().replace(TRUE_MINUS, "-")):
            needed = widget.fontMetrics().horizontalAdvance(widget.text()) + widget.minimumSizeHint().width()
            needed += (
                4 - widget.fontMetrics().maxWidth()
            )  # the hint is for one character, without the 2 points at each end
            if needed > widget.width():
                yield f"{who}: {widget.text()!r} needs {needed} of {widget.width()} points"
        elif isinstance(widget, QLabel) and widget.text() and not isinstance(widget, ElidedLabel):
            if widget.wordWrap():
                needed = widget.heightForWidth(widget.width())
                if needed > widget.height() + 1:
                    yield f"{who}: {widget.text()!r} needs a height of {needed}, not {widget.height()}"
            elif widget.minimumSizeHint().width() > widget.width() + 1:
                yield f"{who}: {widget.text()!r} needs {widget.minimumSizeHint().width()} of {widget.width()} points"


def _outside(widget: "QWidget") -> str:
    """Return the name of what cuts a widget; what can be scrolled into view is not cut."""
    from PySide6.QtCore import Qt
    from PySide6.QtWidgets import QAbstractScrollArea, QMainWindow

    inner: QRect = widget.rect()
    at, parent = widget, widget.parentWidget()
    while parent is not None:
        inner = inner.translated(at.pos())
        grandparent = parent.parentWidget()
        if isinstance(grandparent, QAbstractScrollArea) and parent is grandparent.viewport():
            area = grandparent
            sideways, upright = area.horizontalScrollBar(), area.verticalScrollBar()
            fixed = area.horizontalScrollBarPolicy() == Qt.ScrollBarPolicy.ScrollBarAlwaysOff
            if (fixed or sideways.maximum() == 0) and (inner.left() < 0 or inner.right() > parent.width()):
                return f"the width of {area.objectName() or type(area).__name__} ({inner.right()} of {parent.width()})"
            if upright.maximum() == 0 and (inner.top() < 0 or inner.bottom() > parent.height()):
                return f"the height of {area.objectName() or type(area).__name__}"
            return ""
        if not parent.rect().adjusted(-1, -1, 1, 1).contains(inner):
            return f"{parent.objectName() or type(parent).__name__} ({inner} in {parent.rect()})"
        if isinstance(parent, QMainWindow):
            return ""
        at, parent = parent, grandparent
    return ""


if __name__ == "__main__":
    sys.exit(main())
