"""Suspend inhibitor: asks each operating system in its own way and reports a failure."""

import ctypes
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest

from app.session.suspend import ES_CONTINUOUS, ES_SYSTEM_REQUIRED, suspend_inhibited

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="the stand-ins are shell scripts")


@pytest.fixture
def stand_in(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Put a command on the path that records its arguments and process id, and then runs `action`."""

    def make(name: str, action: str) -> Path:
        record = tmp_path / "called"
        script = tmp_path / name
        script.write_text(f'#!/bin/sh\necho "$$ $*" > {record}.new; mv {record}.new {record}\n{action}\n')
        script.chmod(0o755)
        monkeypatch.setenv("PATH", f"{tmp_path}:/usr/bin:/bin")
        return record

    return make


def called(record: Path) -> tuple[psutil.Process, str]:
    pid, _, arguments = record.read_text().partition(" ")
    return psutil.Process(int(pid)), arguments


def test_linux_holds_a_lock_of_logind_while_inside(stand_in, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    record = stand_in("systemd-inhibit", "exec cat")
    with suspend_inhibited() as warning:
        assert warning == ""
        holder, arguments = called(record)
        assert "--what=sleep:idle:handle-lid-switch --mode=block" in arguments
        assert holder.is_running()
    assert not holder.is_running()


@pytest.mark.deep
def test_the_lock_ends_with_a_killed_program(stand_in) -> None:
    record = stand_in("systemd-inhibit", "exec cat")
    code = (
        "import sys, time; sys.platform = 'linux'\n"
        "from app.session.suspend import suspend_inhibited\n"
        "with suspend_inhibited(): print('inside', flush=True); time.sleep(60)"
    )
    program = subprocess.Popen([sys.executable, "-c", code], stdout=subprocess.PIPE)
    assert program.stdout is not None
    assert program.stdout.readline() == b"inside\n"
    holder, _ = called(record)
    program.kill()
    program.wait()
    program.stdout.close()
    assert holder.wait(30) is None or not holder.is_running()


@pytest.mark.parametrize("action", ["exit 1", "exit 0"])
def test_a_refusal_of_logind_is_a_warning(action: str, stand_in, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    stand_in("systemd-inhibit", action)
    with suspend_inhibited() as warning:
        assert "This computer may suspend during a run: systemd-inhibit could not ask logind" in warning
        assert "switch automatic suspend off" in warning


def test_a_computer_without_logind_is_a_warning(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setenv("PATH", str(tmp_path))
    with suspend_inhibited() as warning:
        assert "may suspend during a run" in warning


def test_macos_runs_caffeinate_while_inside(stand_in, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "platform", "darwin")
    stand_in("caffeinate", "exec cat")
    before = psutil.Process().children()
    with suspend_inhibited() as warning:
        assert warning == ""
        (holder,) = set(psutil.Process().children()) - set(before)
    assert not holder.is_running()


@pytest.mark.parametrize("granted", [0x8000_0000, 0])
def test_windows_is_asked_by_its_execution_state(granted: int, monkeypatch: pytest.MonkeyPatch) -> None:
    states: list[int] = []

    def set_state(state: ctypes.c_uint) -> int:
        states.append(state.value)
        return granted

    kernel = SimpleNamespace(SetThreadExecutionState=set_state)
    monkeypatch.setattr(sys, "platform", "win32")
    monkeypatch.setattr(ctypes, "windll", SimpleNamespace(kernel32=kernel), raising=False)
    with suspend_inhibited() as warning:
        assert states == [ES_CONTINUOUS | ES_SYSTEM_REQUIRED]
        assert bool(warning) == (not granted)
    assert states[1:] == ([ES_CONTINUOUS] if granted else [])
