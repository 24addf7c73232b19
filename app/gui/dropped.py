"""Run files dragged over a page."""

from pathlib import Path

from PySide6.QtGui import QDropEvent


def run_urls(event: QDropEvent) -> list[Path]:
    """Run files that are dragged over a page."""
    paths = [Path(url.toLocalFile()) for url in event.mimeData().urls() if url.isLocalFile()]
    return [path for path in paths if path.suffix == ".h5"]
