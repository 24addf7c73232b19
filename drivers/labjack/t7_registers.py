"""LabJack T7: its address, and its registers by type."""

import contextlib
import re
import struct
from collections.abc import Iterator, Sequence

from drivers.deadlines import Deadline
from drivers.errors import AcquisitionError, CardInUseError, InstrumentError
from drivers.interfaces import Identity
from drivers.labjack.modbus import ModbusClient, ModbusError

REGISTER_PORT, STREAM_PORT = 502, 702

BUFFER_BYTES = 32_768
"""Largest stream buffer of the device."""

ENABLE, USER_RAM, WATCHDOG = 4990, 46100, 61600
"""STREAM_ENABLE, the register with the mark of the streaming program, and the enable of the device's own watchdog."""

MARK = 0x54424E43
"""Value of USER_RAM0 during a stream: one that an ended program left running is recognized by it, and stopped."""

ERROR_REMEDIES = {
    2605: "it is already streaming; close the other program",
    2608: "lower the sample rate",
    2615: "update its firmware: it does not take a stream buffer of 32768 bytes",
    2618: "update its firmware: it does not take packets of 512 samples",
}


def terminal_number(terminal: str) -> int:
    """Return the number of an input: 3 for `AIN3` or `ai3`.

    Raises:
        AcquisitionError: it is not one of AIN0 to AIN13.
    """
    match = re.fullmatch(r"(?:AIN|AI)(\d{1,2})", terminal.upper())
    if match is None or int(match[1]) > 13:
        raise AcquisitionError(f"a LabJack T7 has no terminal {terminal!r}; give AIN0 to AIN13 in the bench file")
    return int(match[1])


def split_address(address: str) -> tuple[str, int, int]:
    """Return host, register port and stream port of `192.0.2.9` or, behind a relay, of `192.0.2.9:1502:1702`.

    Raises:
        AcquisitionError: it is no address.
    """
    host, *ports = address.split(":")
    if not host or len(ports) not in (0, 2) or not all(port.isdecimal() and 0 < int(port) < 65536 for port in ports):
        raise AcquisitionError(
            f"{address!r} is not the address of a LabJack; give its IP address in card.device, e.g. 192.0.2.9"
        )
    register, stream = map(int, ports or (REGISTER_PORT, STREAM_PORT))
    return host, register, stream


class T7Registers:
    """Registers of one T7 by type, with the numbers of LabJack's ljm_constants.json.

    Args:
        address: see `split_address`.
        timeout_s: longest wait for a reply; 0: the deadline of a card's server.

    Raises:
        AcquisitionError: it does not answer, or is another device.
    """

    def __init__(self, address: str, timeout_s: float = 0.0) -> None:
        self._timeout_s = timeout_s or Deadline.CARD_SERVER.seconds
        self.host, self._port, self.stream_port = split_address(address)
        self.description = f"LabJack at {self.host}"
        self._client: ModbusClient | None = None
        self.identity = self.reopen()
        self.description = f"{self.identity.model} at {self.host}"

    def reopen(self) -> Identity:
        """Connect anew and return the identity."""
        self.close()
        self._client = ModbusClient(self.host, self._port, self.description, self._timeout_s)
        product = self.read_float(60000)
        if round(product) != 7:
            raise AcquisitionError(
                f"{self.description} is a T{product:.0f}, not a T7; its inputs have other ranges. Connect a T7, or choose another driver"
            )
        model = "T7-Pro" if self.read_integer(60010) & 1 else "T7"
        return Identity("LabJack", model, str(self.read_integer(60028)), f"{self.read_float(60004):.4f}")

    def read(self, address: int, count: int) -> bytes:
        with self._explained():
            return self._opened().read(address, count)

    def read_float(self, address: int) -> float:
        return float(struct.unpack(">f", self.read(address, 2))[0])

    def read_integer(self, address: int) -> int:
        return int(struct.unpack(">I", self.read(address, 2))[0])

    def write_float(self, address: int, value: float) -> None:
        self.write_floats(address, value)

    def write_floats(self, address: int, *values: float) -> None:
        self._write(address, struct.pack(f">{len(values)}f", *values))

    def write_integers(self, address: int, *values: int) -> None:
        self._write(address, struct.pack(f">{len(values)}I", *values))

    def write_short(self, address: int, value: int) -> None:
        self._write(address, struct.pack(">H", value))

    def configure_stream(self, rate_hz: float, addresses: Sequence[int], packet: int, scans: int = 0) -> float:
        """Write the settings of a stream; return the actual scans per second.

        Args:
            rate_hz: wanted scans per second.
            addresses: registers of a scan.
            packet: samples of a packet.
            scans: number of scans, 0: unlimited.
        """
        self.write_float(4002, rate_hz)
        self.write_integers(4004, len(addresses), packet)
        self.write_float(4008, 0.0)  # settling: automatic, for which the time between conversions is known
        # Resolution 1, buffer, internal clock, Ethernet, 16-bit samples, number of scans, no external clock, no trigger.
        self.write_integers(4010, 1, BUFFER_BYTES, 0, 1, 0, scans, 0, 0)
        self.write_integers(4100, *addresses)
        return self.read_float(4002)

    def end_stream(self, in_use: type[InstrumentError] = CardInUseError) -> bool:
        """End the stream of this or an ended program; return whether one was running.

        Raises:
            CardInUseError: another program streams, or the given error; AcquisitionError: no answer, or a refusal.
        """
        if not self.read_integer(ENABLE):
            return False
        if self.read_integer(USER_RAM) != MARK:
            raise in_use(
                f"{self.description} is in use by another program, which streams; close that program, or restart the LabJack"
            )
        try:
            self.write_integers(ENABLE, 0)
        except AcquisitionError:
            if self.read_integer(ENABLE):  # otherwise it has ended by itself meanwhile
                raise
        return True

    def _write(self, address: int, data: bytes) -> None:
        with self._explained():
            self._opened().write(address, data)

    def _opened(self) -> ModbusClient:
        if self._client is None:
            raise AcquisitionError(f"{self.description} is closed")
        return self._client

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        """Add the device's own error code and its remedy to the error of a rejected request."""
        try:
            yield
        except ModbusError as error:
            code = 0
            with contextlib.suppress(AcquisitionError):
                code = int.from_bytes(self._opened().read(55000, 1), "big")
            remedy = ERROR_REMEDIES.get(code, "restart it, and update its firmware if that does not help")
            raise AcquisitionError(f"{error}, LabJack error {code}: {remedy}") from None

    def close(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client = None
