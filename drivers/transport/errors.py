"""Link errors: translates exceptions of the transport libraries into `LinkError` with a remedy."""

import contextlib
from collections.abc import Iterator

from drivers.errors import LinkError


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
