"""Link errors: translates exceptions of the transport libraries, and passed deadlines, into `LinkError` with a remedy."""

import contextlib
import re
from collections.abc import Callable, Iterator
from typing import Any, Concatenate, ParamSpec, Protocol, TypeVar

from drivers.deadlines import CallThread, Deadline, OverdueError
from drivers.errors import LinkError

P = ParamSpec("P")
R = TypeVar("R")


class LinkWithDeadline(Protocol):
    """A link whose libraries are called in a thread of its own."""

    name: str
    timeout_s: float
    calls: CallThread


L = TypeVar("L", bound=LinkWithDeadline)


def within_deadline(
    deadline: Deadline = Deadline.SOURCE_CALL, bytes_s: Callable[[Any, Any], float] = lambda _link, _data: 0.0
) -> Callable[[Callable[Concatenate[L, P], R]], Callable[Concatenate[L, P], R]]:
    """Let a method of a link run in the link's thread; raise LinkError if it does not return in time.

    Args:
        deadline: beyond the link's timeout.
        bytes_s: returns how long the bytes of the link's first argument take.
    """

    def decorate(method: Callable[Concatenate[L, P], R]) -> Callable[Concatenate[L, P], R]:
        def call(self: L, /, *args: P.args, **kwargs: P.kwargs) -> R:
            seconds = deadline.seconds + self.timeout_s + (bytes_s(self, args[0]) if args else 0.0)
            try:
                return self.calls.call(lambda: method(self, *args, **kwargs), seconds)
            except OverdueError as error:
                raise LinkError(f"{self.name}: {error}; check the instrument's power and cable") from error

        call.__doc__ = method.__doc__
        return call

    return decorate


def reply_remedy(connection: str, query: str, answer: str) -> str:
    """Return what to do about a reply to a query that cannot be read, by its likely cause."""
    text = answer.strip()
    if "::5024::" in connection or "welcome" in text.lower() or text.endswith(">"):
        return f"{connection} is a port for typing (Telnet); use the port for programs, 5025"
    if text == query.strip():
        return f"{connection} repeats what it is sent; switch its echo off"
    if re.fullmatch(r"[+-]?\d+,\d+(E[+-]?\d+)?[A-Za-z%]*", text):
        return "it writes numbers with a decimal comma; set its number format to a decimal point"
    if re.match(r":?[A-Z]+(:[A-Z]+)* [^ ]", text):
        return "it repeats the header in its replies; switch response headers off"
    return f"check the cable at {connection}"


def silence_remedy(connection: str) -> str:
    """Return what to do about an instrument that does not answer, by its address."""
    if "::5024::" in connection:
        return "use the port for programs, 5025: port 5024 is for typing (Telnet)"
    if "::5555::" in connection:
        return "check the instrument's power and cable; a Rigol may not answer on LAN while its USB port is connected: unplug it"
    return "check the instrument's power and cable"


@contextlib.contextmanager
def translate_errors(name: str, remedy: str, kinds: tuple[type[Exception], ...] = (Exception,)) -> Iterator[None]:
    """Raise LinkError with connection, reason and remedy in place of an error of one of `kinds`."""
    try:
        yield
    except LinkError:
        raise
    except kinds as error:
        reason = getattr(error, "strerror", None) or str(error) or type(error).__name__
        raise LinkError(f"{name} cannot be reached ({reason}); {remedy}") from error
