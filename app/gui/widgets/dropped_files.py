"""Run files, and tables that can become some, dragged over a page."""

from pathlib import Path

from PySide6.QtGui import QDropEvent

TABLES = frozenset({".csv", ".tsv", ".txt", ".dat", ".mat"})


def run_urls(event: QDropEvent) -> list[Path]:
    """Run files that are dragged over a page."""
    return [path for path in _paths(event) if path.suffix == ".h5"]


def table_urls(event: QDropEvent) -> list[Path]:
    """Tables that are dragged over a page."""
    return [path for path in _paths(event) if path.suffix.lower() in TABLES]


def _paths(event: QDropEvent) -> list[Path]:
    return [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
