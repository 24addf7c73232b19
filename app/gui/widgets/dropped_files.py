"""Run files, and tables that can become some, dragged over a page."""

from pathlib import Path

from PySide6.QtGui import QDropEvent

TABLE_SUFFIXES = frozenset({".csv", ".tsv", ".txt", ".dat", ".mat"})


def dropped_runs(event: QDropEvent) -> list[Path]:
    """Run files that are dragged over a page."""
    return [path for path in _paths(event) if path.suffix == ".h5"]


def dropped_tables(event: QDropEvent) -> list[Path]:
    """Tables that are dragged over a page."""
    return [path for path in _paths(event) if path.suffix.lower() in TABLE_SUFFIXES]


def _paths(event: QDropEvent) -> list[Path]:
    return [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
