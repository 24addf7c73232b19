"""NI gRPC device service over the simulated card, for the unmodified `nidaqmx` package.

Only the calls of analogue input and output tasks are served; gRPC itself answers any other with UNIMPLEMENTED. The ~150
property getters of the service share one function that looks the property's number up in a table. Errors travel as from
NI's own server: status metadata `ni-error` (NI gRPC Device Server 2.0 release notes).
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from concurrent import futures
from typing import Any

import grpc
import numpy as np
from nidaqmx._stubs import nidaqmx_pb2

from drivers import Closeable
from sim_hardware.nidaq import properties
from sim_hardware.nidaq.card import Counts
from sim_hardware.nidaq.errors import ERROR_MESSAGES, NiError
from sim_hardware.nidaq.input_task import NiInputTask
from sim_hardware.nidaq.output_task import NiOutputTask
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.wires import HOST

_BY_CHANNEL = 0
_INITIALIZE_NEW, _ATTACH_TO_EXISTING = 1, 2
_SERVICE = nidaqmx_pb2.DESCRIPTOR.services_by_name["NiDAQmx"]
_UNLIMITED = [("grpc.max_receive_message_length", -1), ("grpc.max_send_message_length", -1), ("grpc.so_reuseport", 0)]

Call = Callable[[Any], Mapping[str, Any] | None]
"""Handles a request; returns the fields of the reply, None for an empty reply."""


class SessionError(Exception):
    """Failed creation of a session or attachment to one: a status of gRPC, not an error of NI-DAQmx."""

    def __init__(self, code: grpc.StatusCode, text: str) -> None:
        super().__init__(text)
        self.code = code


class NiGrpcServer(Closeable):
    """Serves one card on loopback until closed.

    Attributes:
        port: the TCP port.
        calls: number of calls by name.
    """

    def __init__(self, device: SimulatedNiDevice) -> None:
        self.device = device
        self.port = 0
        self.calls: dict[str, int] = {}
        self._tasks = properties.NiTaskTable(device)
        self._task_numbers = itertools.count(1)
        self._server: Any = None
        self._closed = False
        self.update_from_faults()

    @property
    def address(self) -> str:
        """host:port for a gRPC channel."""
        return f"{HOST}:{self.port}"

    def update_from_faults(self) -> None:
        """Stop or start according to the fault `grpc-gone`."""
        gone = self.device.faults.is_active("grpc-gone")
        if gone and self._server is not None:
            self._stop()
        elif not gone and self._server is None and not self._closed:
            self._start()

    def close(self) -> None:
        """End all calls and wait for the threads."""
        self._closed = True
        if self._server is not None:
            self._stop()

    def _start(self) -> None:
        self.device.server_stopping.clear()
        handlers = {name: self._handler(name, call) for name, call in self._calls().items()}
        self._pool = futures.ThreadPoolExecutor(8, thread_name_prefix="simulated card")
        server = grpc.server(self._pool, options=_UNLIMITED)
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(_SERVICE.full_name, handlers),))
        self.port = server.add_insecure_port(self.address)
        server.start()
        self._server = server

    def _stop(self) -> None:
        self.device.server_stopping.set()
        self._tasks.stop_all()
        self._server.stop(0).wait()
        self._pool.shutdown()
        self._server = None

    def _handler(self, name: str, call: Call) -> Any:
        method = _SERVICE.methods_by_name[name]
        ask = getattr(nidaqmx_pb2, method.input_type.name)
        answer = getattr(nidaqmx_pb2, method.output_type.name)

        def serve(request: Any, context: Any) -> Any:
            self.calls[name] = self.calls.get(name, 0) + 1
            try:
                return answer(**(call(request) or {}))
            except NiError as error:
                read = () if error.samples_read is None else (("ni-samps-per-chan-read", str(error.samples_read)),)
                context.set_trailing_metadata((("ni-error", str(error.code)), *read))
                context.abort(grpc.StatusCode.UNKNOWN, str(error))
            except SessionError as error:
                context.abort(error.code, str(error))

        return grpc.unary_unary_rpc_method_handler(serve, ask.FromString, answer.SerializeToString)

    def _calls(self) -> dict[str, Call]:
        """The served calls."""
        table: dict[str, Call] = {
            "CreateTask": self._create,
            "ClearTask": lambda q: self._tasks.clear(q.task.name),
            "StartTask": lambda q: self._task(q).start(),
            "StopTask": lambda q: self._task(q).stop(),
            "TaskControl": self._control,
            "IsTaskDone": lambda q: {"is_task_done": self._task(q).is_done()},
            "WaitUntilTaskDone": self._wait_done,
            "CreateAIVoltageChan": lambda q: self._input(q).add_voltage_channels(
                q.physical_channel, q.name_to_assign_to_channel, q.min_val, q.max_val
            ),
            "CreateAOVoltageChan": lambda q: self._tasks.add_output(
                q.task.name, q.physical_channel, q.name_to_assign_to_channel, q.min_val, q.max_val
            ),
            "CreateDOChan": lambda q: self._tasks.add_line(q.task.name, q.lines, output=True),
            "CreateDIChan": lambda q: self._tasks.add_line(q.task.name, q.lines, output=False),
            "WriteDigitalLines": self._write_line,
            "ReadDigitalLines": lambda q: {
                "read_array": bytes([self._tasks.line(q.task.name).read()]),
                "samps_per_chan_read": 1,
                "num_bytes_per_samp": 1,
            },
            "CfgDigEdgeStartTrig": lambda q: self._output(q).configure_trigger(q.trigger_source),
            "WriteAnalogF64": lambda q: {
                "samps_per_chan_written": self._output(q).write(
                    np.array(q.write_array, np.float64), q.auto_start, q.timeout
                )
            },
            "WriteAnalogScalarF64": self._write_scalar,
            "ResetDevice": lambda _: self.device.reset(),
            "SetWriteAttributeInt32": lambda q: self._output(q).set_property(q.attribute_raw, q.value_raw or q.value),
            "SetChanAttributeUInt32": lambda q: self._output(q).set_property(q.attribute_raw, q.value),
            "CfgSampClkTiming": lambda q: self._task(q).configure_clock(
                q.rate, q.sample_mode_raw or q.sample_mode, q.samps_per_chan
            ),
            "CfgInputBuffer": lambda q: self._task(q).set_buffer(q.num_samps_per_chan),
            "ReadBinaryI16": lambda q: self._read(q, np.asarray),
            "ReadAnalogF64": lambda q: self._read(q, self.device.card.scale.to_volts),
            "ReadAnalogScalarF64": self._read_scalar,
            "GetErrorString": lambda q: {"error_string": ERROR_MESSAGES.get(q.error_code, "")},
            "SetBufferAttributeUInt32": self._set_buffer,
        }
        return table | dict(self._property_calls())

    def _property_calls(self) -> Iterator[tuple[str, Call]]:
        """Yield the calls that get a property, by name."""
        for name, method in _SERVICE.methods_by_name.items():
            if name.startswith("Get") and "Attribute" in name:
                value = "value_raw" if "value_raw" in method.output_type.fields_by_name else "value"
                yield name, lambda q, value=value: {value: self._attribute(q)}  # type: ignore[misc]

    def _task(self, request: Any) -> properties.NiAnyTask:
        return self._tasks[request.task.name]

    def _input(self, request: Any) -> NiInputTask:
        return self._tasks.input(request.task.name)

    def _output(self, request: Any) -> NiOutputTask:
        return self._tasks.output(request.task.name)

    def _create(self, request: Any) -> Mapping[str, Any]:
        """Create a session or attach to one, by name. It remains, with its reservations, until it is cleared."""
        name = request.session_name or f"_unnamedTask<{next(self._task_numbers)}>"
        exists = name in self._tasks
        if exists and request.initialization_behavior == _INITIALIZE_NEW:
            raise SessionError(
                grpc.StatusCode.ALREADY_EXISTS, f"Cannot initialize '{name}' when the session already exists."
            )
        if not exists and request.initialization_behavior == _ATTACH_TO_EXISTING:
            raise SessionError(
                grpc.StatusCode.FAILED_PRECONDITION,
                f"Cannot attach to '{name}' because a session has not been initialized.",
            )
        if not exists:
            self._tasks.create(name, name)
        return {"task": {"name": name}, "new_session_initialized": not exists}

    def _control(self, request: Any) -> None:
        task, action = self._task(request), request.action_raw or request.action
        match action:
            case 0:  # start
                task.start()
            case 1 | 6:  # stop, abort
                task.stop()
            case 2 | 3 | 4 if task.rate_hz is not None:  # verify, commit, reserve
                task.actual_rate()

    def _wait_done(self, request: Any) -> None:
        task = self._task(request)
        if not task.wait_until_done(request.time_to_wait):
            raise NiError(-200560, f"Task Name: {task.name}")

    def _read(self, request: Any, convert: Callable[[Counts], np.ndarray]) -> Mapping[str, Any]:
        raw, status = self._input(request).read(request.num_samps_per_chan, request.timeout)
        values = convert(raw) if request.fill_mode_raw == _BY_CHANNEL else convert(raw).T
        return {"status": status, "read_array": values.ravel().tolist(), "samps_per_chan_read": raw.shape[1]}

    def _read_scalar(self, request: Any) -> Mapping[str, Any]:
        raw, status = self._input(request).read(1, request.timeout)
        return {"status": status, "value": float(self.device.card.scale.to_volts(raw)[0, 0]) if raw.size else 0.0}

    def _set_buffer(self, request: Any) -> None:
        if request.attribute_raw not in (0x186C, 0x186D):  # input, output
            raise NiError(-200452)
        self._task(request).set_buffer(request.value)

    def _write_line(self, request: Any) -> Mapping[str, Any]:
        self._tasks.line(request.task.name).write(bool(request.write_array[0]))
        return {"samps_per_chan_written": 1}

    def _write_scalar(self, request: Any) -> None:
        self._output(request).write(np.array([request.value]), request.auto_start)

    def _attribute(self, request: Any) -> Any:
        number = request.attribute_raw or request.attribute
        fields = request.DESCRIPTOR.fields_by_name
        if "task" in fields:
            return properties.task_property(self._task(request), number, getattr(request, "channel", ""))
        if "device_name" in fields:
            return properties.device_property(self.device, request.device_name, number)
        if "physical_channel" in fields:
            return properties.physical_channel_property(self.device, request.physical_channel, number)
        return properties.read_property(properties.SYSTEM_PROPERTIES, number, self.device)
