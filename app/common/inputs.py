"""What a person writes after an option, read: names of files and folders, of a specimen, a seed. argparse tells the rest."""

import argparse
from pathlib import Path

MAX_SPECIMEN_NAME_LENGTH = 200
"""Characters of a specimen's name; the name of its run file holds fewer, the file itself all of them."""


def path_argument(text: str) -> Path:
    """A file or folder that this system can have, there or not yet.

    Raises:
        argparse.ArgumentTypeError: no name at all, one that is too long, or one in a folder that may not be looked into.
    """
    if not text.strip():
        raise argparse.ArgumentTypeError("a name is missing")
    try:
        Path(text).exists()
    except OSError as error:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' cannot be used: {error.strerror or error}") from None
    except ValueError:  # an embedded null
        raise argparse.ArgumentTypeError(f"{text!r} is no name of a file") from None
    return Path(text)


def specimen_argument(text: str) -> str:
    """A specimen's name: a line of text.

    Raises:
        argparse.ArgumentTypeError: it is empty, longer than anybody reads, or has characters that cannot be shown.
    """
    name = text.strip()
    if not name or len(name) > MAX_SPECIMEN_NAME_LENGTH or not name.isprintable():
        raise argparse.ArgumentTypeError(
            f"{truncate_text(name)!r} is no name of a specimen; give up to {MAX_SPECIMEN_NAME_LENGTH} readable characters in one line"
        )
    return name


def seed_argument(text: str) -> int:
    """A seed of simulated noise: a whole number from 0 on.

    Raises:
        argparse.ArgumentTypeError: it is none.
    """
    try:
        number = int(text)
    except ValueError:
        number = -1
    if not 0 <= number < 2**63:
        raise argparse.ArgumentTypeError(f"'{truncate_text(text)}' is no seed; give a whole number from 0 on")
    return number


def truncate_text(text: str, max_length: int = 60) -> str:
    """The beginning of a long text, with dots."""
    return text if len(text) <= max_length else f"{text[:max_length]}..."
