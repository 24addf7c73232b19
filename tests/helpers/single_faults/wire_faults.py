"""Wire faults: counts the messages on the wires of a simulated bench in this process, and lets one of them fail."""

import contextlib
import time
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any
from unittest import mock

if TYPE_CHECKING:
    from tests.helpers.single_faults.points import Operation, Point

GARBAGE = "".join(chr(160 + 17 * k % 95) for k in range(12))


@contextlib.contextmanager
def tap(operation: "Operation", point: "Point", facts: dict[str, Any]) -> Iterator[None]:
    """Let the point's message fail; note the messages where the point has none."""
    with contextlib.ExitStack() as stack:
        counter = Counter(point, facts)
        if operation.boundary == "SCPI":
            stack.enter_context(scpi_faults(counter))
        if operation.card:
            stack.enter_context(_card(counter, stack))
        yield


class Counter:
    """Says at which message the fault is."""

    def __init__(self, point: "Point", facts: dict[str, Any]) -> None:
        self.kind, self._number, self._facts, self._count = point.kind, point.number, facts, 0
        if point.number < 0:
            facts["calls"] = []

    def is_due(self, call: str) -> bool:
        number, self._count = self._count, self._count + 1
        if self._number < 0:
            self._facts["calls"].append(call)
        if number == self._number:
            self._facts["call"] = call
        return number == self._number or (self.kind == "stop" and 0 <= self._number < number)


@contextlib.contextmanager
def scpi_faults(counter: Any) -> Iterator[None]:
    """Let messages to the source fail: those for which the counter says so, in the way of its `kind`."""
    from dataclasses import replace

    from drivers import LinkError
    from sim_hardware.wires.in_process_link import InProcessLink
    from sim_hardware.wires.port import LATE_RESPONSE_S, MessagePort

    handle, write = MessagePort.handle, InProcessLink.write

    def written(link: Any, message: str) -> None:
        link.due = counter.is_due(message.split(" ")[0][:24])
        if link.due and counter.kind == "error":
            link._open = False
            raise LinkError(f"{link.name}: the connection was closed")
        if link.due and counter.kind == "no memory":
            raise MemoryError
        link._port.due = link.due
        write(link, message)

    def handled(port: Any, message: str) -> Any:
        due, port.due = getattr(port, "due", False), False
        if not due:
            return handle(port, message)
        asks = "?" in message
        if (
            counter.kind == "stop"
            or (counter.kind == "silence" and counter._count % 2)
            or (counter.kind == "end" and not asks)
        ):
            return None
        if counter.kind == "garbage" and not asks:
            return handle(port, GARBAGE)
        reply = handle(port, message)
        if reply is None or counter.kind == "silence":
            return None
        match counter.kind:
            case "end":
                return replace(reply, text=reply.text[: len(reply.text) // 2], terminated=False)
            case "delay":
                return replace(reply, late_s=LATE_RESPONSE_S)
            case "garbage":
                return replace(reply, text=GARBAGE)
        return reply

    with mock.patch.object(MessagePort, "handle", handled), mock.patch.object(InProcessLink, "write", written):
        yield


@contextlib.contextmanager
def _card(counter: Counter, stack: contextlib.ExitStack) -> Iterator[None]:
    import grpc

    from drivers import NiDigitizer
    from sim_hardware.bench import SimulatedBench
    from sim_hardware.nidaq.errors import NiError
    from sim_hardware.nidaq.grpc_server import NiGrpcServer
    from sim_hardware.service.served_bench import ServedBench

    handler = NiGrpcServer._handler

    def digitizer(bench: Any, buffer_s: float = 10.0, terminals: Any = ("ai0", "ai1")) -> Any:
        served = stack.enter_context(ServedBench(bench))
        return NiDigitizer("Dev1", tuple(terminals), bench.clock, server=served.card.address)

    def faulty(server: Any, name: str, call: Any) -> Any:
        def called(request: Any) -> Any:
            if not counter.is_due(name):
                return call(request)
            match counter.kind:
                case "error":
                    raise NiError(-50808)
                case "silence" | "stop":
                    server.device.server_stopping.wait(60.0)
                case "delay":
                    time.sleep(0.2)
            fields = call(request)
            return _other_numbers(fields) if counter.kind == "garbage" else fields

        served = handler(server, name, called)
        ends = {"end": grpc.StatusCode.UNAVAILABLE, "no memory": grpc.StatusCode.RESOURCE_EXHAUSTED}

        def serve(request: Any, context: Any) -> Any:
            if counter.kind in ends and counter.is_due(name):
                context.abort(ends[counter.kind], "the server ended the call")
            return served.unary_unary(request, context)

        return grpc.unary_unary_rpc_method_handler(serve, served.request_deserializer, served.response_serializer)

    with mock.patch.object(SimulatedBench, "digitizer", digitizer), mock.patch.object(NiGrpcServer, "_handler", faulty):
        yield


def _other_numbers(fields: Any) -> Any:
    """Return the fields of a reply with other numbers."""

    def other(value: Any) -> Any:
        match value:
            case bool() | str():
                return value
            case int():
                return value ^ 0x155
            case float():
                return -3 * value - 1e3
            case list():
                return [other(each) for each in value]
        return value

    return {name: other(value) for name, value in (fields or {}).items()}
