"""Take the pictures of the documentation from the running program: the window on the simulated bench, on its real wires.

    python docs/take_pictures.py [window] [report]

Works without a screen. The pictures in docs/pictures are made by this script and by nothing else.
"""

import os
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from PySide6.QtCore import QSettings
from PySide6.QtWidgets import QApplication

from app.build import connect
from app.commands import make_protocol
from app.config import load_bench
from app.gui.application import application
from app.gui.book import CAMPAIGN
from app.gui.link import Link
from app.gui.picture import grab
from app.gui.theme import DARK, LIGHT
from app.gui.window import MainWindow
from app.main import main as command
from app.report.content import gather
from app.report.limits import example, read_limits
from app.report.pdf import page_to_sign

PICTURES = Path(__file__).resolve().parent / "pictures"
SPEED = 1.0
SIZE = (1280, 800)


def main() -> int:
    PICTURES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or TAKEN:
        TAKEN[name]()
    return 0


def report() -> None:
    """The page to sign, of a dwell and steps on the virtual clock, with the example's limits."""
    with tempfile.TemporaryDirectory() as folder:
        runs, limits = Path(folder), Path(folder) / "limits.toml"
        for protocol in ("sine-dwell", "voltage-steps"):
            command(["run", protocol, "--speed", "max", "--seed", "7", "--specimen", "T7", "--out", folder])
        limits.write_text(example(), "utf-8")
        page = page_to_sign(gather(runs, "T7", read_limits(limits))[0])
        page.savefig(PICTURES / "report.png", dpi=100)
        print(PICTURES / "report.png")


def window() -> None:
    application()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)  # the run files go where the rest of this does
        with opened(SPEED) as window:
            run_once(window)
        with opened(None) as window:
            carry_through(window)
        os.chdir(PICTURES)


@contextmanager
def opened(speed: float | None) -> Iterator[MainWindow]:
    """A window over the simulated bench; None is the virtual clock."""
    config = load_bench("sim")
    settings = QSettings("settings.ini", QSettings.Format.IniFormat)
    protocol = make_protocol("sine-dwell", [])
    window = MainWindow(Link(lambda: connect(config, speed)), config, protocol, Path("runs"), "T7", settings)
    window.resize(*SIZE)
    window.show()
    until(lambda: window.view.can_run)
    yield window
    window.leave(at_once=True)
    until(lambda: not window.isVisible())


def run_once(window: MainWindow) -> None:
    """A sine dwell, from before it to after it."""
    take(window, "idle")
    window.run()
    until(lambda: len(window.view.points) >= 11 and window.view.drive is not None)
    take(window, "window")
    until(lambda: window.view.outcome is not None)
    take(window, "finished")


def carry_through(window: MainWindow) -> None:
    """Two measurements of a campaign: one that is accepted, one that waits for it."""
    window.pages.setCurrentIndex(CAMPAIGN)
    page = window.campaign
    page.begin("T8")
    for name in ("wiring", "sag"):
        until(lambda: page.desk.sheet is not None and not page.desk.working)
        page.act("run", name)
        until(lambda: page.desk.running != "")
        until(lambda: page.desk.running == "" and not page.desk.working)
        if name == "wiring":
            page.act("accept", name)
    take(window, "campaign")


def take(window: MainWindow, name: str) -> None:
    for theme, suffix in ((LIGHT, ""), (DARK, "-dark")):
        window.set_theme(theme)
        window.tick()
        QApplication.processEvents()
        print(grab(window, PICTURES / f"{name}{suffix}.png"))


def until(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 120
    while not condition():
        if time.monotonic() > deadline:
            raise TimeoutError("the program did not get there within two minutes")
        QApplication.processEvents()
        time.sleep(0.002)


TAKEN: dict[str, Callable[[], None]] = {"window": window, "report": report}

if __name__ == "__main__":
    sys.exit(main())
