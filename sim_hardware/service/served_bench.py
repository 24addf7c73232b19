"""A simulated bench on its real wires, and the words by which another process breaks, mends and asks it."""

from dataclasses import asdict
from typing import Any

from drivers.closing import Closing
from sim_hardware.bench import VirtualBench
from sim_hardware.nidaq.grpc_server import NiServer
from sim_hardware.nidaq.input_task import NiDevice
from sim_hardware.wires.tcp_server import ScpiServer

DEVICE = "Dev1"


class ServedBench(Closing):
    """The generator on a SCPI socket and the card behind NI's gRPC service, both on loopback, until closed."""

    def __init__(self, bench: VirtualBench) -> None:
        self.bench = bench
        self.scpi = ScpiServer(bench.port, bench.truth.speed, bench.truth.generator.command_s)
        self.card = NiServer(NiDevice(bench.card, bench.clock, bench.faults, DEVICE))
        bench.on_fault(self.scpi.poke)
        bench.on_fault(self.card.follow_faults)

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
            "hands": bench.hands,
            "inject": bench.inject,
            "clear": bench.clear,
            "faults": bench.faults.all_active,
            "report": lambda **k: asdict(bench.report(**k)),
            "now": bench.clock.now,
            "laser_sees": bench.laser_sees,
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
