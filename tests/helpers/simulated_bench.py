"""Simulated bench for tests; the volts of every run on it are checked."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from app.config.bench_file import BenchConfig, load_bench
from app.session.bench_connection import BenchConnection, connect
from protocols.base import Event, EventBus, PointMeasured, Protocol, RunStatus, Verdict
from protocols.runner.request import RunControl, RunRequest
from protocols.runner.runner import Runner
from sim_hardware.plant.history_report import VoltageReport
from sim_hardware.testing.safe_volts import assert_safe_voltage


@dataclass
class Ran:
    """What became of a run."""

    status: RunStatus
    reason: str
    path: Path
    events: list[Event]
    report: VoltageReport
    laboratory: BenchConnection
    verdict: Verdict

    @property
    def points(self) -> list[Any]:
        return [event.point for event in self.events if isinstance(event, PointMeasured)]

    def kinds(self) -> list[str]:
        return [event.kind for event in self.events]


def simulated(**truth: Any) -> BenchConfig:
    """The bench file that comes with the program, with parts of its truth replaced: `sensor={"noise_m": 0.0}`."""
    config = load_bench("ideal")
    record = dict(config.simulation or {})
    for name, value in truth.items():
        record[name] = {**record.get(name, {}), **value} if isinstance(value, dict) else value
    return config.model_copy(update={"simulation": record})


@contextmanager
def laboratory(config: BenchConfig | None = None) -> Iterator[BenchConnection]:
    with connect(config or simulated(), None) as lab:
        yield lab


@contextmanager
def installed(library: Any) -> Iterator[None]:
    """Replace NI's C library: the package loads `library` instead of NI's own."""
    from nidaqmx._lib import DaqFunctionImporter, lib_importer

    before = lib_importer._windll, lib_importer._cdll, lib_importer._encoding
    lib_importer._windll = lib_importer._cdll = DaqFunctionImporter(library)
    lib_importer._encoding = "utf-8"
    try:
        yield
    finally:
        lib_importer._windll, lib_importer._cdll, lib_importer._encoding = before


@dataclass
class Trigger:
    """An observer that acts once, when `when` is true of an event."""

    when: Callable[[Event], bool]
    act: Callable[[], Any]
    done: bool = field(default=False)

    def __call__(self, event: Event) -> None:
        if not self.done and self.when(event):
            self.done = True
            self.act()


def run(
    protocol: Protocol,
    folder: Path,
    lab: BenchConnection,
    *observers: Callable[[Event], None],
    cancel: threading.Event | None = None,
    pause: threading.Event | None = None,
    safe: bool = True,
    operator: Any = None,
    specimen: str = "T1",
) -> Ran:
    """Run a protocol on a virtual bench; by default the voltage must have been safe."""
    events: list[Event] = []
    control = RunControl(cancel or threading.Event(), pause or threading.Event())
    request = RunRequest(protocol, folder, specimen)
    runner = Runner(request, lab.bench, operator or lab.operator, EventBus(events.append, *observers), control)
    ended = runner.run()
    report = lab.control.report()
    if safe:
        assert_safe_voltage(report)
    return Ran(ended.status, ended.reason, runner.path, events, report, lab, ended.verdict)
