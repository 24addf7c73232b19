"""Commissioning of a bench in a thread of its own, with prompts to the operator, progress and Stop."""

import itertools
import logging
import threading
from functools import partial
from typing import TYPE_CHECKING

from app.config import BenchConfig
from app.live.session_link import SessionAdapter
from drivers import BenchError
from protocols.base import Prompt, PromptAnswered, PromptShown

if TYPE_CHECKING:
    from app.session import CommissionedSource

log = logging.getLogger(__name__)

STOPPED = "stopped by the operator; the source was brought to rest, and no record is stored"
STOPPED_BEFORE = (
    "stopped by the operator before anything was commanded; the source is as it was, and no record is stored"
)
STOPPED_AT_INTERLOCK = "stopped by the operator at rest; switch the high voltage OFF at the amplifier. The interlock is stored as not measured"

POLL_S = 0.05
_PROMPT_IDS = itertools.count(-1, -1)
"""Ids of prompts; negative, so that they never equal the ids of a run's prompts."""


class _StoppedError(BenchError):
    pass


class CommissioningJob:
    """Runs the sequence of `tactor-bench commission`; a session must have released the bench before `start`.

    Args:
        config: the bench file.
        adapter: shows prompts and events, and has the settings of a simulated bench.
    """

    def __init__(self, config: BenchConfig, adapter: SessionAdapter) -> None:
        self.config, self._adapter = config, adapter
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._work, name="commissioning", daemon=False)
        self.started = False
        self.asks = False
        """Whether the sequence waits for the operator's answer."""
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

    def stop(self) -> None:
        """End with the source at rest, also in the middle of an exercise; returns immediately."""
        self._stop.set()

    def _work(self) -> None:
        from app.session import commission

        simulation = self._adapter.simulation
        try:
            self._check_stop()
            self.result = commission(
                self.config,
                None if simulation is None else simulation.speed,
                self._ask,
                self._begin_exercise,
                self._check_stop,
                self._adapter.observe,
                partial(setattr, self._adapter, "commissioned"),
            )
        except _StoppedError as stopped:
            self.error = str(stopped)
        except (BenchError, OSError) as error:
            self.error = f"not commissioned, and no record is stored: {error}"
        except Exception as error:  # the bench is always connected again
            log.exception("the commissioning failed by an error of this program")
            self.error = f"not commissioned, by an error of this program: {type(error).__name__}: {error}"
        finally:
            self._adapter.mailbox.clear()
            self._adapter.commissioned = None

    def _ask(self, prompt: Prompt) -> None:
        """Show a prompt, and wait for the answer unless a simulated operator gives it."""
        self._check_stop()
        adapter, ask_id, answer = self._adapter, next(_PROMPT_IDS), "done"
        adapter.observe(PromptShown(ask_id, prompt))
        if adapter.simulation is None or adapter.simulation.asks_user:
            self.asks = True
            adapter.mailbox.show(ask_id, prompt)
            while (given := adapter.mailbox.answer(ask_id)) is None:
                self._check_stop()
                self._stop.wait(POLL_S)
            self.asks, answer = False, given
        adapter.observe(PromptAnswered(ask_id, answer))

    def _begin_exercise(self, name: str, fraction: float) -> None:
        self._check_stop()
        self.exercises, self.fraction = (*self.exercises, name), fraction

    def _check_stop(self) -> None:
        if self._stop.is_set():
            live = self._adapter.commissioned is not None
            raise _StoppedError(STOPPED_AT_INTERLOCK if live else STOPPED if self.exercises else STOPPED_BEFORE)
