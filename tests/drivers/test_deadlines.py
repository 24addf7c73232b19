"""Deadlines: a call that does not return is given up, its thread is counted, and what follows does not wait for it."""

import threading
from collections import namedtuple
from collections.abc import Iterator
from types import SimpleNamespace

import grpc
import pytest

from drivers.deadlines import CallThread, Deadline, OverdueError, in_progress, overdue, threads_left_behind
from drivers.errors import LinkError
from drivers.nidaq.grpc_channel import REPLY_MARGIN_S, DeadlineInterceptor
from drivers.transport.serial_port import SerialPort
from drivers.transport.visa import VisaLink

pytestmark = pytest.mark.one_in(1)


@pytest.fixture
def answer() -> Iterator[threading.Event]:
    """Until it is set, what waits for it hangs; afterwards no thread is left."""
    event = threading.Event()
    yield event
    event.set()
    for thread in threading.enumerate():
        if isinstance(thread, CallThread):
            thread.join()


def test_a_call_returns_or_raises_what_its_action_does() -> None:
    calls = CallThread("here")
    assert calls.call(threading.get_ident, 30.0) == calls.ident
    with pytest.raises(ZeroDivisionError):
        calls.call(lambda: 1 // 0, 30.0)
    assert threads_left_behind() == []
    calls.end()
    calls.join()
    assert calls.call(threading.get_ident, 30.0) == threading.get_ident(), "made by the caller"


def test_a_call_that_does_not_return_is_given_up_with_all_that_follow(answer: threading.Event) -> None:
    calls, seen = CallThread("the disk"), []
    with pytest.raises(OverdueError):
        calls.call(answer.wait, 0.05, lambda: seen.append("meanwhile"), 0.01)
    assert seen
    assert threads_left_behind() == [calls.name]
    with pytest.raises(OverdueError, match="disk"):
        calls.call(lambda: seen.append("made"), 30.0)
    calls.end()
    with pytest.raises(OverdueError, match="disk"):
        calls.call(lambda: seen.append("made"), 30.0)
    answer.set()
    calls.join()
    assert "made" not in seen
    assert threads_left_behind() == []


def test_a_call_that_cannot_be_broken_off_is_overdue_for_another_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deadline.CARD_DRIVER, "seconds", -1.0)
    here = threading.current_thread()
    assert overdue(here)[1] <= 0.0
    with in_progress(Deadline.CARD_DRIVER), in_progress(Deadline.SOURCE_SETUP), in_progress(Deadline.CARD_DRIVER):
        assert overdue(here)[0] is Deadline.CARD_DRIVER
        assert overdue(here)[1] >= 1.0
    monkeypatch.setattr(Deadline.SOURCE_SETUP, "seconds", -2.0)
    with in_progress(Deadline.SOURCE_SETUP):
        with in_progress(Deadline.CARD_DRIVER):
            assert overdue(here)[0] is Deadline.SOURCE_SETUP, "the calls inside it hide it not"
        assert overdue(here)[0] is Deadline.SOURCE_SETUP
    with pytest.raises(LinkError), in_progress(Deadline.CARD_DRIVER):
        raise LinkError("no answer")
    assert overdue(here)[1] <= 0.0, "a failed call is over, too"


Details = namedtuple("Details", "method timeout")


@pytest.mark.parametrize(("waits_s", "given_s"), [(0.0, Deadline.CARD_SERVER.seconds), (60.0, 60.0 + REPLY_MARGIN_S)])
def test_every_call_of_a_server_has_a_deadline_and_after_a_passed_one_none_is_made(
    waits_s: float, given_s: float
) -> None:
    made: list[float] = []
    codes = iter([grpc.StatusCode.OK, grpc.StatusCode.UNAVAILABLE, grpc.StatusCode.DEADLINE_EXCEEDED])

    def go_on(details: Details, _request: object) -> SimpleNamespace:
        made.append(details.timeout)
        code = next(codes)
        return SimpleNamespace(code=lambda: code)

    interceptor = DeadlineInterceptor()
    answers = [
        interceptor.intercept_unary_unary(go_on, Details("read", None), SimpleNamespace(timeout=waits_s))
        for _ in range(5)
    ]
    assert made == [given_s] * 3
    assert answers[2] is answers[3] is answers[4] is interceptor.silent


def test_a_visa_library_that_hangs_is_given_up_and_the_next_attempt_connects_anew(
    answer: threading.Event, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Hanging:
        """A vendor's library that does not keep its own timeout."""

        def open_resource(self, _name: str, **_: object) -> "Hanging":
            return self

        def read(self) -> str:
            answer.wait()
            return "late"

        def write(self, message: str, **_: object) -> None: ...

        def close(self) -> None: ...

    monkeypatch.setattr("pyvisa.ResourceManager", lambda _backend: Hanging())
    link = VisaLink("GPIB0::10::INSTR", backend="@ivi", timeout_s=0.05)
    monkeypatch.setattr(Deadline.SOURCE_CALL, "seconds", 0.0)
    with pytest.raises(LinkError, match="GPIB0"):
        link.read()
    monkeypatch.setattr(Deadline.SOURCE_CALL, "seconds", 30.0)
    with pytest.raises(LinkError, match="GPIB0"):
        link.write("*RST")
    link.reopen()
    link.write("VOLT 0")
    link.close()


def test_a_serial_port_that_hangs_is_given_up(answer: threading.Event, monkeypatch: pytest.MonkeyPatch) -> None:
    port = SerialPort("loop://", 9600, timeout_s=0.05)
    monkeypatch.setattr(port._port, "write", lambda _data: answer.wait())
    monkeypatch.setattr(Deadline.SOURCE_CALL, "seconds", 0.0)
    with pytest.raises(LinkError, match="loop"):
        port.write(b"x")
    port.close()
    assert threads_left_behind() == ["serial port loop://"]
