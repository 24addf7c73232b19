"""Micro-Epsilon sensors on Ethernet: optoNCDT 2300 and capaNCDT 6200, single readings for static tests.

The data port sends blocks without a request: a little-endian header that begins with MEAS (on the wire SAEM), then frames of one
32-bit value a channel. Commands go to another port as text. Both dialects, with their sources, are in meters.toml.
"""

import math
import re
import struct

from drivers.clock import Clock
from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity, Reading
from drivers.sensors.meter_dialects import BlockDialect
from drivers.transport import SerialPort

PREAMBLE = b"SAEM"
COUNTS = struct.Struct("<HHI")
"""End of a header: number of frames, bytes of a frame, counter."""
FIXED_BYTES = {0: 20, 2: 24}
"""Bytes of a header before its end: preamble, order and serial number, then flags, or channels and status; by the bits of a channel."""
MAX_SEARCH_BYTES, MAX_BLOCK_BYTES = 65_536, 65_536


class BlockMeter:
    """A `Meter` (see drivers.interfaces).

    Args:
        port: the data port.
        commands: the command port.
        clock: bench time.
        range_m: measuring range of the sensor.
        channel: channel of the controller, from 1.

    Raises:
        LinkError: no block on the data port, or no reply to a command.
        InstrumentError: the sensor reports another measuring range or a filter of unknown delay, or refuses a setting.
    """

    def __init__(
        self,
        port: SerialPort,
        commands: SerialPort,
        clock: Clock,
        dialect: BlockDialect,
        *,
        range_m: float,
        channel: int = 1,
    ) -> None:
        self._port, self._commands, self._clock, self._dialect = port, commands, clock, dialect
        self._range_m, self._channel = range_m, channel
        self.identity = Identity(dialect.maker, dialect.model)
        try:
            for command in dialect.commands:
                self._command(command)
            self._check_range(self._command(dialect.asked.format(output=channel)))
            self.averaged_values = self._ask_averaged_values()
            self.identity = Identity(dialect.maker, dialect.model, str(self._read_block()[0]))
            self.read()
        except InstrumentError:
            self.close()
            raise

    def read(self) -> Reading:
        # Blocks on their way are old, and the next one may have begun before this call.
        self._port.discard_input()
        self._read_block()
        count, values = 0, 0
        while values < self.averaged_values:  # the values of this reading's average begin after this call
            _, count, frames = self._read_block()
            values += frames
        time_s = self._clock.now()
        if count >= self._dialect.invalid_from:
            return Reading(math.nan, "m", False, time_s)
        value_m = count * 1e-9 if self._dialect.scale == "nm" else count / self._dialect.full * self._range_m
        return Reading(value_m, "m", True, time_s)

    def close(self) -> None:
        self._port.close()
        self._commands.close()

    def _read_block(self) -> tuple[int, int, int]:
        """Return the serial number, the last value of the channel and the number of values in the next block."""
        seen = b""
        while not seen.endswith(PREAMBLE):
            if len(seen) > MAX_SEARCH_BYTES:
                raise LinkError(
                    f"{self._port.name} sends no blocks of measured values; check its address and its data port"
                )
            seen += self._read(1)
        fixed = self._read(FIXED_BYTES[self._dialect.channel_bits] - len(PREAMBLE))
        frames, size, _ = COUNTS.unpack(self._read(COUNTS.size))
        if not 0 < frames * size <= MAX_BLOCK_BYTES or size < 4 * self._place(fixed) + 4:
            raise LinkError(
                f"{self._port.name} sent a block of {frames} frames of {size} bytes without channel {self._channel}; check the driver and "
                "the channel in the bench file"
            )
        data = self._read(frames * size)
        (count,) = struct.unpack_from("<i", data, (frames - 1) * size + 4 * self._place(fixed))
        return int.from_bytes(fixed[4:8], "little"), int(count), frames

    def _place(self, fixed: bytes) -> int:
        """Return the place of the channel in a frame; beyond every frame if it is not sent."""
        bits = self._dialect.channel_bits
        if not bits:
            return 0
        channels = int.from_bytes(fixed[8:16], "little")
        sent = [number for number in range(1, 33) if channels >> bits * (number - 1) & 1]
        return sent.index(self._channel) if self._channel in sent else MAX_BLOCK_BYTES

    def _read(self, count: int) -> bytes:
        data = self._port.read(count)
        if len(data) < count:
            raise LinkError(
                f"{self._port.name} was silent for {self._port.timeout_s:g} s; check that the sensor is on, measures, and sends over Ethernet"
            )
        return data

    def _command(self, command: str) -> str:
        answer = self._commands.query(command.encode(), self._dialect.prompt.encode())
        refusal = re.search(r"\bE\d+.*", answer)
        if refusal and "unknown" not in refusal[0].lower():  # a model without the command has no such setting
            raise InstrumentError(
                f"{self.identity} at {self._commands.name} refuses {command.strip()} ({refusal[0].strip()}); log in as professional with "
                "the sensor's own tool, or set it there"
            )
        return answer

    def _ask_averaged_values(self) -> int:
        """Return the number of values in the average that it sends, 1 for none."""
        (question, pattern), (count_question, count_pattern) = self._dialect.average_kind, self._dialect.average_count
        kind = re.search(pattern, self._command(question)) if question else None
        if kind is None or kind[1] == "0":  # a model without the command does not average
            return 1
        count = re.search(count_pattern, self._command(count_question))
        if kind[1] not in self._dialect.average_kinds or count is None:
            raise InstrumentError(
                f"{self.identity} at {self._commands.name} has a filter (kind {kind[1]}) whose delay is unknown; choose a moving average or none "
                "with the sensor's own tool"
            )
        return int(count[1])

    def _check_range(self, info: str) -> None:
        pattern, unit_m = (self._dialect.range_mm, 1e-3) if self._dialect.range_mm else (self._dialect.range_um, 1e-6)
        if (found := re.search(pattern, info)) is None:
            raise LinkError(f"{self._commands.name} answered '{info[:40]}'; is this a {self.identity}?")
        reported_m = float(found[1]) * unit_m
        if not math.isclose(reported_m, self._range_m, rel_tol=1e-3):
            raise InstrumentError(
                f"{self.identity} at {self._commands.name} has a measuring range of {1e3 * reported_m:g} mm, the bench file says "
                f"{1e3 * self._range_m:g} mm; correct range_m"
            )
