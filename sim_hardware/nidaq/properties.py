"""NI-DAQmx properties of devices and tasks by NI's numbers (nidaqmx source), and the table of a client's tasks."""

from collections.abc import Hashable
from typing import Any

from sim_hardware.nidaq.card import convert_interval_s
from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.input_task import NiInputTask
from sim_hardware.nidaq.output_task import NiOutputTask
from sim_hardware.nidaq.task import FINITE, NiTask, SimulatedNiDevice

DRIVER_VERSION = {0x1272: 25, 0x1923: 5, 0x2F22: 0}
"""Major, minor and update version of the driver."""

_NOT_SIMULATED = (0x2320, 0x2321, 0x2322, 0x2323, 0x2324)
"""Digital lines and counters of a device: not simulated."""


def system_property(device: SimulatedNiDevice, number: int) -> Any:
    """A property of the driver or its device list. Raises NiError for one that is not simulated."""
    match number:
        case 0x1272 | 0x1923 | 0x2F22:
            return DRIVER_VERSION[number]
        case 0x193B:  # devices
            return device.name
        case 0x1267 | 0x1268:  # saved tasks and channels
            return ""
    raise NiError(-200452, f"Property: {number:#x}")


def device_property(device: SimulatedNiDevice, name: str, number: int) -> Any:
    """A property of the card. Raises NiError: another device, not simulated, or unplugged."""
    parameters = device.card.parameters
    if name.lower() != device.name.lower():
        raise NiError(-200220, f"Device Specified: {name}")
    match number:
        case 0x631:  # product type
            return parameters.product
        case 0x632:  # serial number
            device.check_present()
            return parameters.serial
        case 0x22CA:  # simulated
            return True
        case 0x231E:  # physical AI channels
            return ", ".join(f"{device.name}/ai{i}" for i in range(parameters.channels))
        case 0x231F:  # physical AO channels
            return ", ".join(f"{device.name}/ao{i}" for i in range(len(device.card.outputs)))
        case 0x2A40:  # terminals
            names = ("PFI0", "PFI1", "ai/SampleClock", "ai/ConvertClock", "ai/StartTrigger", "100MHzTimebase")
            return ", ".join(f"/{device.name}/{t}" for t in names)
        case _ if number in _NOT_SIMULATED:
            return ""
        case 0x298C | 0x298D:  # largest AI rate, one channel and all together
            return parameters.max_rate_hz
        case 0x298F:  # simultaneous sampling
            return parameters.convert_s == 0
        case 0x2990:  # voltage ranges
            return [-parameters.range_v, parameters.range_v]
        case 0x2326:  # bus: USB
            return 12588
        case 0x29A9:  # category: X series
            return 15858
    raise NiError(-200452, f"Property: {number:#x}")


def physical_channel_property(device: SimulatedNiDevice, name: str, number: int) -> Any:
    """A property of a physical channel. Raises NiError: no such channel, or not simulated."""
    device.parse_physical_channels(name)
    if number == 0x2342:  # terminal configurations: RSE, NRSE, differential
        return [10083, 10078, 10106]
    raise NiError(-200452, f"Property: {number:#x}")


def task_property(task: NiTask, number: int, channel: str) -> Any:
    """Return a property of a task, its timing, buffer, reading, or one of its channels. Raises NiError if not simulated."""
    match number:
        case 0x1276:  # name
            return task.name
        case 0x1273:  # channels in the task
            return ", ".join(c.name for c in task.channels)
        case 0x230E:  # devices
            return task.device.name
        case 0x2181:  # number of channels
            return len(task.channels)
        case 0x1344:  # sample rate
            return task.actual_rate()
        case 0x22C8:  # largest sample rate
            return task.max_rate()
        case 0x1300:  # mode
            return task.mode
        case 0x1310:  # samples per channel
            return task.samples_per_channel
    if isinstance(task, NiOutputTask):
        return _output_task_property(task, number)
    assert isinstance(task, NiInputTask)
    return _input_task_property(task, number, channel)


def _input_task_property(task: NiInputTask, number: int, channel: str) -> Any:
    match number:
        case 0x1823:  # channels to read
            return ", ".join(c.name for c in task.channels)
        case 0x217B:  # number of channels
            return len(task.channels)
        case 0x1848:  # conversions a second
            return 1 / convert_interval_s(task.device.card.parameters, task.actual_rate(), len(task.channels))
        case 0x1347:  # timing: on demand, or sample clock
            return 10390 if task.rate_hz is None else 10388
        case 0x186C:  # buffer
            return task.buffer_size()
        case 0x230A:  # the card's own buffer
            return 4095
        case 0x1223:  # available
            return task.available()
        case 0x192A:  # acquired
            return task.acquired()
        case 0x1808:  # read position
            return task.read_position
        case 0x31E8:  # samples a read of "all available" takes
            return 1 if task.rate_hz is None else task.samples_per_channel if task.mode == FINITE else task.available()
        case 0x1215:  # read all available
            return False
    return _channel_property(task, number, channel)


def _channel_property(task: NiInputTask, number: int, name: str) -> Any:
    if not task.channels:
        raise NiError(-200478)
    channel = next((c for c in task.channels if c.name == name), task.channels[0])
    parameters = task.device.card.parameters
    match number:
        case 0x187F:  # kind of channel: AI
            return 10100
        case 0x695:  # measures: voltage
            return 10322
        case 0x18F5:  # physical channel
            return task.device.physical_channel_name(channel.number)
        case 0x1930:  # scaling coefficients
            return list(parameters.coefficients)
        case 0x17DD:  # max
            return channel.high_v
        case 0x17DE:  # min
            return channel.low_v
        case 0x1815:  # range, high
            return parameters.range_v
        case 0x1816:  # range, low
            return -parameters.range_v
        case 0x1765:  # resolution in bits
            return 16.0
        case 0x1097:  # terminal configuration: differential
            return 10106
    raise NiError(-200452, f"Property: {number:#x}")


def _output_task_property(task: NiOutputTask, number: int) -> Any:
    match number:
        case 0x217E:  # number of channels
            return len(task.channels)
        case 0x187F:  # kind of channel: AO
            return 10102
        case 0x192B:  # samples generated
            return task.samples_generated()
        case 0x190C:  # where a write begins
            return task.relative_to
        case 0x190D:
            return task.offset
    raise NiError(-200452, f"Property: {number:#x}")


class NiTaskTable:
    """The tasks of the gRPC service or of the C library; a task is an input until an output channel is created in it."""

    def __init__(self, device: SimulatedNiDevice) -> None:
        self._device = device
        self._tasks: dict[Hashable, NiTask] = {}

    def create(self, key: Hashable, name: str) -> None:
        self._tasks[key] = NiInputTask(self._device, name)

    def add_output(self, key: Hashable, text: str, name: str, low_v: float, high_v: float) -> None:
        """Turn a task without channels into an output task and add its channel."""
        task = NiOutputTask(self._device, self[key].name)
        task.add_voltage_channels(text, name, low_v, high_v)
        self._tasks[key] = task

    def __getitem__(self, key: Hashable) -> NiTask:
        """Return the task. Raises NiError if there is none."""
        if key not in self._tasks:
            raise NiError(-200088)
        return self._tasks[key]

    def input(self, key: Hashable) -> NiInputTask:
        """Return the task. Raises NiError if it is not an input task."""
        task = self[key]
        if not isinstance(task, NiInputTask):
            raise NiError(-200452)
        return task

    def output(self, key: Hashable) -> NiOutputTask:
        """Return the task. Raises NiError if it is not an output task."""
        task = self[key]
        if not isinstance(task, NiOutputTask):
            raise NiError(-200452)
        return task

    def clear(self, key: Hashable) -> None:
        """Stop and delete a task."""
        self[key].stop()
        del self._tasks[key]

    def stop_all(self) -> None:
        """Stop and delete all tasks; outputs stay where they are."""
        for task in self._tasks.values():
            task.stop()
        self._tasks.clear()
