"""Entry point of the desktop build: the command line, and the Python of the processes that the program starts.

Watchdog, simulated bench and report run as processes of `sys.executable` with `-P -m MODULE` or `-c CODE`. In a frozen program that is
the program itself, which has no such options.
"""

import multiprocessing
import runpy
import sys


def run_as_python(arguments: list[str]) -> None:
    """Run `-m MODULE ...` or `-c CODE ...` in this process, as Python would."""
    option, what, *rest = arguments
    sys.argv = [what if option == "-m" else "-c", *rest]
    if option == "-m":
        runpy.run_module(what, run_name="__main__", alter_sys=True)
    else:
        exec(compile(what, "<string>", "exec"), {"__name__": "__main__"})  # noqa: S102 - code of this program


def main() -> None:
    """Run the command line, or what a process of this program was started for."""
    multiprocessing.freeze_support()
    arguments = [argument for argument in sys.argv[1:2] if argument != "-P"] + sys.argv[2:]
    if arguments[:1] in (["-m"], ["-c"]):
        run_as_python(arguments)
        return
    from app.cli.main import entry

    entry()


if __name__ == "__main__":
    main()
