"""NI-DAQmx C library over the simulated card: the functions that `nidaqmx` calls for a local card.

Each is a real C function pointer (made by ctypes) with NI's signature, so that the unmodified package marshals its
arguments as for NI's own library.
"""

import ctypes
import itertools

# The bare foreign-function type: unlike those that CFUNCTYPE makes, it leaves the argument types to the caller.
from _ctypes import FUNCFLAG_CDECL, CFuncPtr
from collections.abc import Callable
from typing import Any

import numpy as np

from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.properties import (
    SYSTEM_PROPERTIES,
    NiTaskTable,
    device_property,
    physical_channel_property,
    read_property,
    task_property,
)
from sim_hardware.nidaq.task import SimulatedNiDevice

_WIDE = (0x1310, 0x1808, 0x192A, 0x192B)
"""Properties of 64 bits."""

_BUFFER_TOO_SMALL = -200228
_BY_CHANNEL = 0
_TEXT, _TASK, _ANY = ctypes.c_char_p, ctypes.c_void_p, ctypes.c_void_p
_INT, _UINT, _REAL = ctypes.c_int, ctypes.c_uint, ctypes.c_double
_COUNT = ctypes.POINTER(ctypes.c_int)


class _Function(CFuncPtr):
    """A function as a loaded library gives it: no argument types yet."""

    _flags_ = FUNCFLAG_CDECL
    _restype_ = ctypes.c_int


class NiLibrary:
    """Functions by their C names, as attributes; a function that is not simulated is not there."""

    def __init__(self, device: SimulatedNiDevice) -> None:
        self.device = device
        self._tasks = NiTaskTable(device)
        self._handles = itertools.count(1)
        self._last_error = ""
        self._kept: list[Any] = []  # keeps the objects that ctypes only points to
        table: dict[str, tuple[Callable[..., Any], tuple[Any, ...]]] = {
            "CreateTask": (self._create, (_TEXT, ctypes.POINTER(ctypes.c_void_p))),
            "ClearTask": (self._tasks.clear, (_TASK,)),
            "StartTask": (lambda h: self._tasks[h].start(), (_TASK,)),
            "StopTask": (lambda h: self._tasks[h].stop(), (_TASK,)),
            "TaskControl": (lambda _h, _action: None, (_TASK, _INT)),
            "IsTaskDone": (self._is_done, (_TASK, ctypes.POINTER(_UINT))),
            "CreateAIVoltageChan": (self._add_input, (_TASK, _TEXT, _TEXT, _INT, _REAL, _REAL, _INT, _TEXT)),
            "CreateAOVoltageChan": (self._add_output, (_TASK, _TEXT, _TEXT, _REAL, _REAL, _INT, _TEXT)),
            "CreateDOChan": (
                lambda h, text, _name, _grouping: self._tasks.add_line(h, text.decode(), output=True),
                (_TASK, _TEXT, _TEXT, _INT),
            ),
            "CreateDIChan": (
                lambda h, text, _name, _grouping: self._tasks.add_line(h, text.decode(), output=False),
                (_TASK, _TEXT, _TEXT, _INT),
            ),
            "WriteDigitalLines": (self._write_line, (_TASK, _INT, _UINT, _REAL, _INT, _ANY, _COUNT, _ANY)),
            "ReadDigitalLines": (self._read_line, (_TASK, _INT, _REAL, _INT, _ANY, _UINT, _COUNT, _COUNT, _ANY)),
            "CfgSampClkTiming": (
                lambda h, _source, rate, _edge, mode, n: self._tasks[h].configure_clock(rate, mode, n),
                (_TASK, _TEXT, _REAL, _INT, _INT, ctypes.c_ulonglong),
            ),
            "CfgDigEdgeStartTrig": (
                lambda h, source, _edge: self._tasks.output(h).configure_trigger(source.decode()),
                (_TASK, _TEXT, _INT),
            ),
            "ReadBinaryI16": (self._read_i16, (_TASK, _INT, _REAL, _INT, _ANY, _UINT, _COUNT, _ANY)),
            "ReadAnalogF64": (self._read_f64, (_TASK, _INT, _REAL, _INT, _ANY, _UINT, _COUNT, _ANY)),
            "WriteAnalogF64": (self._write_f64, (_TASK, _INT, _UINT, _REAL, _INT, _ANY, _COUNT, _ANY)),
            "WriteAnalogScalarF64": (
                lambda h, auto, _timeout, value, _: self._write_one(h, value, auto),
                (_TASK, _UINT, _REAL, _REAL, _ANY),
            ),
            "GetErrorString": (self._write_error, (_INT, _ANY, _UINT)),
            "GetExtendedErrorInfo": (lambda into, size: self._write_error(0, into, size), (_ANY, _UINT)),
            "SetBufferAttribute": (lambda h, _number, n: self._tasks[h].set_buffer(n), (_TASK, _INT, _UINT)),
            "SetWriteAttribute": (lambda h, k, v: self._tasks.output(h).set_property(k, v), (_TASK, _INT, _INT)),
            "SetChanAttribute": (
                lambda h, _name, k, v: self._tasks.output(h).set_property(k, v),
                (_TASK, _TEXT, _INT, _UINT),
            ),
            "GetChanAttribute": (
                lambda h, name, k, into, size: _give(task_property(self._tasks[h], k, name.decode()), k, into, size),
                (_TASK, _TEXT, _INT, _ANY, _UINT),
            ),
            "GetDeviceAttribute": (
                lambda name, k, into, size: _give(device_property(self.device, name.decode(), k), k, into, size),
                (_TEXT, _INT, _ANY, _UINT),
            ),
            "GetPhysicalChanAttribute": (
                lambda name, k, into, size: _give(
                    physical_channel_property(self.device, name.decode(), k), k, into, size
                ),
                (_TEXT, _INT, _ANY, _UINT),
            ),
            "GetSystemInfoAttribute": (
                lambda k, into, size: _give(read_property(SYSTEM_PROPERTIES, k, self.device), k, into, size),
                (_INT, _ANY, _UINT),
            ),
        }
        for kind in ("Task", "Timing", "Read", "Write", "Buffer"):
            table[f"Get{kind}Attribute"] = (
                lambda h, k, into, size: _give(task_property(self._tasks[h], k, ""), k, into, size),
                (_TASK, _INT, _ANY, _UINT),
            )
        for name, (call, arguments) in table.items():
            setattr(self, f"DAQmx{name}", self._function(name, call, arguments))

    def end_process(self) -> None:
        """Stop all tasks, as NI does when the program ends; outputs keep their level."""
        self._tasks.stop_all()

    def _function(self, _name: str, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        """Return a C function; subclasses that record or delay calls need its name."""

        def run(*values: Any) -> int:
            try:
                return int(call(*values) or 0)
            except NiError as error:
                self._last_error = str(error)
                return error.code

        pointer = ctypes.CFUNCTYPE(ctypes.c_int, *arguments)(run)
        self._kept.append(pointer)
        address = ctypes.cast(pointer, ctypes.c_void_p).value
        return _Function(address)  # type: ignore[arg-type]

    def _create(self, name: bytes, into: Any) -> None:
        handle = next(self._handles)
        self._tasks.create(handle, name.decode() or f"_unnamedTask<{handle}>")
        into[0] = handle

    def _is_done(self, handle: int, into: Any) -> None:
        into[0] = self._tasks[handle].is_done()

    def _add_input(
        self, handle: int, text: bytes, name: bytes, _terminal: int, low: float, high: float, *_: Any
    ) -> None:
        self._tasks.input(handle).add_voltage_channels(text.decode(), (name or b"").decode(), low, high)

    def _add_output(self, handle: int, text: bytes, name: bytes, low: float, high: float, *_: Any) -> None:
        self._tasks.add_output(handle, text.decode(), (name or b"").decode(), low, high)

    def _write_line(
        self, handle: int, _n: int, _auto: int, _s: float, _layout: int, data: int, done: Any, _: Any
    ) -> None:
        self._tasks.line(handle).write(bool(ctypes.string_at(data, 1)[0]))
        done[0] = 1

    def _read_line(
        self, handle: int, _n: int, _s: float, _fill: int, into: int, _size: int, done: Any, width: Any, _: Any
    ) -> None:
        ctypes.memmove(into, bytes([self._tasks.line(handle).read()]), 1)
        done[0] = width[0] = 1

    def _read_i16(
        self, handle: int, count: int, timeout: float, fill: int, into: int, size: int, read: Any, _: Any
    ) -> int:
        raw, status = self._tasks.input(handle).read(count, timeout)
        return _fill(raw, fill, into, size, read, ctypes.c_int16) or status

    def _read_f64(
        self, handle: int, count: int, timeout: float, fill: int, into: int, size: int, read: Any, _: Any
    ) -> int:
        raw, status = self._tasks.input(handle).read(count, timeout)
        return _fill(self.device.card.scale.to_volts(raw), fill, into, size, read, ctypes.c_double) or status

    def _write_f64(
        self, handle: int, count: int, auto: int, timeout: float, _fill: int, data: int, done: Any, _: Any
    ) -> None:
        volts = np.ctypeslib.as_array((ctypes.c_double * count).from_address(data))
        done[0] = self._tasks.output(handle).write(volts, bool(auto), timeout)

    def _write_one(self, handle: int, value: float, auto: int) -> None:
        self._tasks.output(handle).write(np.array([value]), bool(auto))

    def _write_error(self, _code: int, into: int, size: int) -> None:
        _put_text(self._last_error, into, size)


def _fill(values: Any, fill: int, into: int, size: int, read: Any, kind: Any) -> int:
    """Copy the samples to the caller's buffer."""
    flat = np.ascontiguousarray(values if fill == _BY_CHANNEL else values.T).ravel()
    if flat.size > size:
        return _BUFFER_TOO_SMALL
    np.ctypeslib.as_array((kind * size).from_address(into))[: flat.size] = flat
    read[0] = values.shape[1]
    return 0


def _put_text(text: str, into: int, size: int) -> None:
    raw = text.encode()[: size - 1] + b"\0"
    ctypes.memmove(into, raw, len(raw))


def _give(value: Any, number: int, into: int, size: int) -> int:
    """Write a property to the caller's buffer; return the required size if the buffer is empty, as NI does."""
    match value:
        case str():
            if not size:
                return len(value.encode()) + 1
            _put_text(value, into, size)
        case list():
            if not size:
                return len(value)
            ctypes.memmove(into, (ctypes.c_double * len(value))(*value), 8 * len(value))
        case float():
            ctypes.c_double.from_address(into).value = value
        case _ if number in _WIDE:
            ctypes.c_uint64.from_address(into).value = value
        case _:
            ctypes.c_int32.from_address(into).value = int(value)
    return 0
