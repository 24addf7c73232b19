"""Main window with a recording session adapter: tests send events and press keys."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from PySide6.QtCore import QCoreApplication, QEvent, QMimeData, QPoint, QPointF, QSettings, Qt, QUrl
from PySide6.QtGui import QDragEnterEvent, QDropEvent
from PySide6.QtTest import QTest
from PySide6.QtWidgets import QApplication, QLabel, QMainWindow, QWidget

from app.config.bench_file import BenchConfig
from app.gui.campaign import CampaignController
from app.gui.shell import collect_garbage_here
from app.gui.shell.main_window import InitialForm, MainWindow
from app.gui.status.bench_strip import LOOKS, look_of
from app.gui.widgets import Told
from app.live.session_link import SessionAdapter
from app.session import BenchState
from app.session.bench_connection import BenchConnection, connect
from app.session.session import Observation, SessionEvent
from app.session.simulation import AnsweredBy, SimulationSettings
from protocols.base import PointMeasured, Protocol
from protocols.runner.request import RunRequest

PATIENCE_S = 60.0


def until(condition: Callable[[], object], words: str = "") -> None:
    """Let Qt work until something is so."""
    deadline = time.monotonic() + PATIENCE_S
    pause_s = 0.001
    while not condition():
        assert time.monotonic() < deadline, f"waited in vain {words}"
        QCoreApplication.processEvents()
        QCoreApplication.sendPostedEvents(None, QEvent.Type.DeferredDelete)
        time.sleep(pause_s)
        pause_s = min(1.3 * pause_s, 0.01)


def until_read(controller: CampaignController) -> None:
    """Let Qt work until the campaign is read and fitted."""
    workers = controller._file_worker, controller._fit_worker
    until(lambda: controller.summary is not None and not any(each.pending for each in workers), "for the campaign")


def press(window: MainWindow, key: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
    """Press a key in a window; a window that is not the active one has no shortcuts."""
    if not window.isActiveWindow():
        window.activateWindow()
        until(window.isActiveWindow, "for the window to be active")
    QTest.keyClick(window, key, modifier)


def find(root: QWidget, name: str) -> Any:
    """Return the widget with an object name below another one."""
    found = root.findChild(QWidget, name)
    assert found is not None, f"there is no widget {name}"
    return found


def drop_file(widget: QWidget, path: Path) -> None:
    """Drag a file over a widget, which accepts it, and drop it there."""
    mime, none = QMimeData(), Qt.KeyboardModifier(0)
    mime.setUrls([QUrl.fromLocalFile(str(path))])
    entering = QDragEnterEvent(QPoint(5, 5), Qt.DropAction.CopyAction, mime, Qt.MouseButton.LeftButton, none)
    QApplication.sendEvent(widget, entering)
    assert entering.isAccepted()
    dropped = QDropEvent(QPointF(5, 5), Qt.DropAction.CopyAction, mime, Qt.MouseButton.LeftButton, none)
    QApplication.sendEvent(widget, dropped)


def grab(window: MainWindow, path: Path) -> None:
    """Save what a window shows as PNG."""
    assert window.grab().save(str(path))


@dataclass
class ListeningSession:
    """Records requests and does nothing else."""

    bench: Any = None
    runs: list[tuple[Protocol, Path, str]] = field(default_factory=list)
    continued: list[Any] = field(default_factory=list)
    again: list[tuple[Path, tuple[int, ...], Path]] = field(default_factory=list)
    prepared: list[Any] = field(default_factory=list)
    stops: int = 0
    pauses: int = 0
    resumes: int = 0
    closed: bool = False
    lets_go: bool = True
    """Whether it ends immediately when closed."""
    abandoned: bool = False
    observation: Observation = field(default_factory=Observation)

    def start(self) -> None: ...

    def run(self, request: RunRequest) -> None:
        self.runs.append((request.protocol, request.folder, request.specimen))
        if request.prepare:
            self.prepared.append(request.prepare)
        if request.resume is not None:
            self.continued.append(request.resume)

    def repeat_entries(self, path: Path, entries: Any, folder: Path) -> None:
        self.again.append((path, tuple(entries), folder))

    def pause(self) -> None:
        self.pauses += 1

    def resume(self) -> None:
        self.resumes += 1

    def stop(self) -> None:
        self.stops += 1

    def monitor(self, active: bool) -> None: ...

    def inject_event(self, event: Any) -> None: ...

    def close(self, _timeout_s: float | None = None) -> bool:
        self.closed = True
        return self.lets_go


class ListeningFrame(QMainWindow):
    """Window around a page that keeps what the page tells."""

    def __init__(self) -> None:
        super().__init__()
        self.told: list[Told] = []

    def event(self, event: QEvent) -> bool:
        if isinstance(event, Told):
            self.told.append(event)
            return True
        return super().event(event)


@dataclass
class Stage:
    """A shown window with functions to operate it."""

    window: MainWindow
    session: ListeningSession

    def happen(self, *events: SessionEvent) -> None:
        """Emit events as the bench thread does, and let the window process them."""
        for event in events:
            self.window.adapter.observe(event)
        self.window.tick()

    def press(self, key: Qt.Key, modifier: Qt.KeyboardModifier = Qt.KeyboardModifier.NoModifier) -> None:
        press(self.window, key, modifier)


class Bench(SessionAdapter):
    """Simulated bench, with fault injection when a point is measured.

    Args:
        speed: of a served bench, whose prompts wait for the window; None is the virtual clock, on which the simulation answers.
    """

    def __init__(self, config: BenchConfig, speed: float | None = None) -> None:
        self.laboratory: BenchConnection | None = None
        self.at_a_point: Callable[[BenchConnection], None] = lambda _: None

        @contextmanager
        def open_bench() -> Iterator[BenchConnection]:
            with connect(config, speed) as self.laboratory:
                yield self.laboratory

        super().__init__(open_bench, simulation=SimulationSettings(speed, AnsweredBy.USER))

    def observe(self, event: SessionEvent) -> None:
        super().observe(event)
        if isinstance(event, PointMeasured) and self.laboratory is not None:
            self.at_a_point(self.laboratory)


def tells_what_to_do_by_hand(window: Any) -> bool:
    """Whether the card of the unsafe state is visible, whole, and has every act of the safety text."""
    card = find(window, "notices.unsafe")
    texts = " ".join(label.text() for label in card.findChildren(QLabel) if label.isVisible())
    acts = ("specimen", "high voltage OFF", "display reads 0 V", "touch neither the specimen", "cable")
    return bool(card.isVisible() and all(act in texts for act in acts))


def word(state: BenchState) -> str:
    """The word of a state on the sign."""
    return LOOKS[str(state)].word


def sign(window: Any) -> str:
    """The word of a window's sign."""
    view = window.strip.view
    assert view is not None
    return look_of(view).word


OpenStage = Callable[..., Stage]
OpenPage = Callable[[Callable[[], Any]], Any]


@contextmanager
def whole_window(
    bench: SessionAdapter,
    config: BenchConfig,
    protocol: Protocol,
    folder: Path,
    settings: QSettings,
    open_bench: str = "ideal",
) -> Iterator[MainWindow]:
    """A window that is active and has its bench, with specimen T7."""
    with collect_garbage_here():
        window = MainWindow(bench, config, InitialForm(protocol, folder, "T7"), settings, open_bench=open_bench)
        window.show()
        window.activateWindow()
        assert QTest.qWaitForWindowActive(window, 30_000)
        until(lambda: window.state.connected, "for the bench")
        yield window
        end(window)


def end(window: MainWindow) -> None:
    """Close a window whatever it shows, and delete it."""
    window.setUpdatesEnabled(False)  # nothing that is shown now is looked at
    window.close_session(force=True)
    until(lambda: not window.isVisible(), "for the window to close")
    window.deleteLater()
    QCoreApplication.sendPostedEvents(window, QEvent.Type.DeferredDelete)
