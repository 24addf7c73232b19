"""Server of a simulated bench: SCPI and the card's own wire on loopback, and its controls by name."""

from dataclasses import asdict, replace
from typing import Any

from drivers import Closeable
from sim_hardware.bench import SimulatedBench
from sim_hardware.labjack import SimulatedT7, SimulatedT7Output
from sim_hardware.nidaq import NiGrpcServer, SimulatedNiDevice
from sim_hardware.operator import BenchControls
from sim_hardware.plant import SimulationParameters
from sim_hardware.wires import ScpiTcpServer

DEVICE_NAME = "Dev1"
SOURCE_SERIAL = 470054321
"""Serial number of the LabJack that plays the drives, another one than that of the card."""


VERBS = tuple(name for name in vars(BenchControls) if not name.startswith("_"))


class ServedBench(Closeable):
    """Serves the generator on a SCPI socket, and the card behind NI's gRPC service or as a LabJack, on loopback, until closed.

    Attributes:
        labjack: LabJack that plays the drives; None on a bench with another source.
    """

    def __init__(self, bench: SimulatedBench) -> None:
        self.bench = bench
        shared = getattr(bench.clock, "shared", None) is not None
        self.scpi = ScpiTcpServer(
            bench.message_port,
            bench.parameters.speed,
            bench.parameters.generator.command_s,
            bench.clock if shared else None,
        )
        self.card: NiGrpcServer | SimulatedT7
        if bench.parameters.card.product.startswith("T7"):
            self.card = SimulatedT7(bench.card, bench.clock, bench.faults)
        else:
            self.card = NiGrpcServer(SimulatedNiDevice(bench.card, bench.clock, bench.faults, DEVICE_NAME))
        self.labjack: SimulatedT7 | None = None
        if bench.parameters.source in bench.dacs:
            parameters = SimulationParameters.from_record({"card": {"product": "T7"}}).card
            outputs = {1000: bench.dacs["DAC0"], 1002: bench.dacs["DAC1"]}
            stored_v, clock_ppm = bench.parameters.card.power_up_v, bench.parameters.generator.clock_ppm
            self.labjack = SimulatedT7(
                bench.card,
                bench.clock,
                bench.faults,
                SimulatedT7Output(outputs, bench.clock, stored_v, clock_ppm),
                replace(parameters, serial=SOURCE_SERIAL),
            )
            bench.add_fault_listener(self.labjack.update_from_faults)
        bench.add_fault_listener(self.scpi.update_from_faults)
        bench.add_fault_listener(self.card.update_from_faults)

    @property
    def source_address(self) -> str:
        """VISA resource string of the generator, or address of the LabJack that plays the drives."""
        return self.scpi.resource if self.labjack is None else self.labjack.address

    @property
    def source_connections(self) -> int:
        """Number of open connections to the source."""
        return self.scpi.connections if self.labjack is None else self.labjack.connections

    def control(self, verb: str, **arguments: Any) -> Any:
        """Call a method of `BenchControls` by name; return its result as plain values.

        Raises:
            ValueError: unknown verb, wrong arguments, or unknown fault.
        """
        if verb not in VERBS:
            raise ValueError(f"there is no verb {verb!r}: choose from {', '.join(VERBS)}")
        try:
            result = getattr(self.bench, verb)(**arguments)
        except TypeError as error:
            raise ValueError(f"{verb}: {error}") from error
        return asdict(result) if verb == "report" else result

    def close(self) -> None:
        """Stop both servers."""
        if self.labjack is not None:
            self.labjack.close()
        self.scpi.close()
        self.card.close()
