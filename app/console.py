"""The terminal as a front end: progress, sentences, prompts, and machine-readable output."""

import json
import sys
import threading

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TaskID, TextColumn

from app.session import BenchFailed, BenchOpened, Refused, SessionEvent
from app.words import duration, point_line, quantity
from protocols.events import (
    Answered,
    Armed,
    Asked,
    AtRest,
    BlockSeen,
    BlockTaken,
    GoingToRest,
    Noted,
    PointMeasured,
    Progressed,
    RunEnded,
    RunStarted,
    event_record,
)
from protocols.steps import Prompt


class ConsoleObserver:
    """Shows a run on a terminal: a bar that moves, a line per point, sentences for what matters.

    A context manager: leaving it puts the terminal back in order.
    """

    def __init__(self, console: Console) -> None:
        self._console = console
        self._progress = Progress(
            TextColumn("{task.description}", table_column=None),
            BarColumn(bar_width=None),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            transient=False,
            expand=True,
        )
        self._task: TaskID | None = None
        self._simulated = True

    def __enter__(self) -> "ConsoleObserver":
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    def __call__(self, event: SessionEvent) -> None:
        say = self._progress.console.print
        match event:
            case BenchOpened(name, simulated, identities):
                self._simulated = simulated
                say(f"[bold]{name}[/]" + ("  [bold red]SIMULATED[/]" if simulated else ""))
                for role, identity in identities.items():
                    say(f"  {role}: {identity}", highlight=False)
            case RunStarted():
                self._task = self._progress.add_task("arming", total=event.entries, left="")
                say(f"writing {event.path}", highlight=False, soft_wrap=True)
            case Armed():
                say("rest is measured at the amplifier's input; high voltage is on")
            case Asked(_, prompt):
                say(f"[bold yellow]> {prompt.text}[/]")
            case Answered(_, words):
                say(f"  {words}")
            case Noted(text):
                say(text)
            case PointMeasured(_, point):
                say(point_line(point), highlight=False)
            case Progressed() if self._task is not None:
                left = f"{duration(event.left_s)} left" if event.done < event.entries else ""
                self._progress.update(self._task, completed=event.done, description=event.label, left=left)
            case GoingToRest() if self._task is not None:
                self._progress.update(self._task, description="going to rest", left="")
            case AtRest(confirmed, _, words):
                say(("[green]at rest:[/] " if confirmed else "[bold red]NOT AT REST:[/] ") + words, highlight=False)
            case RunEnded():
                for estimate in event.estimates:
                    value = quantity(estimate.value, estimate.standard_error, estimate.unit)
                    say(f"{estimate.name}: {value}", highlight=False)
                colour = (
                    "green" if event.status == "completed" else "bold red" if event.status == "unsafe" else "yellow"
                )
                if self._task is not None:
                    self._progress.update(self._task, description=str(event.status), left="")
                if not self._simulated:
                    say(
                        "[bold yellow]High voltage may still be on: switch it off at the amplifier before you touch anything.[/]"
                    )
                say(f"[{colour}]{event.status}[/]: {event.reason}", highlight=False, soft_wrap=True)
            case BenchFailed(words) | Refused(words):
                say(f"[bold red]error[/]: {words}", highlight=False, soft_wrap=True)


class JsonObserver:
    """Every event but the blocks as one JSON object a line, in SI units."""

    def __enter__(self) -> "JsonObserver":
        return self

    def __exit__(self, *_: object) -> None: ...

    def __call__(self, event: SessionEvent) -> None:
        if isinstance(event, BlockTaken | BlockSeen):
            return
        line = {"event": type(event).__name__, **event_record(event)}
        sys.stdout.write(json.dumps(line, default=str) + "\n")
        sys.stdout.flush()


class ConsoleOperator:
    """Prompts answered by Enter on a terminal. Reads in a thread, so that the card is emptied meanwhile."""

    def __init__(self) -> None:
        self._answers: dict[int, str] = {}

    def show(self, ask_id: int, _prompt: Prompt) -> None:
        threading.Thread(target=self._read, args=(ask_id,), name=f"prompt-{ask_id}", daemon=True).start()

    def answer(self, ask_id: int) -> str | None:
        return self._answers.pop(ask_id, None)

    def _read(self, ask_id: int) -> None:
        line = sys.stdin.readline()
        if line:  # an ended input is no answer: the run waits until it is stopped
            self._answers[ask_id] = line.strip() or "done"
