"""Stand-in for Windows' rules on another system: runs the command line with what Windows lacks taken away.

    python -m tests.helpers.windows_stand_in ARGUMENTS [--then ARGUMENTS]...

- For the product's modules `os.name` is `nt` and `sys.platform` is `win32`; `os` and `signal` lack what Windows lacks, and modules such
  as `fcntl` cannot be imported. Other packages see the real system, because `pathlib` and Qt do not work otherwise.
- A file that this process holds open cannot be renamed, replaced or deleted, nor another be moved onto it.
- Names that Windows does not take (`CON`, `a:b`, `x.`) cannot be created.
- The console is cp1252: run it with `PYTHONIOENCODING=cp1252`.
"""

import builtins
import errno
import io
import os
import runpy
import shutil
import signal
import sys
import tempfile
import types
from collections.abc import Callable
from pathlib import Path, PurePath, PureWindowsPath
from typing import Any

CHILD = "--child"
"""Before the arguments of Python in a process that the program starts."""
THEN = "--then"
"""Between the arguments of one command and the next."""

PRODUCT = {"app", "drivers", "model", "protocols", "sim_hardware", "tactor_bench"}
MISSING = {
    "os": ("fork", "setsid", "getpgid", "getpgrp", "killpg", "geteuid", "getuid", "getgid", "mkfifo", "pread", "tcgetpgrp", "openpty",
           "ttyname", "fchmod", "chown", "nice", "uname", "sysconf", "statvfs", "sched_getaffinity", "O_NOFOLLOW", "O_DIRECTORY",
           "O_CLOEXEC", "O_NONBLOCK"),
    "signal": ("SIGSTOP", "SIGCONT", "SIGKILL", "SIGHUP", "SIGALRM", "SIGUSR1", "SIGCHLD", "SIGTSTP", "setitimer", "pause", "alarm"),
}  # fmt: skip
POSIX_MODULES = {"fcntl", "termios", "pty", "tty", "pwd", "grp", "resource", "syslog", "readline"}
INVALID = set('<>:"|?*') | {chr(code) for code in range(32)}
SHARING_VIOLATION, INVALID_NAME = errno.EACCES, errno.EINVAL


class ModuleWithout(types.ModuleType):
    """A module of the standard library with some names taken away and others replaced."""

    def __init__(self, real: types.ModuleType, missing: tuple[str, ...] = (), **replaced: Any) -> None:
        super().__init__(real.__name__)
        self.__dict__.update({name: value for name, value in vars(real).items() if name not in missing} | replaced)


def open_files() -> set[str]:
    """Real paths of the files that this process holds open."""
    found = set()
    for handle in Path("/proc/self/fd").iterdir():
        try:
            target = str(handle.readlink())
        except OSError:
            continue
        if target.startswith("/") and not target.startswith(("/dev", "/proc", "/memfd")):
            found.add(target.removesuffix(" (deleted)"))
    return found


def refuse_open(*paths: Any) -> None:
    """Raise what Windows raises for a file that is open."""
    busy = open_files()
    for path in paths:
        if isinstance(path, str | bytes | PurePath) and os.path.realpath(os.fsdecode(path)) in busy:
            raise PermissionError(
                SHARING_VIOLATION, "the file is open: a sharing violation on Windows", os.fsdecode(path)
            )


def refuse_name(path: Any) -> None:
    """Raise what Windows raises for a name that it does not take."""
    if not isinstance(path, str | bytes | PurePath):
        return
    text = os.fsdecode(path)
    if text.startswith(("/dev/", "/proc/", "/sys/")):
        return
    name = PurePath(text).name
    reserved = PureWindowsPath(name).is_reserved()
    if reserved or set(name) & INVALID or name != name.rstrip(". "):
        raise OSError(INVALID_NAME, "Windows does not take this name", text)


def install() -> None:
    """Take away what Windows lacks, for this process."""
    for name, checked in (("rename", 2), ("replace", 2), ("unlink", 1), ("remove", 1)):
        setattr(os, name, _checked(getattr(os, name), checked))
    real_open, real_low, real_mkdir = io.open, os.open, os.mkdir

    def checked_open(file: Any, mode: str = "r", *args: Any, **kwargs: Any) -> Any:
        if set(mode) & set("wxa+"):
            refuse_name(file)
        return real_open(file, mode, *args, **kwargs)

    def checked_low(path: Any, flags: int, *args: Any, **kwargs: Any) -> int:
        if flags & os.O_CREAT:
            refuse_name(path)
        if os.path.isdir(path):  # noqa: PTH112 - may be a descriptor
            raise PermissionError(SHARING_VIOLATION, "a folder cannot be opened on Windows", os.fsdecode(path))
        return real_low(path, flags, *args, **kwargs)

    def checked_mkdir(path: Any, *args: Any, **kwargs: Any) -> None:
        refuse_name(path)
        real_mkdir(path, *args, **kwargs)

    vars(shutil)["_use_fd_functions"] = False  # rmtree by paths, as on Windows
    vars(tempfile)["TemporaryFile"] = tempfile.NamedTemporaryFile  # there it has a name while it is open
    io.open = builtins.open = checked_open
    os.open, os.mkdir = checked_low, checked_mkdir
    fakes = {
        "os": ModuleWithout(os, MISSING["os"], name="nt"),
        "signal": ModuleWithout(signal, MISSING["signal"]),
        "sys": _Windows(),
        "msvcrt": types.ModuleType("msvcrt"),
    }
    fakes["msvcrt"].__dict__.update(kbhit=lambda: False, getwch=lambda: "")
    real_import = builtins.__import__

    def importing(name: str, globals: Any = None, locals: Any = None, fromlist: Any = (), level: int = 0) -> Any:  # noqa: A002
        importer = str((globals or {}).get("__name__", "")).partition(".")[0]
        if importer in PRODUCT and level == 0:
            if name in fakes:
                return fakes[name]
            if name in POSIX_MODULES:
                raise ModuleNotFoundError(f"No module named '{name}'", name=name)
        return real_import(name, globals, locals, fromlist, level)

    builtins.__import__ = importing


class _Windows(types.ModuleType):
    """`sys` whose platform is Windows; the rest is the real one's at every access."""

    def __init__(self) -> None:
        super().__init__("sys")

    def __getattribute__(self, name: str) -> Any:
        return "win32" if name == "platform" else getattr(sys, name)

    def __setattr__(self, name: str, value: Any) -> None:
        setattr(sys, name, value)


def _checked(real: Callable[..., Any], paths: int) -> Callable[..., Any]:
    def call(*args: Any, **kwargs: Any) -> Any:
        refuse_open(*args[:paths])
        if paths == 2:
            refuse_name(args[1])
        return real(*args, **kwargs)

    return call


def run_children_here(folder: Path) -> None:
    """Let the processes that the program starts run under the stand-in, too: `sys.executable` is a script that does."""
    script = folder / "python-under-windows-rules"
    script.write_text(f'#!/bin/sh\nexec "{sys.executable}" -m {__spec__.name} {CHILD} "$@"\n', encoding="utf-8")
    script.chmod(0o700)
    sys.executable = str(script)


if __name__ == "__main__":
    if sys.argv[1:2] == [CHILD]:
        install()
        _, _, *arguments = [word for word in sys.argv if word != "-P"]
        sys.argv = arguments[1:]
        runpy.run_module(arguments[1], run_name="__main__", alter_sys=True)
        sys.exit(0)
    children = tempfile.TemporaryDirectory(prefix="stand-in-")
    run_children_here(Path(children.name))
    install()
    from app.cli.main import main, prepare_console

    prepare_console()
    commands: list[list[str]] = [[]]
    for word in sys.argv[1:]:
        if word == THEN:
            commands.append([])
        else:
            commands[-1].append(word)
    for command in commands:
        print(">", *command, flush=True)
        if code := main(command):
            sys.exit(code)
