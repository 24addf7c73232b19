"""A driver that hangs: the watchdog brings the source to rest, and Ctrl-C ends the program all the same."""

import signal
import threading
import time
from contextlib import contextmanager, nullcontext
from pathlib import Path

import numpy as np
import pytest

from app.common.exit_codes import ExitCode
from app.session.bench_connection import connect
from app.session.session import BenchFailed, Session, SessionState
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS
from drivers.interfaces import Block
from tests.helpers.messages import assert_names
from tests.helpers.program import program, safe
from tests.helpers.simulated_bench import simulated

HANGS = """
import sys, threading
from drivers.generators.keysight import Keysight33500

def {method}(*_):
    threading.Event().wait()

Keysight33500.{method} = {method}
sys.argv[1:] = ["--bench", "bench.toml", "--out", ".", "run", "sine-dwell", "--set", "frequencies_hz=100"]
sys.argv += ["--without-commissioning", "simulated bench on its wires"]
from app.cli.main import entry
entry()
"""


@pytest.mark.deep
@pytest.mark.parametrize("method", ["start_drive", "stop"])
def test_ctrl_c_ends_a_program_whose_driver_hangs_after_the_watchdog_brought_the_source_to_rest(
    method: str, tmp_path: Path
) -> None:
    with program(tmp_path, script=HANGS.format(method=method)) as (run, _):
        run.arm()
        run.wait_for("high voltage is on")
        time.sleep(3.0)
        begin_s = time.monotonic()
        run.process.send_signal(signal.SIGINT)
        assert run.end() == ExitCode.UNSAFE, run.text
        took_s = time.monotonic() - begin_s
        assert_names(run.text, "driver", "hangs")
        assert MANUAL_SHUTDOWN_INSTRUCTIONS in run.text
        assert took_s < 40.0
        deadline = time.monotonic() + 20.0
        while not run.bench.report().ends_at_rest and time.monotonic() < deadline:
            time.sleep(0.1)
        safe(run.bench)


def test_a_driver_that_hangs_while_the_bench_connects_does_not_keep_the_program(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("app.session.session.HUNG_CONNECTING_S", 0.05)
    over = threading.Event()

    @contextmanager
    def connect():
        over.wait()
        yield

    events: list[object] = []
    session = Session(connect, [events.append], None)  # type: ignore[arg-type]
    session.start()
    session.abandon_if_hung()
    assert not session.finished.is_set(), "it was not to stop yet"
    session.stop()
    time.sleep(0.1)
    session.abandon_if_hung()
    assert session.finished.is_set()
    assert session.state is SessionState.NO_BENCH
    assert not session.close()
    assert [type(event) for event in events] == [BenchFailed]
    over.set()
    session._thread.join()


class _HangingStream:
    """A card's stream that never returns a block."""

    rate_hz, scales = 1e4, ()

    def __init__(self, over: threading.Event, begun: threading.Event) -> None:
        self._over, self._begun = over, begun

    def __enter__(self) -> "_HangingStream":
        return self

    def __exit__(self, *_: object) -> None: ...

    def read(self) -> Block:
        self._begun.set()
        self._over.wait()
        return Block(0, np.zeros((2, 1), np.int16))


def test_a_card_that_hangs_between_runs_does_not_keep_the_program(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.session.session.HUNG_CONNECTING_S", 0.05)
    over, begun = threading.Event(), threading.Event()
    events: list[object] = []
    with connect(simulated(), None) as connection:
        monkeypatch.setattr(type(connection.bench), "open_stream", lambda *_: _HangingStream(over, begun))
        session = Session(lambda: nullcontext(connection), [events.append], None)  # type: ignore[arg-type]
        session.start()
        session.monitor(active=True)
        assert begun.wait(30.0)
        session.abandon_if_hung()
        assert not session.abandoned, "it was not to stop yet"
        session.stop()
        time.sleep(0.1)
        session.abandon_if_hung()
        assert session.abandoned
        assert session.state is SessionState.NO_BENCH
        assert isinstance(events[-1], BenchFailed)
        over.set()
        session.close()
        session._thread.join()
