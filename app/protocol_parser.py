"""The parsers of `tactor-bench protocols` and `resume`. What they run is imported when it runs."""

import argparse
from typing import Any

from app.arguments import path


def add_protocol_commands(known: Any, bench_options: Any) -> None:
    """Register the commands with the subparsers of the command; the options are those of `run`."""
    protocols = known.add_parser(
        "protocols",
        help="list what can be measured, and the parameters of each",
        description="The protocols of this program and of installed packages; with a name or a file, its parameters.",
        epilog="example: tactor-bench protocols sine-dwell",
    )
    protocols.add_argument("protocol", nargs="?", help="a protocol, or a lab's own file: ./my_protocol.py")
    protocols.add_argument("--json", action="store_true", help="as one JSON object on standard output")
    protocols.set_defaults(command=_protocols)

    resume = known.add_parser(
        "resume",
        help="go on with a run that was stopped or crashed, or measure some of its points again",
        description="Go on with a run that was stopped, failed or lost its program; or, with --again, measure some of its "
        "points once more. The result is a new file that carries the old points over and links to their raw data.",
        epilog="example: tactor-bench resume runs/20261121T091502Z_T7_sine-dwell.h5 --again 155,160",
    )
    resume.add_argument("run", type=path, metavar="RUN", help="a run file")
    resume.add_argument(
        "--again",
        default="",
        metavar="WHICH",
        help="entries by what they are called, e.g. 155,160 for frequencies; or 'flagged'",
    )
    resume.add_argument(
        "--protocol",
        dest="file",
        default="",
        metavar="FILE.py",
        help="the file of a lab's own protocol, where the run is of one",
    )
    bench_options(resume)
    resume.add_argument("--json", action="store_true", help="one JSON object per event on standard output, SI units")
    resume.set_defaults(command=_resume)


def _protocols(options: argparse.Namespace) -> int:
    from app.protocol_commands import list_protocols

    return list_protocols(options)


def _resume(options: argparse.Namespace) -> int:
    from app.protocol_commands import resume_run

    return resume_run(options)
