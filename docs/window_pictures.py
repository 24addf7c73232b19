"""Pictures of the main window: every page and every state of a run, on the simulated bench's virtual clock.

Each in light and dark, at 1280 x 720 and (-large) at 2560 x 1440.
"""

import dataclasses
import os
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from io import BytesIO
from pathlib import Path

from PIL import Image
from PySide6.QtCore import QBuffer, QSettings
from PySide6.QtWidgets import QApplication

from app.archive.catalogue import Catalogue
from app.cli.headless import make_protocol
from app.config.bench_file import BenchConfig
from app.gui.application import qt_application
from app.gui.laboratory.page import CHART
from app.gui.shell.main_window import InitialForm, MainWindow
from app.gui.shell.page_host import CAMPAIGN, EXPLORE, LABORATORY, MEASURE, RUNS
from app.gui.widgets.background import BackgroundWorker
from app.live.session_link import SessionAdapter
from app.session.bench_connection import BenchConnection, connect
from app.session.request import choose_bench
from app.session.session import SessionEvent
from protocols.base import DriveStarted, PointMeasured, Protocol
from tests.helpers.fleet_runs import GOLDEN, write_laboratory

SIZES = {"": (1280, 720), "-large": (2560, 1440)}
MANY = 10_000
COLOURS, RARE = 256, 64
SETTLE_S = 0.4
"""Time for a page to be repainted after a change of size or theme."""

PATIENCE_S = 120.0

LIMITS = f"""golden = "{GOLDEN}"
[limits.amplitude_at_resonance]
low = "900 um"
high = "1150 um"
"""


def simulated_bench() -> BenchConfig:
    """Return the simulated bench with a seed: pictures taken again differ only where the program does."""
    return choose_bench("sim", "max", seed=7)[0]


class PausableSession(SessionAdapter):
    """Blocks the bench thread, and with it the virtual clock, at the first drive after a number of points until released."""

    def __init__(self, prompts: bool) -> None:
        self.points, self.hold_at = 0, -1
        self.held, self.released = threading.Event(), threading.Event()

        @contextmanager
        def bench() -> Iterator[BenchConnection]:
            with connect(simulated_bench(), None) as laboratory:
                yield dataclasses.replace(laboratory, operator=None) if prompts else laboratory

        super().__init__(bench)

    def hold(self, points: int) -> None:
        """Hold the next run after `points` points."""
        self.points, self.hold_at = 0, points
        self.held.clear()
        self.released.clear()

    def observe(self, event: SessionEvent) -> None:
        super().observe(event)
        self.points += isinstance(event, PointMeasured)
        if isinstance(event, DriveStarted) and self.points == self.hold_at and not self.held.is_set():
            self.held.set()
            self.released.wait()


class Studio:
    """A window on the simulated bench; with `prompts` its prompts wait for an answer."""

    def __init__(self, pictures: Path, protocol: Protocol, settings: QSettings, prompts: bool = False) -> None:
        self._pictures = pictures
        self.link = PausableSession(prompts)
        self.window = MainWindow(self.link, simulated_bench(), InitialForm(protocol, Path("runs"), "T7"), settings)
        self.window.resize(*SIZES[""])
        self.window.show()
        self.until(
            lambda: self.window.state.can_run and len(self.window.tabs.created_pages) == self.window.tabs.count()
        )

    def until(self, condition: Callable[[], object]) -> None:
        deadline = time.monotonic() + PATIENCE_S
        while not condition():
            if time.monotonic() > deadline:
                raise TimeoutError(f"the window did not reach the expected state: {self.window.state.messages[-3:]}")
            QApplication.processEvents()
            time.sleep(0.002)

    def settle(self, seconds: float = SETTLE_S) -> None:
        end = time.monotonic() + seconds
        self.until(lambda: time.monotonic() > end)

    def look_at(self, page: int) -> None:
        self.window.tabs.setCurrentIndex(page)
        self.settle(1.5)

    def run(self, points: int) -> None:
        """Start a run and hold it after `points` points."""
        self.link.hold(points)
        self.window.measure_page.run_panel.run_button.click()
        self.until(self.link.held.is_set)
        self.settle(1.0)

    def finish(self) -> None:
        """Release the run and wait for its end."""
        self.link.released.set()
        self.until(lambda: self.window.state.outcome is not None)

    def take(self, name: str) -> None:
        """Take the four pictures of a state: two sizes, two themes."""
        for suffix, size in SIZES.items():
            self.window.look.set_text_size("125" if suffix else "100")  # as "automatic" does on such a screen
            self.window.resize(*size)
            for appearance, shade in (("light", ""), ("dark", "-dark")):
                self.window.look.set_appearance(appearance)
                self.settle()
                self._save(self._pictures / f"{name}{suffix}{shade}.png", size)
        self.window.look.set_text_size("100")
        self.window.resize(*SIZES[""])
        self.window.look.set_appearance("light")

    def close(self) -> None:
        self.window.close_session(force=True)
        self.until(lambda: not self.window.isVisible())
        self.window.deleteLater()

    def _save(self, path: Path, size: tuple[int, int]) -> None:
        picture = self.window.grab()
        got = (picture.width(), picture.height())
        if got != size:
            raise ValueError(f"{path.name}: the window needs {got}, more than a screen of {size}")
        buffer = QBuffer()
        buffer.open(QBuffer.OpenModeFlag.WriteOnly)
        picture.save(buffer, "PNG")
        image = Image.open(BytesIO(buffer.data().data())).convert("RGB")
        image.quantize(palette=_palette(image), dither=Image.Dither.NONE).save(path, optimize=True)
        print(path)


def _palette(image: Image.Image) -> Image.Image:
    """Return the most frequent colours and some rare ones, such as a single amber line; the file is a third as large."""
    counted = sorted(image.getcolors(1 << 24), reverse=True)
    rare = image.quantize(RARE, method=Image.Quantize.MAXCOVERAGE).getpalette() or []
    palette = Image.new("P", (1, 1))
    palette.putpalette([level for _, colour in counted[: COLOURS - RARE] for level in colour] + rare[: 3 * RARE])
    return palette


def take(pictures: Path) -> None:
    """Take all pictures into a folder."""
    qt_application()
    before = Path.cwd()
    with tempfile.TemporaryDirectory(prefix="tactor-bench-") as folder:
        os.chdir(folder)  # runs, settings and the catalogue are written into the temporary folder
        os.environ["XDG_CONFIG_HOME"] = os.environ["XDG_CACHE_HOME"] = folder
        settings = QSettings("settings.ini", QSettings.Format.IniFormat)
        run = measuring(Studio(pictures, make_protocol("sine-dwell", []), settings))
        prompt(Studio(pictures, make_protocol("static-loading", []), settings, prompts=True))
        laboratory(Studio(pictures, make_protocol("sine-dwell", []), settings))
        fill_archive(run)
        archive(Studio(pictures, make_protocol("sine-dwell", []), settings), run)
        os.chdir(before)


def measuring(studio: Studio) -> Path:
    """Take the pictures before, during and after a run, after a stop and after a fault; return the file of the finished run."""
    window = studio.window
    window.central.show_welcome()
    studio.settle()
    studio.take("first")
    window.central.show_pages()
    studio.take("idle")
    for page, name in ((CAMPAIGN, "campaign-empty"), (RUNS, "runs-empty"), (EXPLORE, "explore")):
        studio.look_at(page)
        studio.take(name)
    studio.look_at(MEASURE)
    studio.run(11)
    studio.take("window")
    studio.finish()
    studio.take("finished")
    finished = Path(window.state.outcome.path)
    studio.run(5)
    window.strip.stop_button.click()
    studio.finish()
    studio.take("stopped")
    studio.run(5)
    window.faults.fault_boxes["generator-power-off"].click()
    studio.until(lambda: window.faults.active_faults)
    studio.finish()
    studio.settle(1.0)
    studio.take("unsafe")
    studio.close()
    return finished


def prompt(studio: Studio) -> None:
    """Take the picture of a prompt to place a weight."""
    window = studio.window
    window.measure_page.run_panel.run_button.click()
    studio.until(lambda: window.state.prompt is not None)
    while window.state.prompt.prompt.action != "place-weight":
        ask = window.state.prompt.ask_id
        studio.until(lambda: window.notices.prompt.accepts_input)
        window.notices.prompt.buttons[0].click()
        studio.until(lambda ask=ask: window.state.prompt is not None and window.state.prompt.ask_id != ask)
    studio.settle(1.0)
    studio.take("prompt")
    studio.close()


def laboratory(studio: Studio) -> None:
    """Take the pictures of fifty specimens in three batches, and of the control chart of a laser that drifts."""
    write_laboratory(Path("laboratory"))
    Path("laboratory/limits.toml").write_text(LIMITS, "utf-8")
    tabs = studio.window.tabs
    tabs.measure.run_panel.folder_edit.setText("laboratory")
    studio.look_at(LABORATORY)
    studio.until(lambda: tabs.laboratory.fleet.view is not None)
    studio.take("laboratory")
    tabs.laboratory.show_view(CHART)
    studio.until(lambda: tabs.laboratory.chart.view is not None)
    studio.take("laboratory-chart")
    tabs.measure.run_panel.folder_edit.setText("runs")
    studio.close()


def fill_archive(run: Path) -> None:
    """Add ten thousand runs to the folder: links to one file under different names."""
    catalogue = Catalogue(Path("runs"))
    catalogue.scan()
    one = next(entry for entry in catalogue.entries() if entry.name == run.name)
    entries = []
    for i in range(MANY):
        day, specimen = f"2026-{1 + i % 9:02d}-{1 + i // 9 % 28:02d}", f"T{1 + i % 40}"
        name = f"{day.replace('-', '')}T{8 + i % 10:02d}{i % 60:02d}00Z_{specimen}_sine-dwell_{i:05d}.h5"
        os.link(run, Path("runs") / name)
        start = f"{day}T{8 + i % 10:02d}:{i % 60:02d}:00+00:00"
        entries.append(one._replace(path=name, specimen=specimen, start_time=start, notes_ns=0))
    catalogue.upsert(entries)


def archive(studio: Studio, run: Path) -> None:
    """Take the pictures of the list of ten thousand runs, of an opened run and of a campaign."""
    window = studio.window
    studio.look_at(RUNS)
    studio.until(lambda: window.tabs.runs.list.model.rowCount() >= MANY and window.tabs.runs.list.folder_model.is_idle)
    window.tabs.runs.list.select_paths([run.name])
    studio.settle(1.0)
    studio.take("runs")
    window.tabs.runs.open_selected()
    studio.until(lambda: window.tabs.runs.currentWidget() is window.tabs.runs.viewer)
    studio.settle(2.0)
    studio.take("run")
    campaign(studio)
    studio.close()


def campaign(studio: Studio) -> None:
    """Run two measurements of a campaign, accept the first, take the picture with the second to be accepted."""
    studio.look_at(CAMPAIGN)
    page = studio.window.tabs.campaign
    page.create_campaign("T8")
    workers = page.controller.findChildren(BackgroundWorker)
    for name in ("wiring", "sag"):
        studio.until(lambda: page.controller.summary is not None and not any(each.pending for each in workers))
        page.perform_action("run", name)
        studio.until(lambda: page.controller.running_item != "")
        studio.until(lambda: page.controller.running_item == "" and not any(each.pending for each in workers))
        if name == "wiring":
            page.perform_action("accept", name)
    studio.take("campaign")
