"""Terminal front end of a session: progress bar, messages, and JSON events."""

import io
import json
import os
import sys
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TaskID, TextColumn
from rich.text import Text

from app.common import SEVERITY_STYLES, format_duration, format_point, outcome_severity, print_message
from app.session import PRESETS_MENU, BenchFollower, BenchOpened, BenchState, SessionEvent
from model import format_value, quantity_label
from protocols.base import (
    BlockDiscarded,
    BlockStored,
    PointMeasured,
    ProgressUpdated,
    PromptShown,
    RunEnded,
    RunStarted,
    ShutdownStarted,
    SpecimenMayBeLive,
    StopOffered,
    event_record,
    visible_text,
)

STILL_ON = "High voltage may still be on: switch it off at the amplifier before you touch anything."
"""Warning at the end of every run on a real bench."""


class StderrConsole(Console):
    """Standard error. A closed pipe (`... 2>&1 | head`) does not end the run; further output is discarded."""

    def __init__(self) -> None:
        super().__init__(stderr=True, highlight=False)

    def on_broken_pipe(self) -> None:
        self.quiet = True
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stderr.fileno())


class VoltsColumn(ProgressColumn):
    """Shows the bench's state and the measured volts."""

    def __init__(self, follower: BenchFollower) -> None:
        super().__init__()
        self._follower = follower

    def render(self, task: Task) -> Text:
        """Return state and volts as they are now, or at the end of a task that ended at rest; volts that are not present have their age."""
        if ended := task.fields.get("ended"):
            return Text(ended)
        strip = self._follower.strip()
        volts = strip.measured if strip.present else " ".join(filter(None, (strip.measured, f"({strip.caption})")))
        return Text(f"{strip.state.upper()} {volts}", "bold red" if strip.danger else "" if strip.present else "dim")


class ConsoleObserver:
    """Shows a run on a terminal: a progress bar, a line per point, and messages.

    A context manager that restores the terminal when it exits. Texts are printed as they are: a specimen named `[red]x`
    is not an instruction to the terminal.
    """

    def __init__(
        self, console: Console, key_help: str = "", simulated: bool = True, follower: BenchFollower | None = None
    ) -> None:
        """`key_help` names the keys of a run and is printed at its start; `simulated` holds until a bench opens."""
        self._key_help, self._follower = key_help, follower or BenchFollower()
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}", markup=False),
            VoltsColumn(self._follower),
            console=console,
            auto_refresh=console.is_terminal,  # elsewhere only the end is shown
            transient=False,
            expand=True,
        )
        self._task: TaskID | None = None
        self._simulated = simulated

    def __enter__(self) -> "ConsoleObserver":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def __call__(self, event: SessionEvent) -> None:
        lines = self._follower.follow(event)
        self._update_progress(event)
        match event:
            case BenchOpened(name, simulated, identities):
                self._simulated = simulated
                self._print((name, "bold"), ("  SIMULATED" if simulated else "", "bold red"))
                for role, identity in identities.items():
                    self._print(f"  {role}: {identity}")
            case RunStarted():
                self._print(f"writing {event.path}" + (f"; {self._key_help}" if self._key_help else ""))
            case PromptShown(_, prompt):
                self._print((f"> {prompt.text}", "bold yellow"))
            case PointMeasured(_, point):
                self._print(format_point(point))
            case SpecimenMayBeLive():
                self._print(("DANGER: ", "bold red"), (event.words, "bold"))
            case StopOffered(url):
                import segno

                code = io.StringIO()
                segno.make(url, micro=False).terminal(code, compact=True)
                self._print(f"{code.getvalue()}stop from a phone, this run only: {url}")
            case RunEnded():
                for estimate in event.estimates:
                    self._print(f"{quantity_label(estimate.name)}: {format_value(estimate)}")
                if not self._simulated:
                    self._print((STILL_ON, "bold yellow"))
                self._print((event.summary, SEVERITY_STYLES[outcome_severity(event.verdict.outcome)]))
            case _:
                for line in lines:
                    text = line.text.replace(PRESETS_MENU, "--set mains_shift_hz=3")
                    self._print((text, SEVERITY_STYLES[line.severity]))

    def _update_progress(self, event: SessionEvent) -> None:
        if isinstance(event, RunStarted):
            self._task = self._progress.add_task("arming", total=event.entries, left="")
        if self._task is None:
            return
        if isinstance(event, ProgressUpdated):
            left = f"{format_duration(event.left_s)} left" if event.done < event.entries else ""
            self._progress.update(self._task, completed=event.done, description=event.label, left=left)
        elif isinstance(event, ShutdownStarted | RunEnded):
            text = str(event.verdict.outcome) if isinstance(event, RunEnded) else "going to rest"
            strip = self._follower.strip()
            at_rest = isinstance(event, RunEnded) and strip.state is BenchState.AT_REST and strip.present
            ended = f"{strip.state.upper()} {strip.measured}" if at_rest else ""
            self._progress.update(self._task, description=text, left="", ended=ended)

    def _print(self, *parts: str | tuple[str, str]) -> None:
        styled = ((part, "") if isinstance(part, str) else part for part in parts)
        text = Text.assemble(*((visible_text(text_part, multiline=True), style) for text_part, style in styled))
        self._progress.console.print(text, soft_wrap=True)


class JsonObserver:
    """Prints every event except blocks as one JSON object per line, in SI units; and `BenchState` whenever that changes."""

    def __init__(self, follower: BenchFollower | None = None) -> None:
        self._reader_present, self._follower = True, follower or BenchFollower()
        self._shown = self._follower.state

    def __enter__(self) -> "JsonObserver":
        return self

    def __exit__(self, *_: object) -> None: ...

    def __call__(self, event: SessionEvent) -> None:
        self._follower.follow(event)
        if not isinstance(event, BlockStored | BlockDiscarded):
            self._print({"event": event.kind, **event_record(event)})
        before, self._shown = self._shown, self._follower.state
        if any(
            getattr(before, name) != getattr(self._shown, name) for name in ("bench_state", "danger", "instruments")
        ):
            self._print({"event": "BenchState", **event_record(self._follower.strip())})

    def _print(self, line: dict[str, Any]) -> None:
        if not self._reader_present:
            return
        try:
            sys.stdout.write(json.dumps(line, allow_nan=False) + "\n")
            sys.stdout.flush()
        except OSError as error:  # the reader has closed the pipe, or the disk is full
            self._reader_present = False
            print_message(f"standard output takes no more events ({error.strerror}); the run continues without them")
