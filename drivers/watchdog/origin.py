"""Version and folder of the running copy of the program, compared by program and watchdog."""

from pathlib import Path

PACKAGE_FOLDER = Path(__file__).resolve().parents[2]
"""Folder that holds the packages of this program."""

UNKNOWN_VERSION = "of an unknown version"
"""Version of a folder without installation."""


def version() -> str:
    """Return the installed version."""
    from importlib import metadata  # as slow as the rest of a start that does not ask for it

    try:
        return metadata.version("tactor-bench")
    except metadata.PackageNotFoundError:
        return UNKNOWN_VERSION


def describe_copy() -> str:
    """Return version and folder of this copy in one line."""
    return f"{version()} in {PACKAGE_FOLDER}"
