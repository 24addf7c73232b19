"""NI-DAQmx properties of devices and tasks by NI's numbers (nidaqmx source), and the table of a client's tasks."""

from collections.abc import Callable, Hashable, Mapping
from typing import Any

from sim_hardware.nidaq.card import convert_interval_s
from sim_hardware.nidaq.digital_task import NiDigitalTask
from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.input_task import NiInputTask
from sim_hardware.nidaq.output_queue import FIFO_SAMPLES, ONBOARD_BUFFER, REQUEST_COUNT, REQUEST_SIZE
from sim_hardware.nidaq.output_task import NiOutputTask
from sim_hardware.nidaq.task import FINITE, SimulatedNiDevice, TaskChannel

NiAnyTask = NiInputTask | NiOutputTask | NiDigitalTask

Properties = Mapping[int, Callable[[Any], Any]]
"""Functions that return a property of a device, a task or a channel, by the property's number."""

SYSTEM_PROPERTIES: Properties = {
    0x1272: lambda _: 25,  # version of the driver: major,
    0x1923: lambda _: 5,  # minor
    0x2F22: lambda _: 0,  # and update
    0x193B: lambda device: device.name,  # devices
    0x1267: lambda _: "",  # saved tasks
    0x1268: lambda _: "",  # saved channels
}


def _serial_number(device: SimulatedNiDevice) -> int:
    device.check_present()
    return device.card.parameters.serial


def _terminals(device: SimulatedNiDevice) -> str:
    names = ("PFI0", "PFI1", "ai/SampleClock", "ai/ConvertClock", "ai/StartTrigger", "100MHzTimebase")
    return ", ".join(f"/{device.name}/{name}" for name in names)


DEVICE_PROPERTIES: Properties = {
    0x631: lambda device: device.card.parameters.product,
    0x632: _serial_number,
    0x22CA: lambda _: True,  # simulated
    0x231E: lambda device: ", ".join(f"{device.name}/ai{i}" for i in range(device.card.parameters.channels)),
    0x231F: lambda device: ", ".join(f"{device.name}/ao{i}" for i in range(device.card.parameters.ao_channels)),
    0x2996: lambda device: device.card.parameters.ao_clocked,
    0x2997: lambda device: device.card.parameters.ao_max_rate_hz,
    0x2A40: _terminals,
    **dict.fromkeys((0x2320, 0x2321, 0x2322, 0x2323, 0x2324), lambda _: ""),  # digital lines and counters: none
    **dict.fromkeys((0x298C, 0x298D), lambda device: device.card.parameters.max_rate_hz),  # one channel, all channels
    0x298F: lambda device: device.card.parameters.convert_s == 0,  # simultaneous sampling
    0x2990: lambda device: [-device.card.parameters.range_v, device.card.parameters.range_v],
    0x2326: lambda _: 12586,  # bus: USB
    0x29A9: lambda _: 15858,  # category: X series
}

PHYSICAL_CHANNEL_PROPERTIES: Properties = {
    0x2342: lambda _: [10083, 10078, 10106]  # terminal configurations: RSE, NRSE, differential
}

TASK_PROPERTIES: Properties = {
    0x1276: lambda task: task.name,
    0x1273: lambda task: ", ".join(channel.name for channel in task.channels),
    0x230E: lambda task: task.device.name,
    0x2181: lambda task: len(task.channels),
    0x1344: lambda task: task.actual_rate(),
    0x22C8: lambda task: task.max_rate(),
    0x1300: lambda task: task.mode,
    0x1310: lambda task: task.samples_per_channel,
}


def _readable_scans(task: NiInputTask) -> int:
    """Return the number of scans of a read of "all available"."""
    if task.rate_hz is None:
        return 1
    return task.samples_per_channel if task.mode == FINITE else task.available()


INPUT_TASK_PROPERTIES: Properties = {
    0x1823: TASK_PROPERTIES[0x1273],  # channels to read
    0x217B: TASK_PROPERTIES[0x2181],
    0x1848: lambda task: 1 / convert_interval_s(task.device.card.parameters, task.actual_rate(), len(task.channels)),
    0x1347: lambda task: 10390 if task.rate_hz is None else 10388,  # timing: on demand, or sample clock
    0x186C: lambda task: task.buffer_size(),
    0x230A: lambda _: 4095,  # the card's own buffer
    0x1223: lambda task: task.available(),
    0x192A: lambda task: task.acquired(),
    0x1808: lambda task: task.read_position,
    0x1221: lambda task: task.read_position,
    0x31E8: _readable_scans,
    0x1215: lambda _: False,  # read all available
}

OUTPUT_TASK_PROPERTIES: Properties = {
    0x217E: TASK_PROPERTIES[0x2181],
    0x187F: lambda _: 10102,  # kind of channel: AO
    0x192B: lambda task: task.samples_generated(),
    0x190C: lambda task: task.relative_to,  # begin of a write
    0x190D: lambda task: task.offset,
    ONBOARD_BUFFER: lambda _: FIFO_SAMPLES,
    REQUEST_SIZE: lambda task: task.queue.request_bytes,
    REQUEST_COUNT: lambda task: task.queue.requests,
}

INPUT_CHANNEL_PROPERTIES: Mapping[int, Callable[[SimulatedNiDevice, TaskChannel], Any]] = {
    0x187F: lambda _, __: 10100,  # kind of channel: AI
    0x695: lambda _, __: 10322,  # measures: voltage
    0x18F5: lambda device, channel: device.physical_channel_name(channel.number),
    0x1930: lambda device, _: list(device.card.parameters.coefficients),
    0x17DD: lambda _, channel: channel.high_v,
    0x17DE: lambda _, channel: channel.low_v,
    0x1815: lambda device, _: device.card.parameters.range_v,
    0x1816: lambda device, _: -device.card.parameters.range_v,
    0x1765: lambda _, __: 16.0,  # resolution in bits
    0x1097: lambda _, __: 10106,  # terminal configuration: differential
}


def read_property(table: Mapping[int, Callable[..., Any]], number: int, *owner: Any) -> Any:
    """Return a property of `owner`. Raises NiError for one that is not simulated."""
    if number not in table:
        raise NiError(-200452, f"Property: {number:#x}")
    return table[number](*owner)


def device_property(device: SimulatedNiDevice, name: str, number: int) -> Any:
    """Return a property of the card. Raises NiError: another device, not simulated, or unplugged."""
    if name.lower() != device.name.lower():
        raise NiError(-200220, f"Device Specified: {name}")
    return read_property(DEVICE_PROPERTIES, number, device)


def physical_channel_property(device: SimulatedNiDevice, name: str, number: int) -> Any:
    """Return a property of a physical channel. Raises NiError: no such channel, or not simulated."""
    device.parse_physical_channels(name)
    return read_property(PHYSICAL_CHANNEL_PROPERTIES, number, device)


def task_property(task: NiAnyTask, number: int, channel_name: str) -> Any:
    """Return a property of a task, its timing, buffer, reading, or one of its channels. Raises NiError if not simulated."""
    if isinstance(task, NiOutputTask):
        return read_property({**TASK_PROPERTIES, **OUTPUT_TASK_PROPERTIES}, number, task)
    of_task = {**TASK_PROPERTIES, **INPUT_TASK_PROPERTIES} if isinstance(task, NiInputTask) else TASK_PROPERTIES
    if number in of_task:
        return of_task[number](task)
    if not task.channels:
        raise NiError(-200478)
    channel = next((c for c in task.channels if c.name == channel_name), task.channels[0])
    return read_property(INPUT_CHANNEL_PROPERTIES, number, task.device, channel)


class NiTaskTable:
    """The tasks of the gRPC service or of the C library; a task is an input until an output channel is created in it."""

    def __init__(self, device: SimulatedNiDevice) -> None:
        self._device = device
        self._tasks: dict[Hashable, NiAnyTask] = {}

    def create(self, key: Hashable, name: str) -> None:
        self._tasks[key] = NiInputTask(self._device, name)

    def add_output(self, key: Hashable, text: str, name: str, low_v: float, high_v: float) -> None:
        """Turn a task without channels into an output task and add its channel."""
        task = NiOutputTask(self._device, self[key].name)
        task.add_voltage_channels(text, name, low_v, high_v)
        self._tasks[key] = task

    def add_line(self, key: Hashable, text: str, output: bool) -> None:
        """Turn a task without channels into a task of a static digital line."""
        self._tasks[key] = NiDigitalTask(self._device, self[key].name, text, output)

    def __contains__(self, key: Hashable) -> bool:
        return key in self._tasks

    def __getitem__(self, key: Hashable) -> NiAnyTask:
        """Return the task. Raises NiError for an unknown handle."""
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

    def line(self, key: Hashable) -> NiDigitalTask:
        """Return the task. Raises NiError if it is not of a digital line."""
        task = self[key]
        if not isinstance(task, NiDigitalTask):
            raise NiError(-200452)
        return task

    def clear(self, key: Hashable) -> None:
        """Stop and delete a task."""
        self[key].stop()
        del self._tasks[key]

    def stop_all(self) -> None:
        """Stop and delete all tasks; outputs keep their levels."""
        for task in self._tasks.values():
            task.stop()
        self._tasks.clear()
