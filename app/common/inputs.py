"""Types of command-line arguments: paths, specimen names, seeds."""

import argparse
from pathlib import Path

MAX_SPECIMEN_NAME_LENGTH = 200
"""Characters of a specimen's name; the name of its run file is shortened, the file itself holds all of them."""


def path_argument(text: str) -> Path:
    """Return the path of a file or folder, existing or not.

    Raises:
        argparse.ArgumentTypeError: the name is empty, too long, or in an inaccessible folder.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError("a name is missing")
    try:
        Path(text).exists()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' cannot be used: {error.strerror or error}") from None
    except ValueError:  # an embedded null
        raise argparse.ArgumentTypeError(f"{text!r} is not the name of a file") from None
    return Path(text)


def specimen_argument(text: str) -> str:
    """Return a specimen's name: one line of text.

    Raises:
        argparse.ArgumentTypeError: it is empty, too long, or has unprintable characters.
    """
    name = text.strip()
    if not name or len(name) > MAX_SPECIMEN_NAME_LENGTH or not name.isprintable():
        raise argparse.ArgumentTypeError(
            f"{truncate_text(name)!r} is not a name of a specimen; give up to {MAX_SPECIMEN_NAME_LENGTH} readable characters in one line"
        )
    return name


def seed_argument(text: str) -> int:
    """Return a seed of simulated noise: an integer from 0.

    Raises:
        argparse.ArgumentTypeError: it is not one.
    """
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**63:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' is not a seed; give a whole number from 0 on")
    return number


def truncate_text(text: str, max_length: int = 60) -> str:
    """Return the beginning of a long text, with dots."""
    return text if len(text) <= max_length else f"{text[:max_length]}..."
