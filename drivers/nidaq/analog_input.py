"""NI DAQ cards (USB-6341 and other X-series): analogue input over `nidaqmx`.

One option selects the place of the card: `server=None` is the local driver, `server="host:port"` NI's gRPC device server, which
also serves the simulated card. Raw 16-bit integers are kept, with the card's own scaling.
"""

import contextlib
import math
import threading
import time
from collections import deque
from collections.abc import Callable, Sequence
from typing import Any
from weakref import WeakValueDictionary

import nidaqmx
import numpy as np
from nidaqmx.constants import AcquisitionType, TerminalConfiguration
from nidaqmx.errors import DaqError, RpcError
from nidaqmx.grpc_session_options import SessionInitializationBehavior
from nidaqmx.stream_readers import AnalogUnscaledReader
from nidaqmx.system import System
from numpy.typing import NDArray

from drivers.clock import Clock
from drivers.deadlines import Deadline
from drivers.errors import AcquisitionError, CardInUseError, InstrumentError, ScanOrderError
from drivers.interfaces import Block, Closeable, Identity, Scale
from drivers.nidaq.card_limits import check_inputs
from drivers.nidaq.errors import translate_errors

BUFFER_S = 20.0
"""Real seconds of scans in the NI driver's buffer: longest pause of the program without lost scans."""

START_UNCERTAINTY_S, START_QUERIES = 0.005, 5
"""Accuracy of the time of the first scan, in real time; otherwise the best of this number of counts of scans."""

INPUT, OUTPUT, READBACK = "input", "output", "read-back"
"""Roles of the tasks on one card. A gRPC device server keeps a task, and with it the card, until a client clears it, even after
the death of the program that created it. Therefore its tasks are sessions with names, by which the next program finds them."""

ABANDONED_AFTER_S = 3.0
"""Time without a read after which an input session counts as left by an ended program: a running one reads every block."""

POLL_S, ARRIVAL_POLL_S = 0.25, 0.005
_RUNNING: "WeakValueDictionary[tuple[str, str], NiStream]" = WeakValueDictionary()
"""Running acquisitions of this program, by the `key` of their card."""

GROUND_CHANNEL = "_aignd_vs_aignd"
"""The card's ground, converted before the drive if the rate allows it: an open input shows the previously converted voltage, and
must not look like rest because the laser's output is near 2.5 V."""

OUTPUT_END_TIMEOUT_S = 10.0
"""Longest wait for the end of a dead program's drive before its output task is cleared."""


class NiConnection:
    """Connection to one card: the local driver, or a gRPC device server. Input and output have separate connections.

    Args:
        device: the card's name, e.g. `Dev1`.
        server: `host:port` of a gRPC device server, or None for the local driver.

    Raises:
        InstrumentError: the driver, the server or the card is not available; the message gives the remedy.
    """

    def __init__(self, device: str, server: str | None = None) -> None:
        self.device = device
        self.description = f"DAQ card {device}" + (f" at {server}" if server else "")
        self._server = server
        self._rpc: Any = None
        self._calls: Any = None
        """Knows whether the gRPC server answers."""
        self._options: Any = None
        self._open_roles: set[str] = set()
        self._created: set[str] = set()
        try:
            self.identity = self.reopen()
        except InstrumentError:
            self.close()
            raise
        self.description = f"DAQ card {device} ({self.identity.model})"

    @property
    def key(self) -> tuple[str, str]:
        """Identity of the card: the server, empty for this computer, and the name of the device."""
        return self._server or "", self.device.lower()

    @property
    def is_remote(self) -> bool:
        """Whether the card is behind a gRPC device server."""
        return self._server is not None

    def reopen(self) -> Identity:
        """Connect again and return the card's identity. Raises InstrumentError like the constructor."""
        self.close()
        self._open_roles.clear()
        if self._server:
            from drivers.nidaq.grpc_channel import open_channel

            self._rpc, self._calls = open_channel(self._server)
            self._options = nidaqmx.GrpcSessionOptions(self._rpc, "")
        with translate_errors(self.description):
            card = self.device_properties()
            return Identity("NI", card.product_type, format(card.serial_num, "X"))

    def device_properties(self) -> Any:
        """Return NI's object of this device, for its properties."""
        system = System.remote(self._options) if self._server else System.local()
        return system.devices[self.device]

    def new_task(self, role: str) -> Any:
        """Return a new NI task on this card's driver; at a gRPC server the task of a dead program is cleared first.

        Raises:
            CardInUseError: the card is in use by another running program, or by a task of this one.
            AcquisitionError: the server does not answer.
        """
        if not self._server:
            with translate_errors(self.description):
                return nidaqmx.Task()
        if self._rpc is None:
            raise AcquisitionError(f"{self.description} is closed")
        if self._calls.silent is not None:
            self.reopen()
        with translate_errors(self.description):
            task = self._create_session(role, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION)
            if task is None:
                if role in self._open_roles:
                    raise CardInUseError(f"{self.description}: its {role} is already in use by this program")
                self.clear_abandoned(role)
                task = self._create_session(role, SessionInitializationBehavior.INITIALIZE_SERVER_SESSION)
            if task is None:
                raise CardInUseError(f"{self.description}: another program has just taken its {role}; close that first")
        self._open_roles.add(role)
        return task

    def close_task(self, task: Any, role: str) -> None:
        """Clear a task. Raises InstrumentError if the card or the server is gone."""
        self._open_roles.discard(role)
        with translate_errors(self.description):
            task.close()

    def clear_abandoned(self, *roles: str) -> None:
        """Clear the sessions of a dead program, or of a broken connection of this one, at the gRPC server.

        Raises:
            CardInUseError: their program is running.
        """
        if not self._server or self._rpc is None:
            return
        with translate_errors(self.description):
            left = {role: task for role in roles if role not in self._open_roles and (task := self._attach(role))}
            if left.keys() - self._created:
                reader = left.get(INPUT) or self._attach(INPUT)
                if reader is not None and _is_being_read(reader):
                    raise CardInUseError(
                        f"{self.description}: the card is in use by another program, which reads it (session "
                        f"'{self._session_name(INPUT)}' at the gRPC server); close that program first"
                    )
            for role, task in left.items():
                if role == OUTPUT:
                    _wait_until_done(task)
                with contextlib.suppress(DaqError):
                    task.close()

    def _session_name(self, role: str) -> str:
        return f"tactor-bench {self.device} {role}"

    def _attach(self, role: str) -> Any:
        return self._create_session(role, SessionInitializationBehavior.ATTACH_TO_SERVER_SESSION)

    def _create_session(self, role: str, behavior: SessionInitializationBehavior) -> Any:
        """Create or attach to the session of a role; return None if creation finds it existing, or attachment finds none."""
        name = self._session_name(role)
        options = nidaqmx.GrpcSessionOptions(self._rpc, name, initialization_behavior=behavior)
        try:
            task = nidaqmx.Task(name, grpc_options=options)
        except RpcError as error:
            if str(getattr(error.rpc_code, "name", error.rpc_code)) in ("UNAVAILABLE", "DEADLINE_EXCEEDED"):
                raise
            return None
        if behavior is SessionInitializationBehavior.INITIALIZE_SERVER_SESSION:
            self._created.add(role)
        return task

    def close(self) -> None:
        channel, self._rpc = self._rpc, None
        if channel is not None:
            channel.close()


class NiDigitizer:
    """Several analogue inputs of one card as a `Digitizer` (see drivers.interfaces).

    Args:
        device: the card's name, e.g. `Dev1`.
        channels: terminals, drive first, e.g. `("ai0", "ai1")`.
        clock: bench time.
        server: `host:port` of a gRPC device server, or None for the local driver.
        range_v: input range, +- volts.
        terminal: terminal configuration by NI's name, e.g. `DIFF`, `RSE`.

    Raises:
        InstrumentError: the driver, the server or the card is not available; the message gives the remedy.
    """

    def __init__(
        self,
        device: str,
        channels: tuple[str, ...],
        clock: Clock,
        *,
        server: str | None = None,
        range_v: float = 10.0,
        terminal: str = "DEFAULT",
    ) -> None:
        self._channels, self._clock, self._range_v = channels, clock, range_v
        self._terminal = TerminalConfiguration[terminal]
        self._connection = NiConnection(device, server)
        self.identity = self._connection.identity

    def stream(self, rate_hz: float, block_scans: int) -> "NiStream":
        """Begin to acquire (see drivers.interfaces.Digitizer.stream)."""
        return self._start(rate_hz, block_scans, [(terminal, "") for terminal in self._channels], grounded=True)

    def scan(self, order: Sequence[int], rate_hz: float, block_scans: int) -> "NiStream":
        """Begin to acquire channels in this order (see drivers.interfaces.ScanLister)."""
        where = self._connection.description
        with translate_errors(where, remote=self._connection.is_remote):
            if self._connection.device_properties().ai_simultaneous_sampling_supported:
                raise ScanOrderError(f"{where} has a converter for each input, and takes each once in a scan")
        # A repeatedly converted channel needs a name for each conversion.
        inputs = [(self._channels[k], f"conversion {slot}") for slot, k in enumerate(order)]
        return self._start(rate_hz, block_scans, inputs, grounded=False)

    def _start(self, rate_hz: float, block_scans: int, inputs: Sequence[tuple[str, str]], grounded: bool) -> "NiStream":
        """Begin to acquire terminals, each under its own name, optionally after the card's ground."""
        task, where = self._connection.new_task(INPUT), self._connection.description
        try:
            with translate_errors(where, remote=self._connection.is_remote):
                card = self._connection.device_properties()
                check_inputs(card, where, len(inputs), rate_hz, self._range_v)
                grounds = self._add_ground(task, rate_hz) if grounded else 0
                for terminal, name in inputs:
                    task.ai_channels.add_ai_voltage_chan(
                        f"{self._connection.device}/{terminal}",
                        name_to_assign_to_channel=name,
                        terminal_config=self._terminal,
                        min_val=-self._range_v,
                        max_val=self._range_v,
                    )
                speed = float(getattr(self._clock, "speed", 1.0))  # speed of a simulated bench; 1 for a real one
                task.timing.cfg_samp_clk_timing(
                    rate_hz,
                    sample_mode=AcquisitionType.CONTINUOUS,
                    samps_per_chan=max(round(BUFFER_S * speed * rate_hz), 4 * block_scans),
                )
                stream = NiStream(
                    task,
                    block_scans,
                    self._clock,
                    where,
                    lambda: self._connection.close_task(task, INPUT),
                    grounds,
                    REMOTE_COUNT_S if self._connection.is_remote else 0.0,
                )
                _RUNNING[self._connection.key] = stream
                return stream
        except BaseException:
            with contextlib.suppress(InstrumentError):
                self._connection.close_task(task, INPUT)
            raise

    def _add_ground(self, task: Any, rate_hz: float) -> int:
        """Add the card's ground as the first channel, if the card has one converter and time; return the number of added channels."""
        try:
            card = self._connection.device_properties()
            if card.ai_simultaneous_sampling_supported or card.ai_max_multi_chan_rate < rate_hz * (
                len(self._channels) + 1
            ):
                return 0
            task.ai_channels.add_ai_voltage_chan(
                f"{self._connection.device}/{GROUND_CHANNEL}", min_val=-self._range_v, max_val=self._range_v
            )
        except (DaqError, RpcError):  # a card without this channel
            return 0
        return 1

    def close(self) -> None:
        self._connection.close()


REMOTE_COUNT_S = 1.0
"""Interval between queries of the card's own count over a network: each query takes as long as reading a block."""


class NiStream(Closeable):
    """A running NI task as a `Stream` (see drivers.interfaces)."""

    def __init__(
        self,
        task: Any,
        block_scans: int,
        clock: Clock,
        description: str,
        close_task: Callable[[], None],
        grounded: int = 0,
        count_s: float = 0.0,
    ) -> None:
        self._task, self._description, self._next_scan, self._clock = task, description, 0, clock
        self._close_task = close_task
        self._read_ahead: deque[Block] = deque()
        self._reading_thread = 0
        """Identity of the thread that has called `read` last; blocks are read in one thread at a time."""
        self._newest: Block | None = None
        self._grounded = grounded
        self._count_s, self._counted_s = count_s, -math.inf
        self._restarted_scan = 0
        """Scan at the begin of the task's count, or at its restart after lost scans."""
        self.rate_hz = float(task.timing.samp_clk_rate)
        convert_s = _convert_interval_s(task)
        self.scales = tuple(
            Scale(tuple(map(float, channel.ai_dev_scaling_coeff)), skew_s=(slot - grounded) * convert_s)
            for slot, channel in enumerate(task.ai_channels)
        )[grounded:]
        self._raw = np.zeros((grounded + len(self.scales), block_scans), np.int16)
        self._timeout_s = Deadline.CARD_BLOCK.seconds + block_scans / self.rate_hz
        self._reader = AnalogUnscaledReader(task.in_stream)
        self._reader.verify_array_shape = False  # it would ask the driver for the number of channels with every block
        self.start_time_s = self._start() + grounded * convert_s

    def _start(self) -> float:
        """Start the acquisition; return the time, corrected by the card's count of scans if a busy computer delayed the reply."""
        requested_s = begin_s = self._clock.now()
        self._task.start()
        start_s = answered_s = self._clock.now()
        limit_s = START_UNCERTAINTY_S * getattr(self._clock, "speed", 1.0)
        for _ in range(START_QUERIES):
            if answered_s - requested_s <= limit_s:
                break
            requested_s = self._clock.now()
            scans = self._task.in_stream.total_samp_per_chan_acquired
            answered_s = self._clock.now()
            start_s = min(start_s, answered_s - scans / self.rate_hz)
        return float(max(start_s, begin_s))

    def read(self) -> Block:
        self._reading_thread = threading.get_ident()
        self._newest = block = self._read_ahead.popleft() if self._read_ahead else self._read_block()
        return block

    def newest_drive_volts(self, timeout_s: float) -> NDArray[np.float64] | None:
        """Return the drive in a block acquired after this call; `read` returns this block and earlier ones later.

        None if no such block arrives in time: on a slow connection this program lags behind the card.
        """
        called_s, read_here = self._clock.now(), self._reading_thread in (0, threading.get_ident())
        while self._clock.now() - called_s <= timeout_s:
            if read_here:
                self._read_ahead.append(self._read_block())
            else:  # another thread reads
                time.sleep(ARRIVAL_POLL_S)
            block = self._read_ahead[-1] if read_here else self._newest
            if block is not None and self.start_time_s + block.start / self.rate_hz >= called_s:
                return self.scales[0].to_volts(block.raw[0])
        return None

    def _read_block(self) -> Block:
        if self._task is None:
            raise AcquisitionError(f"{self._description}: the acquisition is closed")
        with translate_errors(self._description):
            self._reader.read_int16(self._raw, self._raw.shape[1], self._timeout_s)
        start = self._next_scan
        if time.monotonic() - self._counted_s >= self._count_s:
            with contextlib.suppress(DaqError, RpcError):  # then the scans are counted by this program
                # The task's own count: scans read by another reader, or lost with a reply, are a gap between two blocks.
                position = int(self._task.in_stream.curr_read_pos)
                start = max(self._restarted_scan + position - self._raw.shape[1], start)
            self._counted_s = time.monotonic()
        block = Block(start, self._raw[self._grounded :].copy())
        self._next_scan = block.stop
        return block

    def restart(self) -> None:
        """Acquire again after scans were lost (see drivers.interfaces.RestartableStream)."""
        with translate_errors(self._description):
            with contextlib.suppress(DaqError):  # it repeats the error that ended the task
                self._task.stop()
            start_s = self._start()
        self._next_scan = max(round((start_s - self.start_time_s) * self.rate_hz), self._next_scan)
        self._restarted_scan = self._next_scan

    def close(self) -> None:
        """Stop the card."""
        task, self._task = self._task, None
        if task is not None:
            # An unplugged card or a dead server cannot and need not be stopped.
            with contextlib.suppress(InstrumentError):
                self._close_task()


def newest_drive_volts(key: tuple[str, str], timeout_s: float) -> NDArray[np.float64] | None:
    """Return the drive now measured by this program's acquisition on a card; None if there is none, or it fails or is late."""
    stream = _RUNNING.get(key)
    try:
        return None if stream is None else stream.newest_drive_volts(timeout_s)
    except AcquisitionError:
        return None


def acquisition_rate_hz(key: tuple[str, str]) -> float:
    """Return scans per second of this program's acquisition on a card; NaN without one."""
    stream = _RUNNING.get(key)
    return math.nan if stream is None else stream.rate_hz


def _is_being_read(task: Any) -> bool:
    """Return whether a program reads an input task within `ABANDONED_AFTER_S`."""
    try:
        first, is_last, deadline = task.in_stream.curr_read_pos, False, time.monotonic() + ABANDONED_AFTER_S
        while not is_last:  # this process may have been stopped: the last look comes after the deadline
            is_last = time.monotonic() >= deadline
            time.sleep(POLL_S)
            if task.in_stream.curr_read_pos != first:
                return True
    except DaqError:  # its buffer has overflowed, or it was cleared meanwhile
        return False
    return False


def _wait_until_done(task: Any) -> None:
    """Wait for the end of a drive, so that it is not cut within a wave."""
    deadline = time.monotonic() + OUTPUT_END_TIMEOUT_S
    with contextlib.suppress(DaqError):
        while not task.is_task_done() and time.monotonic() < deadline:
            time.sleep(POLL_S)


def _convert_interval_s(task: Any) -> float:
    """Seconds between the conversions of two channels of one scan; 0 for a card with a converter per channel."""
    if all(device.ai_simultaneous_sampling_supported for device in task.devices):
        return 0.0
    return 1 / float(task.timing.ai_conv_rate)


def list_devices(server: str | None = None) -> list[tuple[str, Identity]]:
    """Names and identities of the cards of this computer, or of a gRPC device server.

    Raises:
        InstrumentError: no driver, or no server.
    """
    where = f"DAQ cards at {server}" if server else "DAQ cards"
    rpc: Any = None
    try:
        with translate_errors(where):
            if server:
                from drivers.nidaq.grpc_channel import open_channel

                rpc, _ = open_channel(server)
            system = System.remote(nidaqmx.GrpcSessionOptions(rpc, "")) if server else System.local()
            return [(c.name, Identity("NI", c.product_type, format(c.serial_num, "X"))) for c in system.devices]
    finally:
        if rpc is not None:
            rpc.close()
