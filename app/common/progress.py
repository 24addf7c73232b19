"""Progress and cancellation of long operations, and the progress bar of a terminal."""

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from itertools import accumulate, pairwise
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")

ITEMS_PER_UPDATE = 1 << 14
"""Items between two updates: some milliseconds."""


class OperationCancelled(Exception):
    """The caller cancelled the operation; nothing was written."""


class Progress:
    """Progress of a long operation: the operation reports how far it is and checks whether it is cancelled.

    This class itself ignores updates and is never cancelled; front ends override `update` and `cancelled`. Both may be
    used from any thread.
    """

    @property
    def cancelled(self) -> bool:
        """Whether the caller requested the operation to end."""
        return False

    def update(self, fraction: float, text: str = "") -> None:
        """Report the completed fraction, 0 to 1, and optionally the present activity."""

    def raise_if_cancelled(self) -> None:
        """Raise OperationCancelled if the operation is cancelled."""
        if self.cancelled:
            raise OperationCancelled

    def part(self, begin: float, end: float) -> "Progress":
        """Return the progress of a part, whose 0 to 1 is `begin` to `end` of the whole."""
        return _PartialProgress(self, begin, end)

    def split(self, sizes: Sequence[float]) -> list["Progress"]:
        """Return the progress of consecutive parts of these sizes."""
        whole = sum(sizes) or 1.0
        return [self.part(begin / whole, end / whole) for begin, end in pairwise(accumulate(sizes, initial=0.0))]

    def split_by_files(self, paths: Sequence[Path]) -> list["Progress"]:
        """Return the progress of one file after the other, weighted by their bytes; a missing file has none."""
        return self.split([path.stat().st_size if path.is_file() else 0 for path in paths])

    def iterate(self, items: Sequence[T], items_per_update: int = ITEMS_PER_UPDATE) -> Iterator[T]:
        """Yield the items and update as they are taken.

        Raises:
            OperationCancelled: the operation was cancelled between two items.
        """
        for start in range(0, len(items), items_per_update):
            self.update(start / len(items))
            self.raise_if_cancelled()
            yield from items[start : start + items_per_update]
        self.update(1.0)


class _PartialProgress(Progress):
    def __init__(self, whole: Progress, begin: float, end: float) -> None:
        self._whole, self._begin, self._end = whole, begin, end

    @property
    def cancelled(self) -> bool:
        return self._whole.cancelled

    def update(self, fraction: float, text: str = "") -> None:
        self._whole.update(self._begin + (self._end - self._begin) * fraction, text)


NO_PROGRESS = Progress()
"""Default of a parameter `progress`."""


@contextmanager
def terminal_progress(description: str, quiet: bool = False) -> Iterator[Progress]:
    """Show a bar with the remaining time on a terminal; nothing elsewhere, or if `quiet`."""
    if quiet or not (sys.stderr.isatty() or os.environ.get("FORCE_COLOR")):
        yield NO_PROGRESS  # the library of the bar takes a tenth of a second to load
        return
    from rich.console import Console
    from rich.progress import BarColumn, TaskProgressColumn, TextColumn, TimeRemainingColumn
    from rich.progress import Progress as ProgressBar

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(None),
        TaskProgressColumn(),
        TimeRemainingColumn(),
    )
    with ProgressBar(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(description, total=1.0)

        class TerminalProgress(Progress):
            def update(self, fraction: float, text: str = "") -> None:
                bar.update(task, completed=fraction, description=text or description)

        yield TerminalProgress()


def track(items: Sequence[T], description: str) -> Iterator[T]:
    """Yield the items and show a bar on a terminal."""
    with terminal_progress(description) as progress:
        yield from progress.iterate(items, items_per_update=1)
