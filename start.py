"""Set Tactor Bench up on a fresh machine and run it: nothing but Python 3.11 or newer, pip and this folder are needed.

    python3 start.py              sets up, then the main job: the window with the simulated bench running a sine dwell;
                                  where there is no screen the same job with a progress bar, leaving a file and a picture
    python3 start.py test         sets up, then every check and the quick tests: three to four minutes
    python3 start.py test --all   the same with the deep tests: about half an hour
    python3 start.py docs         sets up, then makes the handbook for the browser in build/handbook; no network is needed for that
    python3 start.py desktop      sets up, then builds the program as one folder that needs no Python, in dist/tactor-bench
    python3 start.py ARGUMENTS    sets up, then the command `tactor-bench ARGUMENTS`

Everything goes into the folder .venv beside this file; delete it to undo.
"""

import hashlib
import importlib.util
import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
VENV = HERE / ".venv"
BIN = VENV / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")

CHECKS = (("ruff", "check", "."), ("ruff", "format", "--check", "."), ("lint-imports",))
TYPES = ("mypy",)
# Each worker takes its part of the tests in order, so that what a file measured is mostly shared, and steals at the end.
TESTS = ("pytest", "--dist", "worksteal")
ALL = "--all"
REPEATED_TESTS = 3
"""So many tests that fail beside others are repeated alone; more are no coincidence (docs/decisions/0161-repeated-tests.md)."""


def main(arguments: list[str]) -> int:
    if sys.version_info < (3, 11):
        return fail(
            f"Python 3.11 or newer is needed, this is {sys.version.split()[0]}; install it and run this again with it"
        )
    if arguments in (["--help"], ["-h"]):
        say((__doc__ or "").rstrip())
        return 0
    extra = arguments[0] if arguments[:1] in (["test"], ["docs"], ["desktop"]) else ""
    deep = extra == "test" and ALL in arguments
    try:
        set_up("test,docs" if deep else extra)
    except (subprocess.CalledProcessError, OSError) as error:
        return fail(f"the set-up failed: {error}; the lines above say why. Mend that and run this again")
    if extra == "docs":
        return make_handbook()
    if extra == "desktop":
        return subprocess.call([PYTHON, "-P", HERE / "desktop" / "build.py"])
    if extra == "test":
        provide_system_libraries(always=True)
        return run_checks([each for each in arguments[1:] if each != ALL], deep)
    if not arguments:
        provide_system_libraries(always=False)
    return subprocess.call([BIN / "tactor-bench", *(arguments or ["demo"])])


def set_up(extra: str) -> None:
    """Create .venv and install what is pinned; does nothing where that was done before."""
    wanted = hashlib.sha256(
        b"".join((HERE / name).read_bytes() for name in ("pyproject.toml", "constraints.txt")) + sys.version.encode()
    ).hexdigest()
    stamp = VENV / f"ready{'-' + extra if extra else ''}"
    if PYTHON.exists() and stamp.exists() and stamp.read_text() == wanted:
        return
    say("Setting up in .venv: this takes a minute or two, once.")
    pip = make_environment()
    package = f"{HERE}[{extra}]" if extra else str(HERE)
    install = [*pip, "install", "--quiet", "--disable-pip-version-check", "--constraint", HERE / "constraints.txt"]
    subprocess.run([*install, "--editable", package], check=True)
    stamp.write_text(wanted)


def make_environment() -> list[str | Path]:
    """A virtual environment, and the pip command that installs into it."""
    # Debian and Ubuntu split ensurepip off into a package of its own; their pip can then serve from outside.
    own_pip = importlib.util.find_spec("ensurepip") is not None
    if not PYTHON.exists():
        subprocess.run([sys.executable, "-P", "-m", "venv", *([] if own_pip else ["--without-pip"]), VENV], check=True)
    if own_pip or subprocess.call([PYTHON, "-P", "-c", "import pip"], stderr=subprocess.DEVNULL) == 0:
        return [PYTHON, "-P", "-m", "pip"]
    if importlib.util.find_spec("pip") is None:
        raise OSError("there is no pip; install it ('sudo apt-get install python3-pip' on Debian and Ubuntu)")
    return [sys.executable, "-P", "-m", "pip", "--python", PYTHON]


def provide_system_libraries(*, always: bool) -> None:
    """Install what Qt needs from the system where we may, else name it. Without a screen only the tests need it."""
    code = "from app.gui.display_check import has_screen, missing_libraries; print(has_screen(), *missing_libraries())"
    told = subprocess.run(
        [PYTHON, "-P", "-c", code], cwd=HERE, capture_output=True, text=True, check=False
    ).stdout.split()
    if not told or (told[0] != "True" and not always) or not told[1:]:
        return
    packages = told[1:]
    apt = shutil.which("apt-get")
    if apt and hasattr(os, "geteuid") and os.geteuid() == 0:
        say(f"Qt needs system libraries; installing {' '.join(packages)}.")
        subprocess.call([apt, "update", "-qq"])
        subprocess.call([apt, "install", "-y", "-qq", "--no-install-recommends", *packages], stdout=subprocess.DEVNULL)
    else:
        say(f"Qt needs system libraries that are missing here: sudo apt-get install {' '.join(packages)}")


def run_checks(arguments: list[str], deep: bool) -> int:
    """Run every check and say which failed; `arguments` go to pytest. Types are checked beside the others."""
    # Every worker would compile every test anew: a third of the time it takes to collect them.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    # Deep tests of safety wait for instruments and watchdogs most of the time: one worker more than cores uses it.
    workers = str((os.cpu_count() or 1) + deep)
    tests = (*TESTS, "-n", workers, *(("-m", "") if deep else ()), *arguments)
    failed = []
    with subprocess.Popen([BIN / TYPES[0]], cwd=HERE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT) as types:
        for check in (*CHECKS, tests):
            say(f"--- {' '.join(check)}".rstrip())
            code = subprocess.call([BIN / check[0], *check[1:]], cwd=HERE, env=environment)
            if code and not (check is tests and code == 1 and pass_alone(arguments, deep, environment)):
                failed.append(check[0])
        said, _ = types.communicate()
    say(f"--- {' '.join(TYPES)}\n{said.decode(errors='replace').rstrip()}")
    if types.returncode:
        failed.append(TYPES[0])
    say(f"--- failed: {', '.join(failed)}" if failed else "--- every check passed")
    return int(bool(failed))


def pass_alone(arguments: list[str], deep: bool, environment: dict[str, str]) -> bool:
    """Whether the few tests that failed beside others pass without them, on a computer that does nothing else."""
    names = list(json.loads((HERE / ".pytest_cache" / "v" / "cache" / "lastfailed").read_text()))
    if not 0 < len(names) <= REPEATED_TESTS:
        return False
    say(f"--- repeated alone, as they failed beside others: {' '.join(names)}")
    tests = (*TESTS[:1], "-n", "0", "--last-failed", *(("-m", "") if deep else ()), *arguments)
    return subprocess.call([BIN / tests[0], *tests[1:]], cwd=HERE, env=environment) == 0


def make_handbook() -> int:
    """The pages of docs/ as HTML. A link that leads nowhere is an error."""
    handbook = HERE / "build" / "handbook"
    code = subprocess.call([PYTHON, "-P", "-m", "sphinx", "-q", "-W", "--keep-going", HERE / "docs", handbook])
    if code == 0:
        say(f"The handbook: {handbook / 'index.html'}")
    return code


def say(text: str) -> None:
    print(text, flush=True)


def fail(text: str) -> int:
    sys.stderr.write(f"start.py: {text}\n")
    return 2


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
