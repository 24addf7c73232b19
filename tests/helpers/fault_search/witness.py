"""What the card and the instruments of a simulated bench show of a fault, noted at their source."""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any
from unittest import mock

from app.session.bench_connection import BenchConnection
from app.session.state import BenchState, WindowState
from drivers.errors import AcquisitionError, InstrumentError
from drivers.interfaces import Block
from drivers.nidaq.analog_input import NiStream
from model.amplifier_map import AmplifierMap
from sim_hardware.nidaq.in_process_digitizer import SimulatedStream
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS

SLACK_V = 12.0
"""Volts at the specimen: rounding of the view, noise, and a ramp between two blocks."""

PARTS = {
    **dict.fromkeys(("drive-cable-off", "generator-power-off", "output-tripped"), "generator"),
    **dict.fromkeys((name for name in FAULT_DESCRIPTIONS if name.startswith("scpi")), "generator"),
    **dict.fromkeys(("card-unplugged", "card-overrun", "grpc-gone"), "card"),
    **dict.fromkeys(("sensor-out-of-range", "sensor-stuck"), "sensor"),
}
"""The part at fault; faults of the specimen, the amplifier's limit and a drift of 50 ppm show in results only."""


class Witness:
    """Notes the blocks that leave the card, the errors of the instruments, and when a fault first shows in them."""

    lab: BenchConnection | None = None
    view: WindowState
    """The state of the program at present."""

    def __init__(self) -> None:
        self.blocks: list[tuple[float, float, float]] = []
        """Bench time of the last sample, and lowest and highest volts at the specimen, of each block that was read."""
        self.fault, self.injected_s, self.shown_s = "", math.inf, math.inf

    def now(self) -> float:
        assert self.lab is not None
        return self.lab.bench.clock.now()

    def inject(self, fault: str) -> None:
        assert self.lab is not None
        assert self.lab.control is not None
        self.fault, self.injected_s = fault, self.now()
        self.lab.control.inject(fault)

    def block(self, block: Block, stream: SimulatedStream | NiStream) -> None:
        volts = stream.scales[0].to_volts(block.raw[0])
        low, high = AmplifierMap().specimen_v([volts.min(), volts.max()])
        first_s, last_s = (stream.start_time_s + scan / stream.rate_hz for scan in (block.start, block.stop))
        self.blocks.append((last_s, float(low), float(high)))
        part, sensor = PARTS.get(self.fault), stream.scales[1].to_volts(block.raw[1])
        if first_s < self.injected_s:
            return
        # Before it was set up a source may be anywhere, and on its way to rest it strays until it stands still.
        strays = self.view.phase is not BenchState.ARMING and max(abs(low), abs(high)) > SLACK_V
        if self.view.phase is BenchState.GOING_TO_REST:
            lately = self.blocks[-4:]
            stands = all(max(abs(b_low - low), abs(b_high - high)) < SLACK_V for _, b_low, b_high in lately)
            strays = strays and stands and lately[0][0] > self.injected_s
        playing = self.view.phase is BenchState.LIVE and self.view.drive is not None
        if (
            part == "generator" and not self.fault.startswith("scpi") and (high - low < 1.0 if playing else strays)
        ) or (self.fault == "sensor-out-of-range" and sensor.min() > 10.0):
            self.show()
        if self.fault == "sensor-stuck" and playing and high - low > 500.0 and first_s > self.injected_s + 0.2:
            self.show()

    def error(self, error: InstrumentError) -> None:
        part = "card" if isinstance(error, AcquisitionError) else "generator"
        if self.fault and PARTS.get(self.fault) == part:
            self.show()

    def show(self) -> None:
        """Note that the fault shows now."""
        self.shown_s = min(self.shown_s, self.now())

    @contextmanager
    def noting(self, streams: type[SimulatedStream | NiStream] = SimulatedStream) -> Iterator[None]:
        """Note every block of these streams and every error of this process."""
        read = streams.read

        def noted(stream: SimulatedStream | NiStream) -> Block:
            block = read(stream)  # type: ignore[arg-type]
            self.block(block, stream)
            return block

        def made(error: InstrumentError, *arguments: Any) -> None:
            Exception.__init__(error, *arguments)
            self.error(error)

        with (
            mock.patch.object(streams, "read", noted),
            mock.patch.object(InstrumentError, "__init__", made, create=True),
        ):
            yield
