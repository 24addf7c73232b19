"""Run files and tables of drag and drop events."""

from pathlib import Path

from PySide6.QtGui import QDropEvent

TABLE_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat", ".mat"})


def dropped_runs(event: QDropEvent) -> list[Path]:
    """Return the run files of a drag or drop event."""
    return [path for path in _paths(event) if path.suffix == ".h5"]


def dropped_tables(event: QDropEvent) -> list[Path]:
    """Return the tables of a drag or drop event."""
    return [path for path in _paths(event) if path.suffix.lower() in TABLE_SUFFIXES]


def _paths(event: QDropEvent) -> list[Path]:
    return [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
