"""Version of the program."""

from importlib import metadata


def version() -> str:
    """Return the installed version, for `--version`, calibrations and reports."""
    try:
        return metadata.version("tactor-bench")
    except metadata.PackageNotFoundError:  # run from a folder that was never installed
        return "of an unknown version"
