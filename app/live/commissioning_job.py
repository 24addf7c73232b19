"""Commissioning of the source in a thread of its own, with the operator's answer, progress and Stop."""

import logging
import threading
from functools import partial
from typing import TYPE_CHECKING

from app.config import BenchConfig
from drivers import BenchError

if TYPE_CHECKING:
    from app.session import CommissionedSource

log = logging.getLogger(__name__)

STOPPED = "stopped by the operator; the source was brought to rest, and no record is stored"
STOPPED_BEFORE = (
    "stopped by the operator before anything was commanded; the source is as it was, and no record is stored"
)


class _StoppedError(BenchError):
    pass


class CommissioningJob:
    """Runs the sequence of `tactor-bench commission`; a session must have released the bench before `start`.

    Args:
        config: the bench file.
        speed: of a simulated bench; None is the virtual clock.
    """

    def __init__(self, config: BenchConfig, speed: float | None) -> None:
        self.config, self._speed = config, speed
        self._confirmed, self._stop = threading.Event(), threading.Event()
        self._thread = threading.Thread(target=self._work, name="commissioning", daemon=False)
        self.started = False
        self.asks_for_high_voltage_off = False
        """Whether the sequence waits until the operator has switched high voltage off."""
        self.exercises: tuple[str, ...] = ()
        """Names of the begun exercises; the last one is being measured."""
        self.fraction = 0.0
        """How much is done, 0 to 1."""
        self.result: CommissionedSource | None = None
        self.error = ""
        """Why there is no result."""

    @property
    def ended(self) -> bool:
        """Whether the bench is released."""
        return self.started and not self._thread.is_alive()

    @property
    def stopping(self) -> bool:
        """Whether Stop was requested."""
        return self._stop.is_set()

    def start(self) -> None:
        """Begin; returns immediately. After Stop nothing is begun."""
        self.started = True
        self._thread.start()

    def confirm_high_voltage_off(self) -> None:
        """Answer that high voltage is off."""
        self._confirmed.set()

    def stop(self) -> None:
        """End with the source at rest, also in the middle of an exercise; returns immediately."""
        self._stop.set()
        self._confirmed.set()

    def _work(self) -> None:
        from app.session import commission

        try:
            self._check_stop(STOPPED_BEFORE)
            self.result = commission(
                self.config,
                self._speed,
                self._wait_for_operator,
                self._begin_exercise,
                partial(self._check_stop, STOPPED),
            )
        except _StoppedError as stopped:
            self.error = str(stopped)
        except (BenchError, OSError) as error:
            self.error = f"not commissioned, and no record is stored: {error}"
        except Exception as error:  # the bench is always connected again
            log.exception("the commissioning failed by an error of this program")
            self.error = f"not commissioned, by an error of this program: {type(error).__name__}: {error}"
        finally:
            self.asks_for_high_voltage_off = False

    def _wait_for_operator(self) -> None:
        self.asks_for_high_voltage_off = True
        self._confirmed.wait()
        self.asks_for_high_voltage_off = False
        self._check_stop(STOPPED_BEFORE)

    def _begin_exercise(self, name: str, fraction: float) -> None:
        self._check_stop(STOPPED)
        self.exercises, self.fraction = (*self.exercises, name), fraction

    def _check_stop(self, text: str) -> None:
        if self._stop.is_set():
            raise _StoppedError(text)
