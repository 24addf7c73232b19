"""Composition root: opens the real or simulated instruments of a bench file."""

import importlib
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from app.config import BenchConfig
from app.session.commissioning_gate import commissioning_state
from app.session.instruments import (
    ReadDisplacement,
    lock_panel,
    open_digitizer,
    open_environment_sensor,
    open_interlock,
    open_meters,
    open_source,
    source_options,
)
from app.session.session import BuiltInOperator
from app.session.suspend import suspend_inhibited
from drivers import (
    MANUAL_SHUTDOWN_INSTRUCTIONS,
    WATCHDOG_DISABLED_WARNING,
    Bench,
    Clock,
    Digitizer,
    HeartbeatClock,
    HvAmplifier,
    Identity,
    InstrumentError,
    LevelSettings,
    Link,
    Meter,
    NoWatchdog,
    Source,
    UnsafeError,
    Watchdog,
)
from sim_hardware import BenchControls, SimulatedOperator

if TYPE_CHECKING:
    from drivers import InstrumentLocks, VisaLink
    from sim_hardware import SimulatedBench

SERVED_OUTPUT_WARNING = (
    "No watchdog: the drive is played by the card behind a gRPC server, which keeps it reserved. If this program "
    "dies while the bench is live, a drive ends by itself at rest, and a held level returns to rest after 5 s"
)


BLOCK_S = 0.05
"""Block duration at real speed; it grows with the speed, because every block costs a round trip."""

UNATTENDED_BLOCK_S = 0.1
"""Block duration on the virtual clock without a display: half the blocks, and an abort level is reported within 0.1 s."""


UNATTENDED_HOLD_S = 0.05
"""Real time for which such blocks are held and then written to the run file together; a killed program loses no more."""


@dataclass(frozen=True, slots=True)
class BenchConnection:
    """A connected bench. On a simulated one `operator` answers prompts and `control` injects faults."""

    bench: Bench
    operator: BuiltInOperator | None = None
    control: BenchControls | None = None


LinkWrapper = Callable[[Link, Clock], Link]
"""Wraps the link to the source, for a front end that observes its messages."""


@contextmanager
def connect(
    config: BenchConfig,
    speed: float | None = None,
    block_s: float = BLOCK_S,
    wrap_link: LinkWrapper = lambda link, _: link,
    without_commissioning: str = "",
    notice: str = "",
    measures_interlock: bool = False,
) -> Iterator[BenchConnection]:
    """Open the instruments of a bench and close them at the end; the source stays at rest.

    Args:
        config: the bench file.
        speed: of a simulated bench, times real; None is the virtual clock, in this process.
        block_s: bench time of a block on the virtual clock.
        wrap_link: wraps the link to the source.
        notice: command that reports the end of each run; empty: none.
        without_commissioning: why high voltage may be switched on with a real source that has no valid commissioning record.
        measures_interlock: whether the interlock is to be measured, which a source that relies on it waits for.

    Raises:
        BenchError: an instrument does not answer.
    """
    control: BenchControls | None = None
    with ExitStack() as stack:
        wrap_link = _recorded(config, stack, wrap_link)
        if not config.simulated:
            suspend_warning = stack.enter_context(suspend_inhibited())
            bench = _open_instruments(
                config, stack, HeartbeatClock(), config.source_address, config.card.server, wrap_link
            )
            bench.suspend_warning = suspend_warning
        elif speed is None:
            from sim_hardware import SimulatedBench, VirtualClock, keep_freed_memory

            keep_freed_memory()
            clock = VirtualClock()
            control = virtual = SimulatedBench(config.simulation_parameters, clock)
            source, digitizer = _open_virtual(config, virtual, wrap_link, stack)
            meters = open_meters(config.meters, clock, stack, virtual.laser_reading_m)
            bench = _make_bench(config, clock, source, digitizer, meters, stack, lambda _: NoWatchdog())
            bench.block_s, bench.hold_s = block_s, UNATTENDED_HOLD_S if block_s >= UNATTENDED_BLOCK_S else 0.0
        else:
            from sim_hardware.service import BenchProcess

            control = process = stack.enter_context(
                BenchProcess(config.simulation_parameters, speed, meanwhile=_import_for_a_run)
            )
            beating = HeartbeatClock(speed, process.time)
            bench = _open_instruments(
                config, stack, beating, process.resource, process.server, wrap_link, process.laser_reading_m
            )
        _gate(config, bench, without_commissioning, measures_interlock)
        _equip(bench, config, stack, notice, control)
        operator = SimulatedOperator(control, config.simulation_parameters.hands.patience_s) if control else None
        yield BenchConnection(bench, operator, control)


def _open_virtual(
    config: BenchConfig, virtual: "SimulatedBench", wrap_link: LinkWrapper, stack: ExitStack
) -> tuple[Source, Digitizer]:
    """Open source and card of a simulated bench in this process; an output of a card or a LabJack over its own connection."""
    clock, card_output = virtual.clock, config.source.kind == "card-output"
    server = ""
    if card_output or config.source.kind == "labjack-output":
        from sim_hardware.service import ServedBench

        served = stack.enter_context(ServedBench(virtual))
        server = served.card.address if card_output else served.source_address
    digitizer: Digitizer
    if card_output:  # input and output are one card, served in its own time
        digitizer = open_digitizer(config, clock, server, stack)
    else:
        digitizer = virtual.digitizer(terminals=["ai0", "ai1", *(each.channel for each in config.channels)])
    return open_source(
        config, clock, lambda timeout_s: wrap_link(virtual.link(timeout_s), clock), server, stack
    ), digitizer


def _equip(bench: Bench, config: BenchConfig, stack: ExitStack, notice: str, control: BenchControls | None) -> None:
    """Open the sensor of the air, name it among the instruments, and state the command that reports the end of a run."""
    bench.notice = notice
    bench.environment = open_environment_sensor(config.environment, stack, control)
    if bench.environment is not None:
        identities = {**bench.configuration["identities"], "environment": str(bench.environment.identity)}
        bench.configuration = {**bench.configuration, "identities": identities}


def _recorded(config: BenchConfig, stack: ExitStack, wrap_link: LinkWrapper) -> LinkWrapper:
    """Return the wrapper of the link to the source that also records its messages, if the bench file names a file."""
    if not config.source.record_messages:
        return wrap_link
    from drivers import MessageRecord

    record = stack.enter_context(MessageRecord(Path(config.source.record_messages).expanduser()))
    return lambda link, clock: record.around(wrap_link(link, clock), clock.now)


def _import_for_a_run() -> None:
    """Import the modules for opening served instruments and running a protocol, which takes about as long as the server's start."""
    from protocols.runner import PRELOADED_MODULES

    for name in ("grpc", "nidaqmx.system", "pyvisa_py", *PRELOADED_MODULES):
        importlib.import_module(name)


def _gate(config: BenchConfig, bench: Bench, without_commissioning: str, measures_interlock: bool) -> None:
    """Keep high voltage off a real source that is not commissioned, unless there is a reason; each run stores which."""
    simulated_bench = ""
    if config.simulated and (bench.amplifier.plays_to_the_end or config.interlock.line):
        from app.session.commissioning_record import simulated_bench_key

        simulated_bench = simulated_bench_key(config)
    state = commissioning_state(bench.amplifier.identity, bench.simulated, without_commissioning, simulated_bench)
    bench.amplifier.hastens_levels = state.level_stop_s > 0
    bench.amplifier.measured_stop_s, bench.interlock.measured_s = state.stop_s, state.interlock_s
    bench.amplifier.holds_by_offset = state.holds_by_offset
    bench.amplifier.byte_order(state.byte_order)
    bench.high_voltage_refusal, bench.commissioning_note = state.refusal, state.note
    relies_on_interlock = config.source.kind == "labjack-output" and not config.source.external_power
    if relies_on_interlock and not config.simulated and not state.interlock_s and not measures_interlock:
        bench.high_voltage_refusal = (
            f"{bench.amplifier.identity} gives 0 V without power, which is -500 V on the specimen, and its interlock on "
            f"{config.interlock.line} is not measured. Run `tactor-bench commission`, which measures it; --without-commissioning does not do for this source"
        )
    bench.configuration = {**bench.configuration, "commissioning": state.stored}


def _open_instruments(
    config: BenchConfig,
    stack: ExitStack,
    clock: HeartbeatClock,
    resource: str,
    server: str,
    wrap_link: LinkWrapper,
    read_displacement: ReadDisplacement | None = None,
) -> Bench:
    """Open the instruments: the same code for a real bench and a served simulated one.

    Raises:
        InstrumentError: one does not reply, is another one, or is controlled by another program.
        UnsafeError: the same, after a program that ended without releasing the bench.
    """
    from drivers import InstrumentLocks, ObservedLink

    answered_s: dict[str, float] = {}

    def open_link(timeout_s: float) -> Link:
        wire = _open_wire(config, resource, timeout_s)
        noted = ObservedLink(wire, lambda _: None, lambda: answered_s.update(generator=time.monotonic()))
        return wrap_link(noted, clock)

    address = resource if config.source.kind == "labjack-output" else server
    open_source_here = partial(open_source, config, clock, open_link, address, stack)
    own_source, card = config.source.kind != "card-output", f"{server or 'this computer'}/{config.card.device}"
    locks = stack.enter_context(InstrumentLocks(config.name, config.simulated))
    with _unsafe_if_left(locks):
        locks.lock_address("the card", card)
        try:
            digitizer = open_digitizer(config, clock, server, stack)
        except InstrumentError as error:
            if own_source:
                with suppress(
                    InstrumentError
                ):  # a source that does not answer either leaves nothing that could be done
                    locks.lock_address("the source", resource)
                    rest_without_card(config, open_source_here(), clock, error)
            raise
        locks.lock_identity("the card", digitizer.identity, card)
        if own_source:
            locks.lock_address("the source", resource)
        source = open_source_here()
        if own_source:
            locks.lock_identity("the source", source.identity, resource)
        for name, table in config.meters.items():
            locks.lock_address(f"the meter '{name}'", table.port)
        meters = open_meters(config.meters, clock, stack, read_displacement)
        watch = partial(_make_watchdog, config, resource, server, clock, locks.files)
        bench = _make_bench(config, clock, source, digitizer, meters, stack, watch, clock.speed)
        bench.interlock = open_interlock(config, server)
        stack.callback(bench.interlock.close)
    bench.answered_s = answered_s
    locks.forget_earlier_program()
    return bench


@contextmanager
def _unsafe_if_left(locks: "InstrumentLocks") -> Iterator[None]:
    """Turn an InstrumentError into an UnsafeError if the last program ended without releasing the bench."""
    try:
        yield
    except InstrumentError as error:
        if locks.left_by:
            raise UnsafeError(
                f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. {error}. The last program ended without releasing the bench, and may have left a drive "
                f"or a level on the specimen: {locks.left_by}"
            ) from error
        raise


def rest_without_card(config: BenchConfig, source: Source, clock: Clock, error: Exception) -> None:
    """Command rest if an earlier program left the source live; return if it did not.

    Raises:
        UnsafeError: it was left live, and no card can measure its level.
    """
    amplifier = HvAmplifier(source, config.amplifier.amplifier_map, config.amplifier.drive_limits, clock)
    if not amplifier.is_left_live():
        return
    outcome = "it was ramped to rest now, which is not measured"
    try:
        amplifier.force_rest()
    except InstrumentError as failure:
        outcome = f"it did not obey: {failure}"
    raise UnsafeError(
        f"{MANUAL_SHUTDOWN_INSTRUCTIONS}. The card cannot be had: {error}. An earlier program left a drive or a level on the "
        f"source; {outcome}"
    )


def _make_watchdog(
    config: BenchConfig, resource: str, server: str, clock: HeartbeatClock, locks: tuple[str, ...], source: Source
) -> Watchdog:
    """Return the watchdog: a process that opens the same driver on the same resource."""
    from drivers import PROGRAM_KEY, WatchdogClient, WatchdogConfig

    card_output, labjack = config.source.kind == "card-output", config.source.kind == "labjack-output"
    options = source_options(config, clock.speed)
    if labjack:
        options |= {"device": resource, "checks_power_up": False}
    if not config.watchdog.enabled or (card_output and server):
        clock.watchdog = NoWatchdog(SERVED_OUTPUT_WARNING if config.watchdog.enabled else WATCHDOG_DISABLED_WARNING)
        return clock.watchdog
    measured = commissioning_state(source.identity, config.simulated)
    clock.watchdog = WatchdogClient(
        WatchdogConfig(
            source=f"{type(source).__module__}:{type(source).__qualname__}",
            resource="" if card_output or labjack else resource,
            timeout_s=config.source_connection.timeout_s,
            baud=config.source_connection.baud,
            backend=_backend(config),
            options=options,
            map=config.amplifier.amplifier_map,
            limits=config.amplifier.drive_limits,
            speed=clock.speed,
            time_file="" if clock.shared is None else str(clock.shared.path),
            # Of bench time: only a simulated bench runs at raised speed, and its card then takes turns with the program.
            silence_s=config.watchdog.silence_s * max(clock.speed, 1.0),
            own_connection=config.watchdog.own_connection
            and not card_output
            and allows_second_connection(resource)
            and not getattr(source, "single_session", False),
            patience_s=config.watchdog.patience_s,
            lock_key=PROGRAM_KEY,
            locks=locks,
            measured_stop_s=measured.stop_s,
            measured_reply_s=measured.reply_s,
        )
    )
    return clock.watchdog


def _open_wire(config: BenchConfig, resource: str, timeout_s: float) -> "VisaLink":
    """Open the link to the source; it holds a lock that cannot be shared if the watchdog connects after its end only."""
    from drivers import VisaLink

    alone = not (config.watchdog.enabled and config.watchdog.own_connection)
    baud = config.source_connection.baud
    return VisaLink(resource, timeout_s, backend=_backend(config), baud=baud, holds_exclusive_lock=alone)


def _backend(config: BenchConfig) -> str:
    """Return the VISA library of the source; a simulated one listens on a socket of this computer."""
    return "@py" if config.simulated else config.source_connection.backend


def allows_second_connection(resource: str) -> bool:
    """Whether the connection allows two clients: on a serial, USB or GPIB line they would read each other's replies."""
    return not resource.upper().startswith(("ASRL", "USB", "GPIB"))


def _check_serial_number(identity: Identity, serial: str, table: str) -> None:
    if serial and identity.serial.upper() != serial.upper():
        raise InstrumentError(
            f"{identity} answers where the bench file expects serial number {serial}; connect that one, or correct {table} "
            "and look whether its calibration is the right one"
        )


def _make_bench(
    config: BenchConfig,
    clock: Clock,
    source: Source,
    digitizer: Digitizer,
    meters: Mapping[str, Meter],
    stack: ExitStack,
    make_watchdog: Callable[[Source], Watchdog],
    speed: float | None = None,
) -> Bench:
    if config.source.kind != "card-output":
        labjack = config.source.kind == "labjack-output"
        serial = config.source.serial if labjack else config.source_connection.serial
        table = {"dc-supply": "[supply]", "labjack-output": "[source]"}.get(config.source.kind, "[generator]")
        _check_serial_number(source.identity, serial, table)
    _check_serial_number(digitizer.identity, config.card.serial, "[card]")
    watchdog = make_watchdog(source)
    stack.callback(watchdog.close)
    identities = {
        "generator": str(source.identity),  # whichever kind of source it is
        "amplifier": " ".join(
            filter(None, (config.amplifier.name, config.amplifier.serial and f"#{config.amplifier.serial}"))
        ),
        "card": str(digitizer.identity),
        "sensor": config.sensor.name,
        **{name: str(meter.identity) for name, meter in meters.items()},
    }
    return Bench(
        amplifier=HvAmplifier(source, config.amplifier.amplifier_map, config.amplifier.drive_limits, clock, watchdog),
        digitizer=digitizer,
        sensor=config.sensor.laser_sensor,
        clock=clock,
        block_s=max(BLOCK_S, 0.02 * (speed or 1.0)),
        simulated=config.simulated,
        configuration={**config.model_dump(mode="json"), "identities": identities, "speed": speed or "max"},
        meters=meters,
        name=config.name,
        watchdog=watchdog,
        levels=LevelSettings(**config.specimen.model_dump(), **config.levels.model_dump()),
        panel_warning=lock_panel(config, source, stack),
        channels=tuple(table.input_channel for table in config.channels),
    )
