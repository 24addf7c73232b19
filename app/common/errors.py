"""Exit codes and usage errors of the program."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum


class ExitCode(IntEnum):
    """Exit code of a command."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    UNSAFE = 3
    """Rest could not be confirmed."""
    NO_RESULT = 4
    """The run was completed, but nothing usable was measured."""


class UsageError(Exception):
    """An argument of a command is invalid; the message names the value and the remedy."""


@contextmanager
def usage_errors(*kinds: type[Exception], about: str = "") -> Iterator[None]:
    """Raise UsageError with the message of an error of these kinds, prefixed with `about`; also a decorator."""
    try:
        yield
    except kinds as error:
        raise UsageError(f"{about}: {error}" if about else str(error)) from None
