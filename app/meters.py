"""Opens the serial sensors of a bench file; on a simulated bench, first the simulated sensor and its port."""

from collections.abc import Callable
from contextlib import ExitStack

from app.config_source import MeterTable
from drivers.clock import Clock
from drivers.ports import Meter

BAUD = {"keyence-lkg": 9600, "optoncdt": 921_600}
"""Factory settings."""

See = Callable[[], float | None]


def open_meters(tables: dict[str, MeterTable], clock: Clock, stack: ExitStack, see: See | None) -> dict[str, Meter]:
    """The meters by name; they are let go with `stack`. `see` is what a simulated sensor sees, None on a real bench.

    Raises:
        InstrumentError: a port is not there, or something else answers on it.
    """
    return {name: _open(table, clock, stack, see) for name, table in tables.items()}


def _open(table: MeterTable, clock: Clock, stack: ExitStack, see: See | None) -> Meter:
    from drivers.keyence_lkg import KeyenceLkg
    from drivers.optoncdt import OptoNcdt
    from drivers.serial_line import SerialLine

    port = table.port if see is None else _simulated(table, stack, see)
    line = SerialLine(port, table.baud or BAUD[table.driver], table.timeout_s)
    stack.callback(line.close)
    match table.driver:
        case "keyence-lkg":
            return KeyenceLkg(line, clock, output=table.output)
        case "optoncdt":
            return OptoNcdt(line, clock, range_m=table.range_m)


def _simulated(table: MeterTable, stack: ExitStack, see: See) -> str:
    from sim_hardware.laser_meters import Ild1420, LkG
    from sim_hardware.serial_wire import PtyPort

    model = LkG(see) if table.driver == "keyence-lkg" else Ild1420(see, table.range_m)
    return stack.enter_context(PtyPort(model)).port
