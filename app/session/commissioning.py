"""Commissioning of a bench: exercises its source with high voltage off, and measures its interlock with high voltage on."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

from app.config import BenchConfig
from app.session.bench_connection import UNATTENDED_BLOCK_S, BenchConnection, allows_second_connection, connect
from app.session.commissioning_record import save_record, simulated_bench_key
from drivers import AcquisitionError, Bench, Identity, ScpiSession, VisaLink
from drivers.evidence import OutputCheck
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Event, Prompt
from protocols.commissioning import (
    CheckedOutput,
    Commissioned,
    MessageLog,
    commission_bench,
    measure_interlock,
    worst_verdict,
)

RATES_HZ = (100e3, 50e3, 20e3)
"""Scans per second: the first that the card can do."""

SOURCE_OFF = replace(
    DISABLE_HIGH_VOLTAGE,
    text=f"{DISABLE_HIGH_VOLTAGE.text} The amplifier's input stays connected to the generator and to the card.",
)
INTERLOCK_ON = replace(
    ENABLE_HIGH_VOLTAGE,
    text=f"The interlock is measured with 300 V on the specimen. {ENABLE_HIGH_VOLTAGE.text}",
)
INTERLOCK_OFF = replace(
    DISABLE_HIGH_VOLTAGE, text="The interlock is measured. Switch the amplifier's high voltage OFF at the amplifier."
)
INTERLOCK_NOT_MEASURED = CheckedOutput(OutputCheck.INTERLOCK, math.nan, "s", None, None)


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
    ask: Callable[[Prompt], object],
    progress: Callable[[str, float], object] = lambda _name, _fraction: None,
    check_stop: Callable[[], object] = lambda: None,
    publish: Callable[[Event], object] = lambda _: None,
    on_live: Callable[[Bench], object] = lambda _: None,
) -> CommissionedSource:
    """Commission the source of a bench, and after a source that passed the interlock that is wired; store the record.

    Args:
        config: the bench file.
        speed: of a simulated bench; None is the virtual clock, on which an interlock is bridged.
        ask: function that returns when the operator has done what a prompt says; raises to abandon. On a simulated bench the
            simulated operator does it then.
        progress: callback with the name of each exercise at its begin, and the completed fraction.
        check_stop: callback with every block; raises to abandon, with the source brought to rest.
        publish: callback with the events of the measurement with high voltage on.
        on_live: callback with the bench of that measurement, before high voltage is switched on.

    Raises:
        BenchError: an instrument is absent, or rejects its set-up.
        OSError: the record cannot be written.
    """
    messages = MessageLog()
    with connect(config, speed, UNATTENDED_BLOCK_S, messages.observe) as connection:
        bench = connection.bench
        rate_hz = _highest_rate(bench)
        second_client = _second_client(config) if not config.simulated else None
        switch = _Switch(connection, ask)
        result = commission_bench(bench, switch, rate_hz, messages, progress, second_client, check_stop)
        identity = bench.amplifier.identity
        of_source, wired = result, config.interlock.line and (not config.simulated or speed is not None)
        if wired:  # until it is measured, so that a commissioning that ends before is no valid one
            result = replace(of_source, checks=(*of_source.checks, INTERLOCK_NOT_MEASURED))
        path = save_record(identity, config.simulated, rate_hz, result, simulated_bench_key(config), config.card.driver)
    if wired and worst_verdict(of_source.checks) == "pass":
        progress("interlock", 1.0)
        reason = "its interlock is measured now"
        with connect(
            config, speed, UNATTENDED_BLOCK_S, without_commissioning=reason, measures_interlock=True
        ) as connection:
            on_live(connection.bench)
            switch = _Switch(connection, ask, is_off=True, may_enable=True)
            check = measure_interlock(connection.bench, switch, check_stop, publish)
            times = replace(of_source.times, interlock_s=check.value)
            result = replace(of_source, checks=(*of_source.checks, check), times=times)
            path = save_record(identity, config.simulated, rate_hz, result, simulated_bench_key(config))
            switch.disable()
    return CommissionedSource(identity, result, rate_hz, path)


def _second_client(config: BenchConfig) -> Callable[[], float] | None:
    """Return a function that opens a second connection to the source and returns the time of its reply; None if two would interfere."""
    wire = config.source_connection
    if config.source.kind in ("card-output", "labjack-output") or not allows_second_connection(wire.resource):
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
    ask: Callable[[Prompt], object]
    is_off: bool = False
    may_enable: bool = False

    def disable(self) -> None:
        if not self.is_off:
            self._switch(INTERLOCK_OFF if self.may_enable else SOURCE_OFF)
            self.is_off = True

    def enable(self) -> None:
        if not self.may_enable:
            raise AssertionError("a source is commissioned with high voltage off")
        self.is_off = False
        self._switch(INTERLOCK_ON)

    def _switch(self, prompt: Prompt) -> None:
        self.ask(prompt)
        if self.connection.operator is not None:
            self.connection.operator.show(0, prompt)


def _highest_rate(bench: Bench) -> float:
    """Return the highest of `RATES_HZ` that the card can do; the last one is tried by the caller."""
    for rate_hz in RATES_HZ[:-1]:
        try:
            with bench.open_stream(rate_hz):
                return rate_hz
        except AcquisitionError:
            continue
    return RATES_HZ[-1]
