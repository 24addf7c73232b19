"""How far something long is, as a share from 0 to 1 that is told as it goes on; a bar where somebody reads it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
Tell = Callable[[float], None]
"""Told how far it is. It may raise `Stopped`, and then it is over."""

STEP = 1 << 14
"""Items between two tellings: some milliseconds."""


class Stopped(Exception):
    """Whoever was told how far it is wants no more of it."""


def untold(_share: float) -> None:
    """Nobody asks."""


def part(tell: Tell, begin: float, end: float) -> Tell:
    """For a part of the whole, which tells its own share."""
    return lambda share: tell(begin + (end - begin) * share)


def parts(tell: Tell, sizes: Sequence[float]) -> list[Tell]:
    """For the parts of the whole one after the other, each as long as its size."""
    whole = sum(sizes) or 1.0
    return [part(tell, begin / whole, end / whole) for begin, end in pairwise(accumulate(sizes, initial=0.0))]


def files(tell: Tell, paths: Sequence[Path]) -> list[Tell]:
    """For files one after the other, by their bytes; one that is not there has none, and whoever opens it says so."""
    return parts(tell, [path.stat().st_size if path.is_file() else 0 for path in paths])


def counted(items: Sequence[T], tell: Tell) -> Iterator[T]:
    """The items, told as they are taken."""
    for start in range(0, len(items), STEP):
        tell(start / len(items))
        yield from items[start : start + STEP]
    tell(1.0)


@contextmanager
def bar(words: str, quiet: bool = False) -> Iterator[Tell]:
    """A bar on a terminal, with the time that is left; nothing elsewhere, or where a machine listens (`quiet`)."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(None),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    disabled = quiet or not console.is_terminal
    with Progress(*columns, console=console, disable=disabled, transient=True) as progress:
        task = progress.add_task(words, total=1.0)
        yield lambda share: progress.update(task, completed=share)
