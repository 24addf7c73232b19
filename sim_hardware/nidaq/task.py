"""The NI device of the simulated card and the base of its input and output tasks, without a transport."""

import math
import re
import threading
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass

from drivers import Clock
from sim_hardware.nidaq.card import FIRST_OUTPUT_READBACK_CHANNEL, GROUND_CHANNEL, Acquisition, SimulatedCard
from sim_hardware.nidaq.errors import NiError
from sim_hardware.plant import FaultState

FINITE, CONTINUOUS = 10178, 10123


@dataclass(frozen=True, slots=True)
class TaskChannel:
    """One analogue channel of a task."""

    name: str
    number: int
    low_v: float
    high_v: float


class SimulatedNiDevice:
    """The NI-DAQmx device: a name, and at most one task with its analogue input."""

    def __init__(self, card: SimulatedCard, clock: Clock, faults: FaultState, name: str = "Dev1") -> None:
        self.card = card
        self.clock = clock
        self.faults = faults
        self.name = name
        self.server_stopping = threading.Event()
        self._lock = threading.Lock()
        self._input_owner: NiTask | None = None
        self.line_owners: dict[str, object] = {}
        """Tasks of the digital lines."""

    def check_present(self, code: int = -201003) -> None:
        """Raise NiError if the card is absent."""
        if self.faults.is_active("card-unplugged"):
            raise NiError(code, f"Device Specified: {self.name}")

    def reserve(self, task: "NiTask") -> None:
        """Give the analogue input to `task`. Raises NiError if another has it."""
        with self._lock:
            if self._input_owner not in (None, task):
                raise NiError(-50103, f"Task Name: {task.name}")
            self._input_owner = task

    def release(self, task: "NiTask") -> None:
        """Release the analogue input."""
        with self._lock:
            if self._input_owner is task:
                self._input_owner = None

    def reset(self) -> None:
        """DAQmx reset: every output goes to 0 V, independent of its connection (NI help: states after a device reset)."""
        self.check_present()
        for output in self.card.outputs:
            output.owner = None
            output.reset()

    def physical_channel_name(self, number: int) -> str:
        """The name of a channel number."""
        if number == GROUND_CHANNEL:
            return f"{self.name}/_aignd_vs_aignd"
        line = (
            f"_ao{number - FIRST_OUTPUT_READBACK_CHANNEL}_vs_aognd"
            if number >= FIRST_OUTPUT_READBACK_CHANNEL
            else f"ai{number}"
        )
        return f"{self.name}/{line}"

    @property
    def speed(self) -> float:
        """Bench seconds per second of the caller's own time."""
        return float(getattr(self.clock, "speed", 1.0))

    def next_scan_time(self, t: float) -> float:
        """Return the time of the running acquisition's next scan after `t`; infinity without one."""
        with self._lock:
            run = self._input_owner.acquisition if self._input_owner is not None else None
        if run is None:
            return math.inf
        return run.start_time_s + max(math.ceil((t - run.start_time_s) * run.rate_hz - 1e-9), 0) / run.rate_hz

    def parse_physical_channels(self, text: str) -> list[int]:
        """Channel numbers of `Dev1/ai0:1, Dev1/_ao0_vs_aognd`. Raises NiError for a missing channel."""
        numbers: list[int] = []
        for part in text.split(","):
            device, _, line = part.strip().partition("/")
            if device.lower() != self.name.lower():
                raise NiError(-200220, f"Device Specified: {device}")
            if line.strip().lower() == "_aignd_vs_aignd":
                numbers.append(GROUND_CHANNEL)
                continue
            inside = re.fullmatch(r"_ao(\d+)_vs_aognd", line.strip(), re.IGNORECASE)
            if inside and int(inside[1]) < len(self.card.outputs):
                numbers.append(FIRST_OUTPUT_READBACK_CHANNEL + int(inside[1]))
                continue
            match = re.fullmatch(r"ai(\d+)(?::(?:ai)?(\d+))?", line.strip(), re.IGNORECASE)
            first, last = (int(match[1]), int(match[2] or match[1])) if match else (0, self.card.parameters.channels)
            if max(first, last) >= self.card.parameters.channels:
                raise NiError(-200170, f"Physical Channel Name: {part.strip()}")
            numbers += range(first, last + 1)
        return numbers


class NiTask(ABC):
    """An analogue task: common base of input and output."""

    max_rate_hz: float

    def __init__(self, device: SimulatedNiDevice, name: str, mode: int, samples_per_channel: int) -> None:
        self.name, self.device = name, device
        self.channels: list[TaskChannel] = []
        self.rate_hz: float | None = None
        self.mode, self.samples_per_channel = mode, samples_per_channel
        self.acquisition: Acquisition | None = None

    def configure_clock(self, rate_hz: float, mode: int, scans: int) -> None:
        """Set the sample clock. Raises NiError for a rate impossible for the converter."""
        if not 0 < rate_hz <= self.max_rate_hz * (1 + 1e-9):
            raise NiError(
                -200077,
                f"Property: SampClk.Rate\nRequested Value: {rate_hz}\nMaximum Value: {self.max_rate_hz}\n"
                f"Task Name: {self.name}",
            )
        self.rate_hz, self.mode, self.samples_per_channel = rate_hz, mode, scans

    def max_rate(self) -> float:
        """Return the largest rate of the converter with this many channels."""
        return self.max_rate_hz / max(1, len(self.channels))

    def actual_rate(self) -> float:
        """Return the rate that the divider makes. Raises NiError if it is too fast for this many channels."""
        if self.rate_hz is None:
            raise NiError(-200452, "Property: SampClk.Rate")
        if not self.channels:
            raise NiError(-200478)
        return self._divided_rate(self.rate_hz)

    @abstractmethod
    def _divided_rate(self, rate_hz: float) -> float: ...

    def _wait(self, is_over: Callable[[], bool], expected_s: Callable[[], float], timeout_s: float) -> bool:
        """Wait for the end expected at a bench time; return whether it was reached. The time-out is real time."""
        clock, speed = self.device.clock, self.device.speed
        given_up = clock.now() + (math.inf if timeout_s < 0 else timeout_s * speed)
        while not is_over():
            now = clock.now()
            if now >= given_up or self.device.server_stopping.is_set():
                return False
            # In short pieces, to notice a pulled cable or a closing server during the wait.
            clock.sleep(min(max(min(expected_s(), given_up) - now, 1e-4 * speed), 0.02 * speed))
        return True
