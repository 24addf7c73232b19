"""LabJack T7 as a digitizer: analogue inputs over Modbus TCP, without a driver of its maker."""

import struct
from collections.abc import Sequence

from drivers.clock import Clock
from drivers.errors import AcquisitionError
from drivers.interfaces import Scale
from drivers.labjack.t7_registers import WATCHDOG, T7Registers, terminal_number
from drivers.labjack.t7_stream import ScanList, T7Stream, packet_samples

RANGE_V = 10.0
"""The only used input range: the sample rate and the time between conversions are documented for it."""

MAX_SAMPLE_HZ = 100_000.0
"""Largest sample rate of all channels together."""

CONVERT_S, FAST_CONVERT_S, FAST_SAMPLE_HZ = 15e-6, 8e-6, 60_000.0
"""Time between the conversions of two channels of a scan, and the shorter one above this sample rate."""

GROUND_CHANNEL = 15
"""Input that is connected to ground inside the T7, converted before the drive if the rate allows it: an open input shows the
previously converted voltage, and must not look like rest because the laser's output is near 2.5 V."""

SINGLE_ENDED = 199
"""Negative channel of a single-ended input."""

SLOPE_TOLERANCE = 1e-4
"""Largest relative difference between the slopes of positive and negative voltages, the accuracy of the device."""


class T7Digitizer:
    """Analogue inputs of a T7 as a `Digitizer` (see drivers.interfaces).

    Args:
        device: IP address; with a relay also its two ports, `192.0.2.9:1502:1702`.
        channels: terminals, drive first, e.g. `("AIN0", "AIN1")`; `ai0` is the same.
        clock: bench time.
        server: takes precedence over `device`; empty or None for a T7 in the network.
        range_v: input range, +- volts; only 10.
        terminal: `DEFAULT` or `RSE`: single-ended; `DIFF`: the next odd terminal is the negative one.

    Raises:
        AcquisitionError: the device does not answer, is another one, or a setting is not possible.
    """

    def __init__(
        self,
        device: str,
        channels: tuple[str, ...],
        clock: Clock,
        *,
        server: str | None = None,
        range_v: float = RANGE_V,
        terminal: str = "DEFAULT",
    ) -> None:
        self._channels, self._clock = tuple(map(terminal_number, channels)), clock
        self._differential = terminal == "DIFF"
        if range_v != RANGE_V:
            raise AcquisitionError(
                f"a LabJack T7 is used with its range of 10 V, not {range_v:g} V; give card.range_v = 10"
            )
        if terminal not in ("DEFAULT", "RSE", "DIFF"):
            raise AcquisitionError(f"a LabJack T7 has no inputs of the kind {terminal}; give card.terminal RSE or DIFF")
        if self._differential and (odd := [each for each in self._channels if each % 2]):
            raise AcquisitionError(
                f"AIN{odd[0]} is the negative terminal of a differential input of a LabJack T7; give an even one, e.g. AIN{odd[0] - 1}, "
                "or card.terminal = 'RSE'"
            )
        self._registers = T7Registers(server or device)
        self.identity = self._registers.identity
        self._stream: T7Stream | None = None

    def stream(self, rate_hz: float, block_scans: int) -> T7Stream:
        """Begin to acquire (see drivers.interfaces.Digitizer.stream)."""
        with_ground = (GROUND_CHANNEL, *self._channels)
        fits = rate_hz * len(with_ground) <= MAX_SAMPLE_HZ
        return self._start(with_ground if fits else self._channels, int(fits), rate_hz, block_scans)

    def scan(self, order: Sequence[int], rate_hz: float, block_scans: int) -> T7Stream:
        """Begin to acquire channels in this order (see drivers.interfaces.ScanLister)."""
        return self._start(tuple(self._channels[k] for k in order), 0, rate_hz, block_scans)

    def _start(self, numbers: tuple[int, ...], grounded: int, rate_hz: float, block_scans: int) -> T7Stream:
        where = self._registers.description
        if self._stream is not None and self._stream.is_open:
            raise AcquisitionError(f"{where} is already acquiring; stop that first")
        if block_scans < 1 or not 0 < rate_hz * len(numbers) <= MAX_SAMPLE_HZ:
            raise AcquisitionError(
                f"{where} takes {MAX_SAMPLE_HZ:g} samples/s, not {len(numbers)} inputs at {rate_hz:g} Hz; lower the sample rate to "
                f"{MAX_SAMPLE_HZ / len(numbers):g} Hz"
            )
        self._registers.reopen()
        self._check_idle()
        actual_hz = self._configure(numbers, rate_hz, packet_samples(len(numbers), block_scans))
        convert_s = FAST_CONVERT_S if actual_hz * len(numbers) > FAST_SAMPLE_HZ else CONVERT_S
        coefficients = self._read_coefficients()
        scales = tuple(Scale(coefficients, skew_s=(slot - grounded) * convert_s) for slot in range(len(numbers)))
        self._stream = T7Stream(
            self._registers, ScanList(numbers, scales, grounded, actual_hz), block_scans, self._clock
        )
        return self._stream

    def _check_idle(self) -> None:
        """Stop a stream of an ended program.

        Raises:
            CardInUseError: another program streams.
            AcquisitionError: the device resets itself during a stream.
        """
        registers = self._registers
        registers.end_stream()
        if registers.read_integer(WATCHDOG):
            raise AcquisitionError(
                f"the watchdog of {registers.description} is on, and a stream does not keep it from acting; switch it off: "
                "WATCHDOG_ENABLE_DEFAULT = 0"
            )

    def _configure(self, numbers: Sequence[int], rate_hz: float, packet: int) -> float:
        """Write the settings of inputs and stream; return the actual scans per second."""
        registers = self._registers
        for number in dict.fromkeys(numbers):
            registers.write_float(40000 + 2 * number, RANGE_V)
            differential = self._differential and number != GROUND_CHANNEL
            registers.write_short(41000 + number, number + 1 if differential else SINGLE_ENDED)
        return registers.configure_stream(rate_hz, [2 * number for number in numbers], packet)

    def _read_coefficients(self) -> tuple[float, float]:
        """Return volts = c0 + c1 n of the device's own calibration, n the 16-bit code less 32768."""
        registers = self._registers
        registers.write_integers(61810, 0x3C4000)
        positive, negative, center, _ = struct.unpack(">4f", registers.read(61812, 8))
        slope = (positive - negative) / 2
        if not (slope > 0 and abs(positive + negative) <= SLOPE_TOLERANCE * slope and 0 < center < 65536):
            raise AcquisitionError(
                f"{registers.description} has no valid calibration (slopes {positive:g} and {negative:g} V, centre {center:g}); have "
                "it calibrated by its maker"
            )
        return (32768 - center) * slope, slope

    def close(self) -> None:
        """Stop a running acquisition, and disconnect."""
        if self._stream is not None:
            self._stream.close()
        self._registers.close()
