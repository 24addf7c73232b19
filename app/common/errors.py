"""Exit codes and usage errors of the program."""

from enum import IntEnum


class ExitCode(IntEnum):
    """What a command returns to the shell."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    UNSAFE = 3
    """Rest could not be confirmed."""


class UsageError(Exception):
    """A command cannot use what it was given; the message names the value and the remedy."""
