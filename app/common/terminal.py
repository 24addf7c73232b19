"""Lines on standard output and standard error, with control characters of foreign text made visible, and long text shortened."""

import sys

from protocols.base import visible_text


def print_line(text: str) -> None:
    """Print a line on standard output."""
    sys.stdout.write(visible_text(text, multiline=True) + "\n")


def print_message(text: str) -> None:
    """Print a line on standard error."""
    sys.stderr.write(visible_text(text, multiline=True) + "\n")


def truncate_text(text: str, max_length: int = 60) -> str:
    """Return the beginning of a long text, with dots."""
    return text if len(text) <= max_length else f"{text[:max_length]}..."
