"""Static digital lines of an NI card for the interlock: the heartbeat, and the state of its relay.

Each value is written when it is due: a counter or a clocked task would continue after the death of the program.
"""

import contextlib
from typing import Any

from nidaqmx.stream_readers import DigitalSingleChannelReader
from nidaqmx.stream_writers import DigitalSingleChannelWriter

from drivers.errors import InstrumentError
from drivers.nidaq.analog_input import NiConnection
from drivers.nidaq.errors import translate_errors

HEARTBEAT, STATE = "heartbeat", "interlock state"
"""Roles of the tasks, which are made at the first use, and again after an error."""


class NiDigitalLines:
    """The lines of an interlock (see drivers.bench.interlock.DigitalLines).

    Args:
        device: the card's name, e.g. `Dev1`.
        line: output with the heartbeat, e.g. `port0/line0`.
        state_line: input that the relay's second contact pulls up while it is closed; empty if it is not wired.
        server: `host:port` of a gRPC device server, or None for the local driver.
    """

    def __init__(self, device: str, line: str, state_line: str = "", *, server: str | None = None) -> None:
        self._connection = NiConnection(device, server)
        self._lines = {HEARTBEAT: line, STATE: state_line}
        self._tasks: dict[str, Any] = {}

    def write(self, high: bool) -> None:
        with self._task(HEARTBEAT) as task:
            DigitalSingleChannelWriter(task.out_stream, auto_start=True).write_one_sample_one_line(high)

    def is_closed(self) -> bool | None:
        if not self._lines[STATE]:
            return None
        with self._task(STATE) as task:
            return bool(DigitalSingleChannelReader(task.in_stream).read_one_sample_one_line())

    def close(self) -> None:
        self._close_tasks()
        self._connection.close()

    @contextlib.contextmanager
    def _task(self, role: str) -> Any:
        try:
            with translate_errors(self._connection.description, remote=self._connection.is_remote):
                if role not in self._tasks:
                    self._tasks[role] = task = self._connection.new_task(role)
                    add = task.do_channels.add_do_chan if role == HEARTBEAT else task.di_channels.add_di_chan
                    add(f"{self._connection.device}/{self._lines[role]}")
                yield self._tasks[role]
        except InstrumentError:
            self._close_tasks()
            raise

    def _close_tasks(self) -> None:
        while self._tasks:
            with contextlib.suppress(InstrumentError):
                self._connection.close_task(*reversed(self._tasks.popitem()))
