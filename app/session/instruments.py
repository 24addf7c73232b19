"""Instruments of a bench file: opens the source, the card and the meters, real or simulated."""

from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

from app.config import (
    DIGITIZERS,
    ENVIRONMENT_SENSORS,
    BenchConfig,
    EnvironmentTable,
    MeterTable,
    load_driver,
    open_generator,
)
from app.session.session import InstrumentAwaited, announcer
from drivers import Clock, Digitizer, Interlock, Link, Meter, Source

if TYPE_CHECKING:
    from drivers import EnvironmentSensor
    from sim_hardware import BenchControls

DRIVE_MARGIN_S = 0.1
"""Wall time for the computer and the bus to rewrite a drive of the card that is to be stopped."""

HOLD_LEASE_S, FAST_LEASE_S = 5.0, 2.0
"""For how long the card's output holds a level that this program does not renew; wall time on a bench at raised speed."""


def open_source(
    config: BenchConfig, clock: Clock, open_link: Callable[[float], Link], server: str, stack: ExitStack
) -> Source:
    """Open the source; `stack` closes it. `open_link` opens a connection with a reply timeout.

    `server` is the address of the card's server, or of a LabJack that plays the drives.

    Raises:
        InstrumentError: it does not answer, or another instrument does.
    """
    announcer.get()(InstrumentAwaited("generator"))
    match config.source.kind:
        case "card-output":
            from drivers import NiAnalogOutput

            output = NiAnalogOutput(
                clock=clock, **{**source_options(config, _clock_speed(clock)), "server": server or None}
            )
            stack.callback(output.close)
            return output
        case "labjack-output":
            from drivers.labjack import T7Output

            labjack = T7Output(clock=clock, **{**source_options(config, _clock_speed(clock)), "device": server})
            stack.callback(labjack.close)
            return labjack
        case "dc-supply":
            from drivers import DcSupply

            wire = open_link(config.supply.timeout_s)
            stack.callback(wire.close)
            return DcSupply(wire, clock, **source_options(config, _clock_speed(clock)))
        case "generator":
            wire = open_link(config.generator.timeout_s)
            stack.callback(wire.close)
            return open_generator(config.generator.driver, wire, clock, config.amplifier.step_v)


def lock_panel(config: BenchConfig, source: Source, stack: ExitStack) -> str:
    """Lock the generator's front panel if the bench file asks for it; `stack` unlocks it. Return the reason if it stays unlocked."""
    if not (config.source.kind == "generator" and config.generator.panel_lock):
        return ""
    lock: Callable[[], str] = getattr(source, "lock_panel", lambda: "this driver knows no command for it")
    if why := lock():
        return f"generator.panel_lock: {why}. Lock the front panel by hand, or keep everybody away from it"
    unlock: Callable[[], None] = getattr(source, "unlock_panel")  # noqa: B009 - not of every source
    stack.callback(unlock)
    return ""


def source_options(config: BenchConfig, speed: float) -> dict[str, Any]:
    """Return the options of the source's driver as plain values, because the watchdog process needs them too."""
    match config.source.kind:
        case "card-output":
            return {
                "device": config.card.device,
                "channel": config.source.output,
                "start_trigger": config.source.start_trigger,
                "margin_s": DRIVE_MARGIN_S * speed,
                "lease_s": max(HOLD_LEASE_S, FAST_LEASE_S * speed),
            }
        case "labjack-output":
            return {
                "device": config.source.device,
                "channel": config.source.output,
                "checks_power_up": config.source.external_power,
            }
        case "dc-supply":
            return {
                "channel": config.supply.channel,
                "current_limit_a": config.supply.current_limit_a,
                "fall_time_s": config.supply.fall_time_s,
                "step_v": config.amplifier.step_v,
            }
        case "generator":
            return {"step_v": config.amplifier.step_v}


def _clock_speed(clock: Clock) -> float:
    return float(getattr(clock, "speed", 1.0))


OPTONCDT_BAUD = 921_600
"""Factory setting."""

SIMULATED_PORT = "simulated"

ReadDisplacement = Callable[[], float | None]


def open_meters(
    tables: dict[str, MeterTable], clock: Clock, stack: ExitStack, read_displacement: ReadDisplacement | None
) -> dict[str, Meter]:
    """Open the meters, by name; `stack` closes them. `read_displacement` is None on a real bench.

    Raises:
        InstrumentError: a port does not exist, or another instrument answers on it.
    """
    return {name: _open_meter(name, table, clock, stack, read_displacement) for name, table in tables.items()}


def _open_meter(
    name: str, table: MeterTable, clock: Clock, stack: ExitStack, read_displacement: ReadDisplacement | None
) -> Meter:
    announcer.get()(InstrumentAwaited(name))
    from drivers import BLOCK_DIALECTS, TEXT_DIALECTS, BlockMeter, OptoNcdt, SerialPort, TextMeter

    ports = table.port, table.command_port
    if read_displacement is not None:
        ports = _start_simulated_sensor(table, stack, read_displacement)
    text, block = TEXT_DIALECTS.get(table.driver), BLOCK_DIALECTS.get(table.driver)
    baud = table.baud or (text.baud if text else OPTONCDT_BAUD)
    line = SerialPort(ports[0], baud, table.timeout_s)
    stack.callback(line.close)
    if text is not None:
        return TextMeter(line, clock, text, output=table.output)
    if block is not None:
        commands = SerialPort(ports[1], baud, table.timeout_s)
        stack.callback(commands.close)
        return BlockMeter(line, commands, clock, block, range_m=table.range_m, channel=table.output)
    return OptoNcdt(line, clock, range_m=table.range_m)


def open_environment_sensor(
    table: EnvironmentTable, stack: ExitStack, simulated: "BenchControls | None"
) -> "EnvironmentSensor | None":
    """Open the sensor of temperature and humidity; `stack` closes it. None if the bench has none.

    `simulated` are the controls of a simulated bench; None on a real one.

    Raises:
        InstrumentError: the port does not exist, or is simulated on a real bench.
        BenchError: the driver is a broken plug-in.
    """
    if not table.port:
        return None
    from drivers import InstrumentError, SerialPort

    announcer.get()(InstrumentAwaited("sensor of the air"))
    port = table.port
    if port == SIMULATED_PORT:
        if simulated is None:
            raise InstrumentError("environment.port is 'simulated' on a real bench; give the name of the sensor's port")
        from sim_hardware.sensors import SimulatedEspec, SimulatedHmt330
        from sim_hardware.wires import PtyServer

        twin = SimulatedEspec if table.driver == "espec" else SimulatedHmt330
        port = stack.enter_context(PtyServer(twin(simulated.room_reading, simulated.perform_action))).port
    line = SerialPort(port, table.baud, table.timeout_s)
    stack.callback(line.close)
    sensor: EnvironmentSensor = load_driver(ENVIRONMENT_SENSORS, table.driver)(line, table.request)
    return sensor


def _start_simulated_sensor(
    table: MeterTable, stack: ExitStack, read_displacement: ReadDisplacement
) -> tuple[str, str]:
    """Return the addresses of the data and of the command port of a simulated sensor."""
    from sim_hardware.sensors import SimulatedMicroEpsilon, SimulatedOptoNcdt, simulated_keyence
    from sim_hardware.wires import PtyServer, TcpStreamServer

    match table.driver:
        case "optoncdt-2300" | "capancdt-6200":
            sensor = SimulatedMicroEpsilon(read_displacement, table.range_m, table.driver, channels=(table.output,))
            data, commands = (stack.enter_context(TcpStreamServer(each)) for each in (sensor, sensor.commands))
            return data.port, commands.port
        case "optoncdt":
            return stack.enter_context(PtyServer(SimulatedOptoNcdt(read_displacement, table.range_m))).port, ""
    return stack.enter_context(PtyServer(simulated_keyence(table.driver, read_displacement))).port, ""


def open_interlock(config: BenchConfig, server: str) -> Interlock:
    """Open the interlock's lines on the card; the bench closes them.

    Raises:
        InstrumentError: the card is absent.
    """
    table = config.interlock
    if not table.line:
        return Interlock()
    from drivers import NiDigitalLines

    lines = NiDigitalLines(config.card.device, table.line, table.state_line, server=server or None)
    return Interlock(lines, table.monostable_s)


def open_digitizer(config: BenchConfig, clock: Clock, server: str, stack: ExitStack) -> Digitizer:
    """Open the card's input; `stack` closes it.

    Raises:
        AcquisitionError: the card is absent, or a setting is not admitted.
    """
    announcer.get()(InstrumentAwaited("card"))
    card = config.card
    digitizer: Digitizer = load_driver(DIGITIZERS, card.driver)(
        card.device,
        (card.drive_channel, card.displacement_channel, *(each.channel for each in config.channels)),
        clock,
        server=server or None,
        range_v=card.range_v,
        terminal=card.terminal,
    )
    stack.callback(digitizer.close)
    return digitizer
