"""Simulated bench on its real wires in this process, with a TCP proxy on the generator's."""

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from typing import Any

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from drivers.bench.bench import Bench
from drivers.clock import WallClock
from sim_hardware.bench import SimulatedBench
from sim_hardware.operator import SimulatedOperator
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import simulated
from tests.wires.tcp_proxy import TcpProxy

SIMULATED = "simulated bench on its wires"


@dataclass
class WiredBench:
    """Attributes: `bench` is the program's, `control` the simulated one, whose generator is behind `proxy`."""

    bench: Bench
    control: SimulatedBench
    operator: SimulatedOperator
    proxy: TcpProxy
    served: ServedBench
    config: BenchConfig


def wired_config(served: ServedBench, proxy: TcpProxy, **tables: dict[str, Any]) -> BenchConfig:
    """Return the bench file of a served bench; `tables` replaces values in its tables."""
    record: dict[str, dict[str, Any]] = {
        "generator": {"resource": proxy.resource, "timeout_s": 2.0},
        "card": {"server": f"127.0.0.1:{served.card.port}"},
        "sensor": {"delay_s": 1e-4},
        "watchdog": {"enabled": False},
    }
    for name, values in tables.items():
        record[name] = {**record.get(name, {}), **values}
    return BenchConfig.model_validate(record)


@contextmanager
def wired(delay_s: float = 0.0, **tables: dict[str, Any]) -> Iterator[WiredBench]:
    """Connect a bench over loopback; every byte to and from the generator takes `delay_s`."""
    control = SimulatedBench(simulated().simulation_parameters, WallClock(1.0))
    with ExitStack() as stack:
        served = stack.enter_context(ServedBench(control))
        proxy = stack.enter_context(TcpProxy(served.scpi.port, delay_s))
        config = wired_config(served, proxy, **tables)
        bench = stack.enter_context(connect(config, without_commissioning=SIMULATED)).bench
        yield WiredBench(bench, control, SimulatedOperator(control), proxy, served, config)
