"""Server of a simulated bench: SCPI and gRPC on loopback, and its controls by name."""

from dataclasses import asdict
from typing import Any

from drivers import Closeable
from sim_hardware.bench import SimulatedBench
from sim_hardware.nidaq import NiGrpcServer, SimulatedNiDevice
from sim_hardware.operator import BenchControls
from sim_hardware.wires import ScpiTcpServer

DEVICE_NAME = "Dev1"


VERBS = tuple(name for name in vars(BenchControls) if not name.startswith("_"))


class ServedBench(Closeable):
    """Serves the generator on a SCPI socket and the card behind NI's gRPC service, on loopback, until closed."""

    def __init__(self, bench: SimulatedBench) -> None:
        self.bench = bench
        shared = getattr(bench.clock, "shared", None) is not None
        self.scpi = ScpiTcpServer(
            bench.message_port,
            bench.parameters.speed,
            bench.parameters.generator.command_s,
            bench.clock if shared else None,
        )
        self.card = NiGrpcServer(SimulatedNiDevice(bench.card, bench.clock, bench.faults, DEVICE_NAME))
        bench.add_fault_listener(self.scpi.update_from_faults)
        bench.add_fault_listener(self.card.update_from_faults)

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
        self.scpi.close()
        self.card.close()
