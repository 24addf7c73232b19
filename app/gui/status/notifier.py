"""Notifications: a sound and a notice of the desktop when the operator is needed, a run has ended, or the bench is unsafe."""

import io
import shutil
import sys
import tempfile
import wave
from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from PySide6.QtCore import QObject, QProcess, QSettings, QTimer
from PySide6.QtGui import QGuiApplication, QIcon
from PySide6.QtWidgets import QApplication, QMainWindow, QStyle, QSystemTrayIcon

from app.common import OUTCOME_SYMBOLS
from app.gui.widgets import BackgroundWorker, at_end
from app.session import BenchState, WindowState

SOUND_KEY, NOTICE_KEY = "notify/sound", "notify/notice"
PROMPT_DELAY_MS = 800
"""A prompt that is answered sooner, as by the simulated operator, is not announced."""
NOTICE_MS = 15_000
RATE_HZ = 22_050
TONES: dict[str, Sequence[tuple[float, float]]] = {
    "prompt": ((660.0, 0.14), (880.0, 0.2)),
    "done": ((880.0, 0.12), (660.0, 0.22)),
    "unsafe": ((988.0, 0.18), (494.0, 0.18)) * 4,
}
"""Frequencies in hertz with durations in seconds, by kind."""
PLAYERS = ("pw-play", "paplay", "aplay")
"""Programs of Linux that play a WAV file; the first that is installed is used."""


class Notifier(QObject):
    """Compares each window state with the last one.

    Args:
        window: is alerted, and is not in front if a notice is to be shown.
        settings: whether sounds and notices are enabled.
        play: plays one of `TONES`.
        notify: shows a notice of the desktop: title and text.
    """

    def __init__(
        self,
        window: QMainWindow,
        settings: QSettings,
        play: Callable[[str], object] | None = None,
        notify: Callable[[str, str], object] | None = None,
    ) -> None:
        super().__init__(window)
        self._window, self._settings = window, settings
        self._sounds = SoundPlayer(self)
        self._play, self._notify = play or self._sounds.play, notify or self._show_notice
        self._state: WindowState | None = None
        self._tray: QSystemTrayIcon | None = None
        self._prompt_timer = QTimer(self, singleShot=True, interval=PROMPT_DELAY_MS)
        self._prompt_timer.timeout.connect(self._announce_prompt)
        at_end(self, self._prompt_timer.stop)

    def is_on(self, key: str) -> bool:
        """Return whether sounds or notices are enabled."""
        return str(self._settings.value(key, "true")).casefold() != "false"

    def switch(self, key: str, on: bool) -> None:
        """Switch sounds or notices on or off, now and for later starts."""
        self._settings.setValue(key, "true" if on else "false")

    def set_state(self, state: WindowState) -> None:
        """Announce changes since the last state."""
        before, self._state = self._state, state
        if before is None:
            return
        if state.unsafe and not before.unsafe:
            self._announce("unsafe", "UNSAFE: the specimen may carry high voltage", state.unsafe)
        elif state.bench_state is BenchState.DRIVE_LOST and before.bench_state is not BenchState.DRIVE_LOST:
            self._announce("unsafe", "DRIVE LOST: the specimen may carry high voltage", state.messages[-1].text)
        if state.prompt is None:
            self._prompt_timer.stop()
        elif before.prompt is None or before.prompt.ask_id != state.prompt.ask_id:
            self._prompt_timer.start()
        if before.busy and not state.busy and state.outcome is not None and not state.unsafe:
            verdict = state.outcome.verdict.outcome
            title = f"{OUTCOME_SYMBOLS.get(verdict, '')} {state.progress.title if state.progress else 'Run'}: {verdict}"
            self._announce("done", title.strip(), state.outcome.reason)

    def _announce_prompt(self) -> None:
        if self._state is not None and self._state.prompt is not None:
            self._announce("prompt", "Operator needed", self._state.prompt.prompt.text)

    def _announce(self, kind: str, title: str, text: str) -> None:
        mark = "SIMULATED: " if self._state is not None and self._state.simulated else ""
        if self.is_on(SOUND_KEY):
            self._play(kind)
        if self.is_on(NOTICE_KEY) and (kind == "unsafe" or not self._window.isActiveWindow()):
            self._notify(f"{mark}{title}", text)

    def _show_notice(self, title: str, text: str) -> None:
        QApplication.alert(self._window)
        if not QSystemTrayIcon.isSystemTrayAvailable():
            return
        if self._tray is None:
            icon = self._window.windowIcon()
            if icon.isNull():
                icon = self._window.style().standardIcon(QStyle.StandardPixmap.SP_ComputerIcon)
            self._tray = QSystemTrayIcon(QIcon(icon), self)
            at_end(self, self._tray.hide)
            self._tray.activated.connect(lambda _: self._window.activateWindow())
        self._tray.show()
        self._tray.showMessage(title, text, QSystemTrayIcon.MessageIcon.Information, NOTICE_MS)


class SoundPlayer(QObject):
    """Plays tones by a program of the system, started in the background; the system's bell where there is none."""

    def __init__(self, parent: QObject) -> None:
        super().__init__(parent)
        self._worker = BackgroundWorker("sounds", self)
        at_end(self, self._remove_files)
        self._folder: tempfile.TemporaryDirectory[str] | None = None

    def play(self, kind: str) -> None:
        """Play one of `TONES`."""
        if QGuiApplication.platformName() != "offscreen":
            self._worker.submit(
                lambda: self._start(kind),
                lambda started: None if started else QApplication.beep(),
                lambda _: QApplication.beep(),
            )

    def _remove_files(self) -> None:
        if self._folder is not None:
            self._folder.cleanup()

    def _start(self, kind: str) -> bool:
        path = self._file(kind)
        if sys.platform == "win32":
            import winsound

            winsound.PlaySound(str(path), winsound.SND_FILENAME | winsound.SND_ASYNC | winsound.SND_NODEFAULT)
            return True
        names = ("afplay",) if sys.platform == "darwin" else PLAYERS
        player = next((program for name in names if (program := shutil.which(name))), None)
        return player is not None and bool(QProcess.startDetached(player, [str(path)])[0])

    def _file(self, kind: str) -> Path:
        if self._folder is None:
            self._folder = tempfile.TemporaryDirectory(prefix="tactor-bench-sounds-")
        path = Path(self._folder.name, f"{kind}.wav")
        if not path.exists():
            path.write_bytes(tone_wave(TONES[kind]))
        return path


def tone_wave(tones: Sequence[tuple[float, float]]) -> bytes:
    """Return tones as a WAV file, each faded in and out within 10 ms so that it does not click."""
    samples = []
    for frequency_hz, duration_s in tones:
        count, fade = round(RATE_HZ * duration_s), RATE_HZ // 100
        at = np.arange(count)
        envelope = np.clip(np.minimum(at, count - at) / fade, None, 1.0)
        samples.append(np.rint(14_000 * envelope * np.sin(2 * np.pi * frequency_hz * at / RATE_HZ)).astype("<i2"))
    data = io.BytesIO()
    with wave.open(data, "wb") as file:
        file.setnchannels(1)
        file.setsampwidth(2)
        file.setframerate(RATE_HZ)
        file.writeframes(np.concatenate(samples).tobytes())
    return data.getvalue()
