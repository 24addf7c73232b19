"""Version of the program, for `--version`, calibrations and reports."""

from drivers.watchdog.origin import version

__all__ = ["version"]
