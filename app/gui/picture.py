"""A picture of the window as it stands."""

from pathlib import Path

from PySide6.QtWidgets import QWidget


def grab(window: QWidget, path: Path) -> Path:
    """Save what the window shows as PNG.

    Raises:
        OSError: the file cannot be written.
    """
    if not window.grab().save(str(path)):
        raise OSError(f"the picture {path} cannot be written")
    return path
