"""Commissioning of the source of a bench: opens the instruments and exercises the source with high voltage off."""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from app.config import BenchConfig
from app.session.bench_connection import UNATTENDED_BLOCK_S, BenchConnection, allows_second_connection, connect
from app.session.commissioning_record import save_record, simulated_bench_key
from drivers import AcquisitionError, Bench, Identity, ScpiSession, VisaLink
from protocols.commissioning import Commissioned, MessageLog, commission_bench, measure_interlock, worst_verdict

RATES_HZ = (100e3, 50e3, 20e3)
"""Scans per second: the first that the card can do."""


@dataclass(frozen=True, slots=True)
class CommissionedSource:
    """The result of a commissioning, and the record in which it is stored."""

    identity: Identity
    result: Commissioned
    rate_hz: float
    path: Path


def commission(
    config: BenchConfig,
    speed: float | None,
    high_voltage_off: Callable[[], None],
    progress: Callable[[str, float], object] = lambda _name, _fraction: None,
    check_stop: Callable[[], object] = lambda: None,
    high_voltage_on: Callable[[], None] | None = None,
) -> CommissionedSource:
    """Commission the source of a bench and store the record.

    Args:
        config: the bench file.
        speed: of a simulated bench; None is the virtual clock.
        high_voltage_off: function that returns after the operator has switched high voltage off; raises to abandon.
        progress: callback with the name of each exercise at its begin, and the completed fraction.
        check_stop: callback with every block; raises to abandon, with the source brought to rest.
        high_voltage_on: like high_voltage_off, to measure the bench's interlock after a source that passed; None: not measured.

    Raises:
        BenchError: an instrument is absent, or rejects its set-up.
        OSError: the record cannot be written.
    """
    messages = MessageLog()
    with connect(config, speed, UNATTENDED_BLOCK_S, messages.observe) as connection:
        bench = connection.bench
        rate_hz = _highest_rate(bench)
        second_client = _second_client(config) if not config.simulated else None
        switch = _Switch(connection, high_voltage_off)
        result = commission_bench(bench, switch, rate_hz, messages, progress, second_client, check_stop)
        identity = bench.amplifier.identity
        path = save_record(identity, config.simulated, rate_hz, result, simulated_bench_key(config))
    wired = config.interlock.line and (not config.simulated or speed is not None)
    if high_voltage_on is not None and wired and worst_verdict(result.checks) == "pass":
        progress("interlock", 1.0)
        with connect(config, speed, UNATTENDED_BLOCK_S) as connection:
            switch = _Switch(connection, high_voltage_off, high_voltage_on)
            check = measure_interlock(connection.bench, switch, check_stop)
        result = replace(result, checks=(*result.checks, check))
        path = save_record(identity, config.simulated, rate_hz, result, simulated_bench_key(config))
    return CommissionedSource(identity, result, rate_hz, path)


def _second_client(config: BenchConfig) -> Callable[[], float] | None:
    """Return a function that opens a second connection to the source and returns the time of its reply; None if two would interfere."""
    wire = config.source_connection
    if config.source.kind == "card-output" or not allows_second_connection(wire.resource):
        return None

    def reply_s() -> float:
        link = VisaLink(wire.resource, wire.timeout_s, backend=wire.backend, baud=wire.baud)
        try:
            begin_s = time.monotonic()
            ScpiSession(link, f"second connection to {wire.resource}").identify()
            return time.monotonic() - begin_s
        finally:
            link.close()

    return reply_s


@dataclass(slots=True)
class _Switch:
    """Switches high voltage off, and on to measure the interlock; the operator is prompted once for each."""

    connection: BenchConnection
    prompt_off: Callable[[], None]
    prompt_on: Callable[[], None] | None = None
    is_off: bool = False

    def disable(self) -> None:
        if self.is_off:
            return
        if self.connection.control is not None:
            self.connection.control.disable_hv()
        else:
            self.prompt_off()
        self.is_off = True

    def enable(self) -> None:
        if self.prompt_on is None:
            raise AssertionError("a source is commissioned with high voltage off")
        if self.connection.control is not None:
            self.connection.control.enable_hv()
        else:
            self.prompt_on()
        self.is_off = False


def _highest_rate(bench: Bench) -> float:
    """Return the highest of `RATES_HZ` that the card can do; the last one is tried by the caller."""
    for rate_hz in RATES_HZ[:-1]:
        try:
            with bench.open_stream(rate_hz):
                return rate_hz
        except AcquisitionError:
            continue
    return RATES_HZ[-1]
