"""System calls of a child process, each shown to its parent, which lets it pass or answers in its place (Linux, seccomp).

Sources: seccomp_unotify(2), seccomp(2), Linux UAPI `linux/seccomp.h`, `linux/filter.h`, and the table of x86-64 system calls.
"""

import array
import contextlib
import ctypes
import fcntl
import os
import platform
import select
import socket
import struct
import sys
import time
import traceback
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

CALLS = {
    0: "read", 1: "write", 17: "pread64", 18: "pwrite64", 19: "readv", 20: "writev", 40: "sendfile", 326: "copy_file_range",
    2: "open", 257: "openat", 4: "stat", 5: "fstat", 6: "lstat", 262: "newfstatat", 332: "statx", 21: "access", 269: "faccessat",
    73: "flock", 74: "fsync", 75: "fdatasync", 76: "truncate", 77: "ftruncate", 78: "getdents", 217: "getdents64",
    82: "rename", 264: "renameat", 316: "renameat2", 83: "mkdir", 258: "mkdirat", 84: "rmdir", 86: "link", 88: "symlink",
    87: "unlink", 263: "unlinkat", 90: "chmod", 91: "fchmod", 268: "fchmodat", 137: "statfs", 138: "fstatfs", 280: "utimensat",
    285: "fallocate",
}  # fmt: skip
"""Calls on files, by number."""

WITH_PATH = {
    "open": 0,
    "stat": 0,
    "lstat": 0,
    "access": 0,
    "truncate": 0,
    "rename": 1,
    "mkdir": 0,
    "rmdir": 0,
    "unlink": 0,
}
WITH_PATH |= {"chmod": 0, "statfs": 0, "link": 1, "symlink": 1}
WITH_PATH |= {"openat": 1, "newfstatat": 1, "statx": 1, "faccessat": 1, "renameat": 3, "renameat2": 3, "mkdirat": 1}
WITH_PATH |= {"unlinkat": 1, "fchmodat": 1, "utimensat": 1}
"""Which argument is a path; of all other calls, and where that is empty, the first is a descriptor."""

READS = ("read", "pread64")
WRITES = ("write", "pwrite64", "writev", "sendfile", "copy_file_range", "ftruncate", "fallocate")

_SECCOMP, _PRCTL = 317, 157
_NOTIFY_RECEIVE, _NOTIFY_SEND, _NOTIFY_VALID = 0xC0502100, 0xC0182101, 0x40082102
_CONTINUE = 1
_NOTIFICATION = struct.Struct("<QIIiIQ6Q")
_RESPONSE = struct.Struct("<QqiI")


def supported() -> bool:
    """Whether this computer shows system calls in this way."""
    if sys.platform != "linux" or platform.machine() != "x86_64":
        return False
    sizes = ctypes.create_string_buffer(6)
    return ctypes.CDLL(None, use_errno=True).syscall(_SECCOMP, 3, 0, sizes) == 0


def _filter() -> bytes:
    """Return the program: every call of `CALLS` is notified, all others pass."""
    numbers = sorted(CALLS)
    code = [struct.pack("<HBBI", 0x20, 0, 0, 4), struct.pack("<HBBI", 0x15, 1, 0, 0xC000003E)]
    code += [struct.pack("<HBBI", 0x06, 0, 0, 0x7FFF0000), struct.pack("<HBBI", 0x20, 0, 0, 0)]
    for k, number in enumerate(numbers):
        code.append(struct.pack("<HBBI", 0x15, len(numbers) - k, 0, number))
    code += [struct.pack("<HBBI", 0x06, 0, 0, 0x7FFF0000), struct.pack("<HBBI", 0x06, 0, 0, 0x7FC00000)]
    return b"".join(code)


def _install(program: bytes) -> int:
    """Let the calls of this thread, and of those that it starts, be notified; return the listener."""
    libc = ctypes.CDLL(None, use_errno=True)
    buffer = ctypes.create_string_buffer(program, len(program))
    description = struct.pack("<HxxxxxxQ", len(program) // 8, ctypes.addressof(buffer))
    if libc.prctl(38, 1, 0, 0, 0):
        raise OSError(ctypes.get_errno(), "no_new_privs")
    listener = libc.syscall(_SECCOMP, 1, 8, description)
    if listener < 0:
        raise OSError(ctypes.get_errno(), "seccomp")
    return int(listener)


@dataclass(frozen=True, slots=True)
class Call:
    """A call of the child: its name, its file, and how to answer it."""

    name: str
    path: str
    pid: int
    ident: int
    arguments: tuple[int, ...]


class TracedChild:
    """A forked child whose calls on files below some folders are given to `decide`.

    Args:
        work: what the child does; its result is the exit code.
        folders: beginnings of the paths that count; without any, no call is shown.
        decide: is given the number of the call, from 0, and the call; returns None to let it pass, an error number, or
            an `Answer`. It may also keep the call, by `HOLD`.
    """

    def __init__(
        self, work: Callable[[], int], folders: tuple[str, ...], decide: "Callable[[int, Call], object]"
    ) -> None:
        self._folders, self._decide = folders, decide
        self.count = 0
        self.held: list[Call] = []
        near, far = socket.socketpair(socket.AF_UNIX, socket.SOCK_STREAM)
        program = _filter()
        self.pid = os.fork()
        if self.pid == 0:
            code = 70
            try:
                near.close()
                if folders:
                    listener = _install(program)  # from here on everything waits for the parent
                    # sendmsg is no call on a file
                    far.sendmsg([b"x"], [(socket.SOL_SOCKET, socket.SCM_RIGHTS, array.array("i", [listener]))])
                far.close()
                code = work()
            except BaseException:  # noqa: BLE001 - the parent reports it
                traceback.print_exc()
            finally:
                with contextlib.suppress(Exception):
                    sys.stdout.flush()
                    sys.stderr.flush()
                os._exit(code)
        far.close()
        self._listener: int | None = None
        if folders:
            _, ancillary, _, _ = near.recvmsg(1, 64)
            self._listener = array.array("i", ancillary[0][2][:4])[0]
        near.close()

    def serve(self, timeout_s: float) -> int | None:
        """Answer calls until the child has ended; return its exit code, None if it has not ended within the time."""
        until_s = time.monotonic() + timeout_s
        poll = select.poll()
        if self._listener is not None:
            poll.register(self._listener, select.POLLIN)
        while True:
            for _, event in poll.poll(20 if self._listener is not None else 2):
                if event & select.POLLIN:
                    self._answer()
            ended, status = os.waitpid(self.pid, os.WNOHANG)
            if ended:
                return os.waitstatus_to_exitcode(status)
            if time.monotonic() > until_s:
                return None

    def kill(self) -> None:
        os.kill(self.pid, 9)
        os.waitpid(self.pid, 0)

    def close(self) -> None:
        if self._listener is not None:
            os.close(self._listener)

    def release(self) -> None:
        """Let the calls that are held pass."""
        for call in self.held:
            self._send(call.ident, 0, 0, _CONTINUE)
        self.held.clear()

    def _answer(self) -> None:
        buffer = bytearray(80)
        try:
            fcntl.ioctl(self._listener, _NOTIFY_RECEIVE, buffer)
        except OSError:  # it was interrupted or has ended
            return
        ident, pid, _, number, _, _, *arguments = _NOTIFICATION.unpack(buffer[: _NOTIFICATION.size])
        name = CALLS[number]
        call = Call(name, self._path(name, pid, arguments), pid, ident, tuple(arguments))
        if not call.path.startswith(self._folders):
            self._send(ident, 0, 0, _CONTINUE)
            return
        number_of_call, self.count = self.count, self.count + 1
        answer = self._decide(number_of_call, call)
        if answer is None:
            self._send(ident, 0, 0, _CONTINUE)
        elif answer == "hold":
            self.held.append(call)
        elif answer == "garbage":
            self._send(ident, self._fill(call), 0, 0)
        elif answer == "end":
            self._send(ident, 0, 0, 0)
        else:
            self._send(ident, 0, -int(answer), 0)  # type: ignore[call-overload]

    def _send(self, ident: int, value: int, error: int, flags: int) -> None:
        with contextlib.suppress(OSError):  # the call was interrupted
            fcntl.ioctl(self._listener, _NOTIFY_SEND, bytearray(_RESPONSE.pack(ident, value, error, flags)))

    def _fill(self, call: Call) -> int:
        """Put wrong bytes into the buffer of a read; return how many there are in the file."""
        descriptor, address, size, offset = call.arguments[:4]
        process = Path(f"/proc/{call.pid}")
        with (process / f"fd/{descriptor}").open("rb", buffering=0) as file:
            if call.name == "read":
                offset = int((process / f"fdinfo/{descriptor}").read_text().split("pos:")[1].split()[0])
            file.seek(offset)
            found = len(file.read(size))
        with (process / "mem").open("r+b", buffering=0) as memory:
            memory.seek(address)
            memory.write(bytes((17 * k + 165) % 256 for k in range(found)))
        return found

    @staticmethod
    def _path(name: str, pid: int, arguments: list[int]) -> str:
        where = WITH_PATH.get(name)
        text = _text(pid, arguments[where]) if where is not None else ""
        if text.startswith("/"):
            return text
        descriptor = arguments[where - 1] if where else arguments[0]
        with contextlib.suppress(OSError):
            if text and (where == 0 or descriptor & 0xFFFFFFFF == 0xFFFFFF9C):  # AT_FDCWD
                return str(Path(f"/proc/{pid}/cwd").readlink() / text)
            return str(Path(f"/proc/{pid}/fd/{descriptor & 0xFFFFFFFF}").readlink() / text)
        return ""


def _text(pid: int, address: int) -> str:
    """Return the text at an address of a process."""
    try:
        with Path(f"/proc/{pid}/mem").open("rb", buffering=0) as memory:
            memory.seek(address)
            piece = memory.read(min(4096, 4096 - address % 4096)) or b""
            if b"\0" not in piece:
                piece += memory.read(4096) or b""
    except (OSError, OverflowError, ValueError):
        return ""
    return os.fsdecode(piece.partition(b"\0")[0])
