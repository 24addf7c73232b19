"""Problem report (crash report): one zip file with log, errors, settings, versions, bench file and header of the last run, without measured data.

Home folder, login and computer name are replaced everywhere; the operator's name stays.
"""

import getpass
import json
import platform
import socket
import sys
import threading
import traceback
import zipfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib import metadata
from pathlib import Path
from typing import Any

from app.archive.description import run_record
from app.common import RecentErrors
from drivers import open_regular
from drivers.watchdog import version
from protocols.base import replacing, to_jsonable
from protocols.runfile import Run, RunReadError

MEASURED_MARK = "±"
"""Every measured value of a log line has it."""
LEFT_OUT = "(a line with measured values is left out)"
HEADER_FIELDS = (
    "protocol",
    "specimen",
    "state",
    "start_time",
    "simulated",
    "imported",
    "sample_rate_hz",
    "samples",
    "channels",
    "broken_on_purpose",
    "parameters",
    "requested",
    "software",
    "conditions",
)
"""Fields of a run's record without points, estimates, or the values of its verdict."""
SECRET_KEYS = ("token", "password")
MIN_REPLACED = 3
"""Smallest length of a replaced name: a shorter one is part of other words."""

CONTENTS = (
    "versions of the program, Python, its libraries and the operating system",
    "the log of this window, without points and results, and the warnings of the program",
    "errors of the program, and where its threads are now",
    "settings of the window, without the web page's token",
    "the bench file, and the parameters, instruments and state of the last run",
)
"""Contents of a report, for the person who sends it."""
NOT_IN = "It has no samples, points or results. Home folder, login and computer name are replaced; the operator's name and names of specimens stay."


@dataclass(frozen=True)
class ProblemFacts:
    """Facts of the front end.

    Attributes:
        comment: comment of the user.
        log: lines of the window's log.
        settings: of the window, as texts.
        bench: path of the bench file, or name of a simulated bench.
        run: file of the last run; None for the newest one of the folder.
        folder: of the runs.
    """

    comment: str = ""
    log: Sequence[str] = ()
    settings: Mapping[str, str] = field(default_factory=dict)
    bench: str = ""
    run: Path | None = None
    folder: Path = Path()


def write_problem_report(path: Path, facts: ProblemFacts, recent: RecentErrors) -> None:
    """Write a report; a file of the same name is replaced when the new one is complete.

    Raises:
        OSError: it cannot be written.
    """
    redact = make_redaction()
    settings = {name: value for name, value in facts.settings.items() if not _is_secret(name)}
    parts = {
        "comment.txt": facts.comment,
        "versions.txt": "\n".join(_versions()),
        "log.txt": "\n".join(LEFT_OUT if MEASURED_MARK in line else line for line in facts.log),
        "program_log.txt": "\n".join(LEFT_OUT if MEASURED_MARK in line else line for line in list(recent.records)),
        "errors.txt": "\n\n".join(recent.errors) or "none",
        "threads.txt": "\n\n".join(_threads()),
        "settings.json": json.dumps(settings, indent=1, ensure_ascii=False),
        "bench.toml": _bench_text(facts.bench),
        "last_run.json": _run_header(facts.run or _newest_run(facts.folder)),
    }
    with replacing(path) as scratch, zipfile.ZipFile(scratch, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, text in parts.items():
            archive.writestr(name, redact(text))


def make_redaction() -> Callable[[str], str]:
    """Return a function that replaces home folder, login and computer name in a text."""
    replaced = {str(Path.home()): "~", str(Path.home()).replace("\\", "\\\\"): "~"}
    with suppress(OSError, KeyError, ImportError):
        replaced[getpass.getuser()] = "<login>"
    replaced[socket.gethostname()] = "<computer>"
    names = sorted((name for name in replaced if len(name) >= MIN_REPLACED), key=len, reverse=True)

    def redact(text: str) -> str:
        for name in names:
            text = text.replace(name, replaced[name])
        return text

    return redact


def _is_secret(name: str) -> bool:
    return any(word in name.casefold() for word in SECRET_KEYS)


def _versions() -> Iterator[str]:
    yield f"tactor-bench {version()}"
    yield f"Python {sys.version}"
    yield f"{platform.system()} {platform.release()} {platform.machine()}"
    for name in sorted({each.metadata["Name"] or "" for each in metadata.distributions()} - {""}, key=str.casefold):
        with suppress(metadata.PackageNotFoundError):
            yield f"{name} {metadata.version(name)}"


def _threads() -> Iterator[str]:
    names = {thread.ident: thread.name for thread in threading.enumerate()}
    for ident, frame in sys._current_frames().items():  # noqa: SLF001 - documented, and there is no other way
        yield f"{names.get(ident, ident)}\n{''.join(traceback.format_stack(frame))}"


def _bench_text(bench: str) -> str:
    if not bench.endswith(".toml"):
        return f"# {bench}"
    try:
        with open_regular(Path(bench), "r", encoding="utf-8") as file:
            return str(file.read())
    except (OSError, ValueError) as error:
        return f"# {bench} cannot be read: {error}"


def _newest_run(folder: Path) -> Path | None:
    try:
        runs = [(path.stat().st_mtime_ns, path) for path in folder.glob("*.h5")]
    except OSError:
        return None
    return max(runs)[1] if runs else None


def _run_header(path: Path | None) -> str:
    if path is None:
        return "{}"
    record: dict[str, Any] = {"name": path.name}
    try:
        with Run(path) as run:
            whole = run_record(run)
            record |= {name: whole[name] for name in HEADER_FIELDS if name in whole}
            record["outcome"] = str(run.record.verdict.outcome)
            record["bench"] = run.record.configuration
    except (OSError, RunReadError, ValueError, KeyError) as error:
        record["problem"] = f"{type(error).__name__}: {error}"
    return json.dumps(to_jsonable(record), indent=1, ensure_ascii=False, default=str)
