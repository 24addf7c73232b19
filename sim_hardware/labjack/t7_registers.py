"""Registers of a simulated LabJack T7, by type, as in LabJack's ljm_constants.json."""

import struct
from collections.abc import Mapping

from sim_hardware.plant import CardParameters

SERIAL, TIMER, STAMP, LAST_ERROR, FLASH, FLASH_POINTER = 60028, 61520, 4026, 55000, 61812, 61810
ENABLE, SCAN_RATE, CHANNELS, PACKET, BUFFER, TARGET, DATA_TYPE, SCAN_LIST = (
    4990,
    4002,
    4004,
    4006,
    4012,
    4016,
    4018,
    4100,
)
CALIBRATION = 0x3C4000
OUT_TARGET, OUT_ALLOCATE, OUT_LOOP, OUT_SET_LOOP, OUT_ENABLE, OUT_BUFFER, OUT_SLOT = (
    4040,
    4050,
    4060,
    4070,
    4090,
    4400,
    4800,
)
STREAM_OUT = (OUT_TARGET, OUT_ALLOCATE, OUT_LOOP, OUT_SET_LOOP, OUT_ENABLE)
"""Settings of STREAM_OUT0."""

DACS = {1000: "DAC0", 1002: "DAC1"}
NUM_SCANS, TO_BOOTUP, REBOOT, REBOOT_KEY = 4020, 61991, 61998, 0x4C4A0000
READ_ONLY = (STAMP, LAST_ERROR, 60000, 60004, 60010, SERIAL, TIMER)

_STREAM_TYPES = dict.fromkeys([CHANNELS, PACKET, 4010, BUFFER, 4014, TARGET, DATA_TYPE, 4020, 4022, 4024, STAMP], "I")
_TYPES: Mapping[int, str] = {
    **{40000 + 2 * n: "f" for n in range(16)},
    **{41000 + n: "H" for n in range(16)},
    **{SCAN_LIST + 2 * n: "I" for n in range(128)},
    SCAN_RATE: "f",
    4008: "f",
    **_STREAM_TYPES,
    **dict.fromkeys(DACS, "f"),
    **dict.fromkeys(STREAM_OUT, "I"),
    TO_BOOTUP: "H",
    REBOOT: "I",
    ENABLE: "I",
    46100: "I",
    LAST_ERROR: "H",
    60000: "f",
    60004: "f",
    60010: "I",
    SERIAL: "I",
    TIMER: "I",
    61600: "I",
    FLASH_POINTER: "I",
}
RANGE_INVALID, STREAMING, NOT_STREAMED, TOO_FAST, BAD_TYPE = 2370, 2605, 2625, 2608, 2611
BAD_TARGET, BAD_BUFFER, BAD_PACKET, NO_CHANNEL, NOT_RUNNING = 2612, 2615, 2618, 2600, 2620
OUT_FULL, OUT_BAD_TARGET, OUT_LOOP_TOO_BIG, OUT_NOT_ENABLED = 2613, 2614, 2622, 2627
UNKNOWN_REGISTER, READ_ONLY_ERROR, BAD_COUNT, BAD_FUNCTION = 2, 3, 2313, 1
"""LabJack's error codes; the small ones stand for those that only the Modbus exception tells."""


class RegisterError(Exception):
    """A rejected request: LabJack's code."""

    def __init__(self, code: int) -> None:
        super().__init__(code)
        self.code = code


class RegisterFile:
    """Values of the registers; requests are whole registers.

    Args:
        parameters: of the card: serial number, and scaling, from which the calibration in the flash follows.
    """

    def __init__(self, parameters: CardParameters) -> None:
        self.values: dict[int, float] = dict.fromkeys(_TYPES, 0)
        self.values |= {60000: 7.0, 60004: 1.0292, SERIAL: parameters.serial} | {41000 + n: 199 for n in range(16)}
        offset_v, slope_v, *_ = parameters.coefficients
        self._calibration = struct.pack(
            ">4f", slope_v, -slope_v, 32768 - offset_v / slope_v, offset_v - 32768 * slope_v
        )

    def read(self, address: int, count: int) -> bytes:
        """Return registers as big-endian bytes. Raises RegisterError."""
        if address == FLASH:
            if int(self.values[FLASH_POINTER]) != CALIBRATION or count != 8:
                raise RegisterError(2350)
            return self._calibration
        return b"".join(self._packed(each) for each in self._addresses(address, count))

    def unpacked(self, address: int, data: bytes) -> dict[int, float]:
        """Return the values that a request writes, by register. Raises RegisterError."""
        written: dict[int, float] = {}
        for each in self._addresses(address, len(data) // 2):
            (written[each],) = struct.unpack_from(f">{_TYPES[each]}", data, 2 * (each - address))
            if each in READ_ONLY:
                raise RegisterError(READ_ONLY_ERROR)
            if 40000 <= each < 41000 and written[each] not in (0.0, 10.0):
                raise RegisterError(RANGE_INVALID)
        return written

    def _addresses(self, address: int, count: int) -> list[int]:
        """Return the registers of a request."""
        found, at = [], address
        while at < address + count:
            if at not in _TYPES:
                raise RegisterError(UNKNOWN_REGISTER)
            found.append(at)
            at += 1 if _TYPES[at] == "H" else 2
        if at != address + count or not found:
            raise RegisterError(BAD_COUNT)
        return found

    def _packed(self, address: int) -> bytes:
        kind = _TYPES[address]
        return struct.pack(f">{kind}", self.values[address] if kind == "f" else int(self.values[address]))
