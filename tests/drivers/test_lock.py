"""Instrument locks: one controlling program, named to the others; free when program and watchdog have ended."""

import json
import os
import re
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import SimpleNamespace

import pytest

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from drivers.deadlines import CallThread, Deadline
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS, AcquisitionError, InstrumentError, UnsafeError
from drivers.interfaces import Identity
from drivers.transport import lock
from drivers.transport.lock import InstrumentLocks, address_key, identity_key, lock_as_watchdog, lock_folder

ADDRESS = "TCPIP::192.0.2.7::5025::SOCKET"
SIMULATED_ADDRESS = ADDRESS.replace("192.0.2.7", "127.0.0.1")
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
    with pytest.raises(AcquisitionError, match=rf"\bDev1 at {address}: ") as refused, connect(config):
        pass
    dead = InstrumentLocks("bench of Anna")
    dead.lock_address("the card", f"{address}/Dev1")
    for held in dead._locks.values():
        held.release()
    with pytest.raises(UnsafeError, match=r"may have left a drive .*bench of Anna") as unsafe, connect(config):
        pass
    assert str(unsafe.value).startswith(MANUAL_SHUTDOWN_INSTRUCTIONS)
    assert str(refused.value) in str(unsafe.value)


def test_an_instrument_stays_locked_until_the_watchdog_has_ended_too(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Deadline.INSTRUMENT_LOCK, "seconds", 0.1)
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


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such modes")
def test_a_folder_that_another_user_made_is_left_as_it_is(folder: Path) -> None:
    folder.mkdir(0o755)
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
    assert folder.stat().st_mode & 0o7777 == 0o755


def test_one_instrument_has_one_name_and_simulated_ones_have_their_own() -> None:
    assert address_key("TCPIP0::127.0.0.1::5025::SOCKET") == address_key("tcpip::localhost::5025::socket")
    assert address_key(ADDRESS) != address_key(ADDRESS.replace("192.0.2.7", "192.0.2.8"))
    assert identity_key(GENERATOR, ADDRESS) == identity_key(GENERATOR, "ASRL/dev/ttyUSB0::INSTR") != ""
    assert identity_key(GENERATOR, SIMULATED_ADDRESS) == ""  # many simulated ones have this number
    assert identity_key(Identity("Keysight", "33511B"), ADDRESS) == ""


def test_a_folder_that_cannot_be_written_is_named(folder: Path) -> None:
    folder.write_text("a file in its place")
    with InstrumentLocks("mine") as locks, pytest.raises(InstrumentError, match=r"the lock .* cannot be taken: "):
        locks.lock_address("the source", ADDRESS)


@pytest.mark.one_in(1)
@pytest.mark.skipif(os.name == "nt", reason="the folder of Windows is another one")
@pytest.mark.parametrize(
    ("mode", "exists", "parent"),
    [(0o41777, True, "/run/lock"), (0o40777, True, "/tmp"), (0o41775, True, "/tmp"), (0o41777, False, "/tmp")],
)
def test_the_folder_is_one_into_which_every_user_may_write_and_none_may_delete_of_others(
    monkeypatch: pytest.MonkeyPatch, mode: int, exists: bool, parent: str
) -> None:
    with monkeypatch.context() as computer:
        computer.setattr(Path, "is_dir", lambda _: exists)
        computer.setattr(Path, "stat", lambda _: SimpleNamespace(st_mode=mode))
        folder = lock_folder()
    assert str(folder) == f"{parent}/tactor-bench"


def test_the_folder_can_be_made_on_this_computer() -> None:
    assert lock_folder().is_absolute()
    assert lock_folder().parent.parent.is_dir()
    if os.name != "nt":
        assert lock_folder().parent.stat().st_mode & 0o1777 == 0o1777


def test_released_locks_leave_no_files(folder: Path) -> None:
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        assert len(list(folder.iterdir())) == 3
    assert not list(folder.iterdir())
    assert locks.files == ()


def test_a_record_of_a_release_is_no_program_that_left_the_instrument(folder: Path) -> None:
    """Where the files cannot be removed."""
    for record, left in ((lock.RELEASED, False), ("{}\n", True)):
        with InstrumentLocks("mine") as locks:
            folder.mkdir(exist_ok=True)
            lock._lock_file(address_key(ADDRESS)).with_suffix(".json").write_text(record)
            locks.lock_address("the source", ADDRESS)
            assert bool(locks.left_by) is left
            locks.forget_earlier_program()


def test_a_lock_that_waits_for_a_watchdog_in_vain_is_free_again(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with InstrumentLocks("theirs") as theirs:
        theirs.lock_address("the source", ADDRESS)
        (watchdog,) = lock_as_watchdog(theirs.files)
        for held in theirs._locks.values():
            held.release()
        monkeypatch.setattr(Deadline.INSTRUMENT_LOCK, "seconds", 0.02)
        with InstrumentLocks("mine") as mine, pytest.raises(UnsafeError):
            mine.lock_address("the source", ADDRESS)
        watchdog.release()
        with InstrumentLocks("a third") as third:
            third.lock_address("the source", ADDRESS)
            assert len(third.files) == 1


def test_the_files_stay_while_a_watchdog_has_its_lock(folder: Path) -> None:
    locks = InstrumentLocks("mine")
    locks.lock_address("the source", ADDRESS)
    (watchdog,) = lock_as_watchdog(locks.files)
    locks.close()
    assert len(list(folder.iterdir())) == 3
    watchdog.release()


@pytest.mark.skipif(os.name == "nt", reason="an open file cannot be removed there")
def test_a_program_that_had_opened_a_removed_lock_takes_the_one_that_is_there(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Else it and a third program would have a lock each."""
    from filelock import _unix

    mine, theirs = InstrumentLocks("mine"), InstrumentLocks("theirs")
    mine.lock_address("the source", ADDRESS)
    attempt = _unix.lock_fd_nonblocking

    def after_release(descriptor: int) -> bool:
        monkeypatch.setattr(_unix, "lock_fd_nonblocking", attempt)
        mine.close()
        return attempt(descriptor)

    monkeypatch.setattr(_unix, "lock_fd_nonblocking", after_release)
    with pytest.raises(InstrumentError):
        theirs.lock_address("the source", ADDRESS)  # it may try again
    theirs.lock_address("the source", ADDRESS)
    with InstrumentLocks("a third") as third, pytest.raises(InstrumentError, match="use"):
        third.lock_address("the source", ADDRESS)
    theirs.close()


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes in folders here")
def test_a_pipe_in_the_place_of_a_record_holds_nobody_up(folder: Path) -> None:
    """The folder is everybody's: reading or writing a pipe that another user put there would not end."""
    path = lock._lock_file(lock.address_key(ADDRESS)).with_suffix(".json")
    folder.mkdir()
    os.mkfifo(path)
    locks, thread = InstrumentLocks("mine"), CallThread("locks")
    for call in (lambda: locks.lock_address("the source", ADDRESS), lambda: lock._holder(path), locks.close):
        thread.call(call, 10.0)
    thread.end()
    assert not path.exists(), "the files of a released lock are removed"


@pytest.mark.skipif(os.name == "nt", reason="symbolic links need a privilege there")
def test_a_symbolic_link_in_the_place_of_a_lock_is_named(folder: Path, tmp_path: Path) -> None:
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        (path,) = map(Path, locks.files)
    (victim := tmp_path / "victim").write_text("untouched")
    path.symlink_to(victim)
    with InstrumentLocks("mine") as locks, pytest.raises(InstrumentError, match="symbolic"):
        locks.lock_address("the source", ADDRESS)
    assert victim.read_text() == "untouched"


def test_locks_taken_by_one_thread_are_released_by_another(folder: Path) -> None:
    locks = InstrumentLocks("mine")
    thread = threading.Thread(target=locks.lock_address, args=("the source", ADDRESS))
    thread.start()
    thread.join()
    locks.close()
    with InstrumentLocks("theirs") as theirs:
        theirs.lock_address("the source", ADDRESS)


def test_a_simulated_bench_locks_nothing(folder: Path) -> None:
    with InstrumentLocks("mine", simulated=True) as locks:
        locks.lock_address("the source", ADDRESS)
        locks.lock_identity("the source", GENERATOR, ADDRESS)
        assert locks.files == ()
    assert not folder.exists()


def test_an_instrument_without_a_serial_number_is_locked_by_its_address_alone(folder: Path) -> None:
    with InstrumentLocks("mine") as locks:
        locks.lock_identity("the source", Identity("Keysight", "33511B"), ADDRESS)
        assert locks.files == ()
        locks.lock_identity("the source", GENERATOR, ADDRESS)
        locks.lock_address("the source", ADDRESS)
        assert len(set(locks.files)) == 2
        assert all(Path(file).parent == folder for file in locks.files)


def test_two_watchdogs_do_not_share_an_instrument(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deadline.INSTRUMENT_LOCK, "seconds", 0.1)
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        mine = lock_as_watchdog(locks.files)
        assert len(mine) == 1
        with pytest.raises(InstrumentError, match=r"another watchdog holds .*\.watchdog; end it first"):
            lock_as_watchdog(locks.files)
        for each in mine:
            each.release()
        for each in lock_as_watchdog(locks.files):
            each.release()


def test_a_watchdog_that_still_works_is_waited_for(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The program that ended is followed at once by the next one; its watchdog needs a moment for the way to rest."""
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        files = locks.files
    (held,) = lock_as_watchdog(files)
    timer = threading.Timer(0.1, held.release)
    timer.start()
    with InstrumentLocks("mine") as locks:
        locks.lock_address("the source", ADDRESS)
        assert locks.files == files
    timer.join()


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("record", "says"),
    [
        (None, "another program controls it (lock "),
        ("[]", "another program controls it (lock "),
        ('{"pid": 7}', "another program controls it (lock "),
        (
            '{"pid": 7, "user": "anna\\u001b[2J", "program": "p", "bench": "b", "since": "noon"}',
            "p (process 7, user anna[2J) has controlled it with the bench 'b' since noon",
        ),
    ],
)
def test_a_record_of_a_holder_that_cannot_be_read_is_no_error(folder: Path, record: str | None, says: str) -> None:
    with InstrumentLocks("theirs") as theirs:
        theirs.lock_address("the source", ADDRESS)
        (file,) = folder.glob("*.json")
        if record is None:
            file.unlink()
        else:
            file.write_text(record)
        with InstrumentLocks("mine") as locks, pytest.raises(InstrumentError) as refused:
            locks.lock_address("the source", ADDRESS)
    assert f"the source at {ADDRESS} is in use: {says}" in str(refused.value)


@pytest.mark.parametrize(("called", "program"), [("", "python"), ("/usr/bin/tactor-bench", "tactor-bench")])
def test_the_record_names_program_process_and_bench(
    folder: Path, monkeypatch: pytest.MonkeyPatch, called: str, program: str
) -> None:
    monkeypatch.setattr(sys, "argv", [called])
    with InstrumentLocks("bench of Anna") as locks:
        locks.lock_address("the source", ADDRESS)
        (file,) = folder.glob("*.json")
        holder = json.loads(file.read_text())
    assert (holder["program"], holder["pid"], holder["bench"]) == (program, os.getpid(), "bench of Anna")
    assert holder["user"]


def test_a_second_program_writes_over_the_record_of_the_first(folder: Path) -> None:
    for bench in ("the first, with a long name", "mine"):
        with InstrumentLocks(bench) as locks:
            locks.lock_address("the source", ADDRESS)
            (file,) = folder.glob("*.json")
            assert json.loads(file.read_text())["bench"] == bench
