"""Exit codes of the program, by the verdict of a run, and its usage errors."""

from collections.abc import Iterator
from contextlib import contextmanager
from enum import IntEnum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from protocols.base import Outcome


class ExitCode(IntEnum):
    """Exit code of a command."""

    DONE = 0
    FAILED = 1
    USAGE = 2
    UNSAFE = 3
    """Rest could not be confirmed."""
    NO_RESULT = 4
    """The run was completed, but nothing usable was measured."""


def exit_code_of(outcome: "Outcome") -> ExitCode:
    """Return the exit code of a verdict."""
    from protocols.base import Outcome

    codes = {
        Outcome.GOOD: ExitCode.DONE,
        Outcome.DOUBTFUL: ExitCode.DONE,
        Outcome.NO_RESULT: ExitCode.NO_RESULT,
        Outcome.UNSAFE: ExitCode.UNSAFE,
    }
    return codes.get(outcome, ExitCode.FAILED)


class UsageError(Exception):
    """An argument of a command is invalid; the message names the value and the remedy."""


@contextmanager
def usage_errors(*kinds: type[Exception], about: str = "") -> Iterator[None]:
    """Raise UsageError with the message of an error of these kinds, prefixed with `about`; also a decorator."""
    try:
        yield
    except kinds as error:
        raise UsageError(f"{about}: {error}" if about else str(error)) from None
