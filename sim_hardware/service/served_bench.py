"""A simulated bench on its real wires, and the words by which another process breaks, mends and asks it."""

from dataclasses import asdict
from typing import Any

from drivers.closing import Closeable
from sim_hardware.bench import SimulatedBench
from sim_hardware.nidaq.grpc_server import NiGrpcServer
from sim_hardware.nidaq.input_task import SimulatedNiDevice
from sim_hardware.wires.tcp_server import ScpiTcpServer

DEVICE_NAME = "Dev1"


class ServedBench(Closeable):
    """The generator on a SCPI socket and the card behind NI's gRPC service, both on loopback, until closed."""

    def __init__(self, bench: SimulatedBench) -> None:
        self.bench = bench
        self.scpi = ScpiTcpServer(bench.message_port, bench.parameters.speed, bench.parameters.generator.command_s)
        self.card = NiGrpcServer(SimulatedNiDevice(bench.card, bench.clock, bench.faults, DEVICE_NAME))
        bench.add_fault_listener(self.scpi.update_from_faults)
        bench.add_fault_listener(self.card.update_from_faults)

    def control(self, verb: str, **arguments: Any) -> Any:
        """Carry out one verb; its answer as plain values.

        Verbs: enable_hv, disable_hv, hands(action, values), inject(fault), clear(fault), faults, report(tolerance_v), now, laser_sees.

        Raises:
            ValueError: unknown verb, wrong arguments, or unknown fault.
        """
        bench = self.bench
        verbs = {
            "enable_hv": bench.enable_hv,
            "disable_hv": bench.disable_hv,
            "hands": bench.perform_action,
            "inject": bench.inject,
            "clear": bench.clear,
            "faults": bench.faults.active_faults,
            "report": lambda **k: asdict(bench.report(**k)),
            "now": bench.clock.now,
            "laser_sees": bench.laser_reading_m,
        }
        if verb not in verbs:
            raise ValueError(f"there is no verb {verb!r}: choose from {', '.join(verbs)}")
        try:
            return verbs[verb](**arguments)  # type: ignore[operator]
        except TypeError as error:
            raise ValueError(f"{verb}: {error}") from error

    def close(self) -> None:
        """Stop both servers."""
        self.scpi.close()
        self.card.close()
