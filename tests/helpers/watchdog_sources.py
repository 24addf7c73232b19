"""Sources for the watchdog's process, by which a test sees what it commands: they write every call into a file."""

import time
from pathlib import Path
from typing import Any
from unittest.mock import patch

import nidaqmx

from drivers.errors import LinkError
from drivers.interfaces import Identity
from drivers.nidaq import analog_output
from drivers.nidaq.analog_input import NiConnection
from drivers.nidaq.analog_output import NiAnalogOutput
from sim_hardware.service.served_bench import ServedBench


class RecordingSource:
    """A source that records its calls.

    `stays_away` never reports rest; `cut` fails until it is connected again; `stop` returns when the file `held_by` is gone.
    """

    identity = Identity("Test", "source")

    def __init__(
        self, clock: object, record: str, stays_away: bool = False, cut: bool = False, held_by: str = ""
    ) -> None:
        self._held_by = held_by
        self._record, self._stays_away, self._cut = Path(record), stays_away, cut

    def _note(self, call: str) -> None:
        with self._record.open("a") as file:
            file.write(f"{call}\n")
        if self._cut:
            raise LinkError("the connection was closed")

    def is_at_rest(self, *_: float) -> bool:
        self._note("is_at_rest")
        return not self._stays_away

    def initialize_at_rest(self, *_: float) -> None:
        self._note("initialize_at_rest")

    def start_drive(self, drive: Any) -> None:
        self._note("start_drive")

    def stop(self) -> None:
        self._note("stop")
        while self._held_by and Path(self._held_by).exists():
            time.sleep(0.02)

    def ramp_to(self, level_v: float, duration_s: float) -> None:
        self._note(f"ramp_to {level_v:g}")

    def idle_level_v(self) -> float:
        return 4.0

    def reconnect(self) -> None:
        self._cut = False
        self._note("reconnect")

    def close(self) -> None:
        pass


class _LocalCard(NiConnection):
    """A card of this computer as NI's driver shows it to a process, in front of a simulated card of another one.

    Tasks have no names here and nobody else finds them; they end when the test calls `end_tasks_of_dead_process`.
    """

    def new_task(self, role: str) -> Any:
        del role
        return nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(self._rpc, ""))

    def clear_abandoned(self, *roles: str) -> None: ...


class LocalCardOutput(NiAnalogOutput):
    """The analogue output of such a card."""

    def __init__(self, **options: Any) -> None:
        with patch.object(analog_output, "NiConnection", _LocalCard):
            super().__init__(**options)


def end_tasks_of_dead_process(served: ServedBench) -> None:
    """Stop all tasks of a card, as NI's driver does with those of a process that died; outputs stay where they are."""
    served.card._tasks.stop_all()
