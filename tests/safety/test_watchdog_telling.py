"""Watchdog reports: each action is reported once, and so is the absence of a watchdog."""

import os
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path

import pytest

from app.session.session import BenchFailed, ConnectedBench, Session
from drivers.bench.watchdog_interface import WATCHDOG_DISABLED_WARNING, NoWatchdog
from drivers.deadlines import CallThread
from drivers.errors import BenchError
from drivers.watchdog.log import LOG_NAME, append_line, take_unreported_lines
from protocols.base import LogMessage
from protocols.measurements.sine_dwell import SineDwell
from protocols.runner.request import RunRequest
from tests.helpers.simulated_bench import laboratory


@pytest.mark.deep
def test_what_it_wrote_is_told_once_at_the_next_start(tmp_path: Path) -> None:
    written = "the source was brought to rest"
    (tmp_path / LOG_NAME).write_text(f"2026-11-21T09:15:02.000Z  {written}\n")
    for text in (1, 0):
        events: list[object] = []
        with laboratory() as lab:
            session = Session(lambda lab=lab: nullcontext(lab), [events.append], lab.operator)
            session.start()
            session.run(RunRequest(SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=3), tmp_path, "T"))
            session.finished.wait(60)
            session.close()
        notes = [e.text for e in events if isinstance(e, LogMessage) and "the watchdog wrote" in e.text]
        assert len(notes) == text
        assert all(written in note for note in notes)
    assert take_unreported_lines(tmp_path) == []


def test_lines_that_an_earlier_version_has_told_are_not_told_again(tmp_path: Path) -> None:
    mark = "2026-11-21T09:16:02.000Z  the lines above were told at the next start"
    (tmp_path / LOG_NAME).write_text(f"2026-11-21T09:15:02.000Z  the source was brought to rest\n{mark}\n")
    assert take_unreported_lines(tmp_path) == []


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders here")
def test_a_pipe_in_the_place_of_its_log_holds_neither_it_nor_the_program_up(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / LOG_NAME)
    thread = CallThread("log")  # nobody reads or writes the pipe
    thread.call(lambda: append_line(tmp_path, "the source was brought to rest"), 10.0)
    assert thread.call(lambda: take_unreported_lines(tmp_path), 10.0) == []
    thread.end()
    (tmp_path / LOG_NAME).unlink()
    append_line(tmp_path, "the source was brought to rest")
    assert (tmp_path / LOG_NAME).stat().st_mode & 0o111 == 0, "a log is no program"


def test_what_it_wrote_is_told_although_the_bench_cannot_be_opened(tmp_path: Path) -> None:
    written = "The source could NOT be brought to rest"
    (tmp_path / LOG_NAME).write_text(f"2026-11-21T09:15:02.000Z  {written}\n")

    @contextmanager
    def refused() -> Iterator[ConnectedBench]:
        raise BenchError("the generator cannot be reached")
        yield

    events: list[object] = []
    session = Session(refused, [events.append], None, tmp_path)  # type: ignore[arg-type]
    session.start()
    session.close()
    assert [type(event) for event in events] == [LogMessage, BenchFailed]
    assert written in events[0].text  # type: ignore[attr-defined]


def test_no_watchdog_on_virtual_clock_and_warning_when_disabled() -> None:
    with laboratory() as lab:
        assert isinstance(lab.bench.watchdog, NoWatchdog)
        assert lab.bench.watchdog.inactive_reason == ""
    assert "a held level stays on the specimen" in WATCHDOG_DISABLED_WARNING


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("resource", "shared"),
    [
        ("TCPIP::192.0.2.7::5025::SOCKET", True),
        ("TCPIP::192.0.2.7::hislip0::INSTR", True),
        ("ASRL/dev/ttyUSB0::INSTR", False),
        ("usb0::0x2A8D::0x1301::MY1::INSTR", False),
        ("GPIB0::10::INSTR", False),
    ],
)
def test_a_wire_that_takes_one_who_talks_is_not_opened_beside_the_program(resource: str, shared: bool) -> None:
    """Two readers on one serial line would each get half of the answers."""
    from app.session.bench_connection import allows_second_connection

    assert allows_second_connection(resource) == shared
