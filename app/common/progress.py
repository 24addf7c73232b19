"""How far something long is, as a share from 0 to 1 that is told as it goes on; a bar where somebody reads it."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")
ProgressCallback = Callable[[float], None]
"""Told how far it is. It may raise `OperationCancelled`, and then it is over."""

ITEMS_PER_UPDATE = 1 << 14
"""Items between two tellings: some milliseconds."""


class OperationCancelled(Exception):
    """Whoever was told how far it is wants no more of it."""


def ignore_progress(_share: float) -> None:
    """Nobody asks."""


def partial_progress(progress: ProgressCallback, begin: float, end: float) -> ProgressCallback:
    """For a part of the whole, which tells its own share."""
    return lambda share: progress(begin + (end - begin) * share)


def split_progress(progress: ProgressCallback, sizes: Sequence[float]) -> list[ProgressCallback]:
    """For the parts of the whole one after the other, each as long as its size."""
    whole = sum(sizes) or 1.0
    return [
        partial_progress(progress, begin / whole, end / whole)
        for begin, end in pairwise(accumulate(sizes, initial=0.0))
    ]


def split_progress_by_files(progress: ProgressCallback, paths: Sequence[Path]) -> list[ProgressCallback]:
    """For files one after the other, by their bytes; one that is not there has none, and whoever opens it says so."""
    return split_progress(progress, [path.stat().st_size if path.is_file() else 0 for path in paths])


def iterate_with_progress(items: Sequence[T], progress: ProgressCallback) -> Iterator[T]:
    """The items, told as they are taken."""
    for start in range(0, len(items), ITEMS_PER_UPDATE):
        progress(start / len(items))
        yield from items[start : start + ITEMS_PER_UPDATE]
    progress(1.0)


@contextmanager
def terminal_progress(description: str, quiet: bool = False) -> Iterator[ProgressCallback]:
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
        task = progress.add_task(description, total=1.0)
        yield lambda share: progress.update(task, completed=share)
