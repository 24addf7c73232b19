"""Run interrupts: Stop and Pause requested from other threads, checked after every block and in every wait."""

from protocols.runner.publisher import RunRecorder
from protocols.runner.request import RunControl


class RunCancelled(Exception):
    """Stop was requested."""


class PauseInterrupt(Exception):
    """Pause was requested."""


class InterruptCheck:
    """Raises the interrupts that were requested, and publishes the events of other threads."""

    def __init__(self, control: RunControl, recorder: RunRecorder) -> None:
        self._control, self._recorder = control, recorder
        self.pausable = False
        """Whether a pause may interrupt the run now."""

    @property
    def is_pause_requested(self) -> bool:
        return self._control.pause.is_set()

    def check(self) -> None:
        """Publish external events and raise a requested interrupt.

        Raises:
            RunCancelled: Stop was requested.
            PauseInterrupt: Pause was requested, and the run is pausable.
            StorageError: an event cannot be stored.
        """
        self._recorder.publish_external()
        if self._control.cancel.is_set():
            raise RunCancelled
        if self.pausable and self.is_pause_requested:
            raise PauseInterrupt
