"""Instrument locks: one controlling program, named to the others; free when program and watchdog have ended."""

import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from drivers.errors import InstrumentError, UnsafeError
from drivers.interfaces import Identity
from drivers.transport import lock
from drivers.transport.lock import InstrumentLocks, address_key, identity_key, lock_as_watchdog

ADDRESS = "TCPIP::192.0.2.7::5025::SOCKET"
GENERATOR = Identity("Keysight", "33511B", "MY1")
PROGRAM = """
import sys
from pathlib import Path
from drivers.interfaces import Identity
from drivers.transport import lock
lock.lock_folder = lambda: Path(sys.argv[1])
{}
print("holds", flush=True)
sys.stdin.readline()
"""
HOLD = f"""
sys.argv[0] = "/usr/bin/tactor-bench"
locks = lock.InstrumentLocks("bench of Anna")
locks.lock_address("the source", {ADDRESS!r})
locks.lock_identity("the source", Identity("Keysight", "33511B", "MY1"), {ADDRESS!r})
"""


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(lock, "lock_folder", lambda: tmp_path / "locks")
    return tmp_path / "locks"


@contextmanager
def another_program(folder: Path, does: str = HOLD) -> Iterator["subprocess.Popen[str]"]:
    command = [sys.executable, "-c", PROGRAM.format(does), str(folder)]
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout is not None
        assert other.stdout.readline() == "holds\n"
        try:
            yield other
        finally:
            other.kill()


def test_the_refusal_names_the_holder_and_a_killed_holder_holds_nothing(folder: Path) -> None:
    with InstrumentLocks("mine") as locks:
        with another_program(folder) as other:
            with pytest.raises(InstrumentError) as refused:
                locks.lock_address("the source", ADDRESS)
            assert re.fullmatch(
                rf"the source at {ADDRESS} is in use: tactor-bench \(process {other.pid}, user [^ ]+\) has controlled it with "
                r"the bench 'bench of Anna' since 20[0-9: +.-]+; end that program first",
                str(refused.value),
            )
            with pytest.raises(InstrumentError, match="the source Keysight 33511B #MY1 is in use: tactor-bench"):
                locks.lock_identity("the source", GENERATOR, "USB::0x2A8D::0x1301::MY1::INSTR")
            assert locks.files == ()
        locks.lock_address("the source", ADDRESS)
        locks.lock_address("the source", ADDRESS)  # it is ours already
        assert len(locks.files) == 1
    with another_program(folder):
        pass


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="programs cannot be stopped here")
def test_a_holder_that_is_stopped_may_have_left_the_specimen_live(folder: Path) -> None:
    with another_program(folder) as other, InstrumentLocks("mine") as locks:
        other.send_signal(signal.SIGSTOP)
        os.waitpid(other.pid, os.WUNTRACED)
        with pytest.raises(
            UnsafeError, match=r"switch the high voltage OFF .* by a program that is stopped .*bench of Anna"
        ):
            locks.lock_address("the source", ADDRESS)
        other.send_signal(signal.SIGCONT)


def test_what_a_killed_holder_left_stays_on_record_until_a_program_has_taken_the_instrument_over(folder: Path) -> None:
    with another_program(folder):
        pass
    for _ in range(2):  # neither reaches the instrument
        with InstrumentLocks("mine") as locks:
            locks.lock_address("the source", ADDRESS)
            assert "with the bench 'bench of Anna' since" in locks.left_by
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        locks.forget_earlier_program()
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        assert locks.left_by == ""


def test_a_bench_that_cannot_be_opened_after_its_program_was_killed_is_unsafe(folder: Path) -> None:
    address = "127.0.0.1:9"  # nothing listens there
    config = BenchConfig.model_validate(
        {"generator": {"resource": "TCPIP::127.0.0.1::9::SOCKET"}, "card": {"server": address}}
    )
    with pytest.raises(InstrumentError, match="does not answer"), connect(config):
        pass
    dead = InstrumentLocks("bench of Anna")
    dead.lock_address("the card", f"{address}/Dev1")
    for held in dead._locks.values():
        held.release()
    with (
        pytest.raises(
            UnsafeError, match=r"(?s)high voltage OFF .*does not answer.*may have left a drive .*bench of Anna"
        ),
        connect(config),
    ):
        pass


def test_an_instrument_stays_locked_until_the_watchdog_has_ended_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lock, "WATCHDOG_TIMEOUT_S", 0.1)
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        files = locks.files
    with (
        another_program(folder, f"held = lock.lock_as_watchdog({files!r})"),
        InstrumentLocks("mine") as locks,
        pytest.raises(UnsafeError, match=r"the watchdog of an ended program has not brought it to rest within 0\.1 s"),
    ):
        locks.lock_address("the source", ADDRESS)
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        for mine in lock_as_watchdog(locks.files):
            mine.release()


def test_every_user_may_lock(folder: Path) -> None:
    before = os.umask(0o077)
    try:
        with InstrumentLocks("mine") as locks:
            locks.lock_address("the source", ADDRESS)
            modes = {file.suffix: oct(file.stat().st_mode & 0o777) for file in folder.iterdir()}
    finally:
        os.umask(before)
    assert modes == {".lock": "0o666", ".watchdog": "0o666", ".json": "0o666"}
    assert folder.stat().st_mode & 0o7777 == 0o1777


def test_one_instrument_has_one_name_and_simulated_ones_have_their_own() -> None:
    assert address_key("TCPIP0::127.0.0.1::5025::SOCKET") == address_key("tcpip::localhost::5025::socket")
    assert address_key(ADDRESS) != address_key(ADDRESS.replace("192.0.2.7", "192.0.2.8"))
    assert identity_key(GENERATOR, ADDRESS) == identity_key(GENERATOR, "ASRL/dev/ttyUSB0::INSTR") != ""
    assert identity_key(GENERATOR, "TCPIP::127.0.0.1::5025::SOCKET") == ""  # a simulated one: many have this number
    assert identity_key(Identity("Keysight", "33511B"), ADDRESS) == ""


def test_a_folder_that_cannot_be_written_is_named(folder: Path) -> None:
    folder.write_text("a file in its place")
    with InstrumentLocks("mine") as locks, pytest.raises(InstrumentError, match=r"the lock .* cannot be taken: "):
        locks.lock_address("the source", ADDRESS)
