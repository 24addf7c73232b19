"""Bench errors: one family of exceptions whose message is shown to the operator.

The message names the instrument, the value, the limit and the remedy. Only the front ends print it.
"""


class BenchError(Exception):
    """A problem on the bench; `str(error)` is the message to the operator."""


class InstrumentError(BenchError):
    """An instrument is absent, silent, or rejected a command."""


class LinkError(InstrumentError):
    """The link to an instrument failed: no reply, a broken reply, a closed connection."""


class AcquisitionError(InstrumentError):
    """The digitizer lost samples, was unplugged, or cannot do the requested acquisition."""


class ScansLostError(AcquisitionError):
    """The program read too late, and the digitizer's buffer was overwritten; the digitizer itself works."""


class CardInUseError(AcquisitionError):
    """The digitizer is in use by another running program."""


class ScanOrderError(AcquisitionError):
    """The digitizer cannot convert a channel several times in a scan."""


class DriveRejectedError(BenchError):
    """A drive violates the drive limits. Nothing was sent to the source."""


def is_memory_short(error: BaseException) -> bool:
    """Whether an error says that there is not enough memory: for an array, a thread, or a library."""
    return isinstance(error, MemoryError) or any(
        words in str(error) for words in ("can't start new thread", "annot allocate memory", "failed to map segment")
    )


MEMORY_SHORT = "there is not enough memory; close other programs, or measure less at a time"


MANUAL_SHUTDOWN_INSTRUCTIONS = (
    "UNSAFE: rest could not be confirmed. The specimen may carry high voltage. By hand, now: switch the high voltage OFF "
    "at the amplifier itself; do not touch the specimen or the generator's cable before the amplifier's display reads 0 V"
)


class UnsafeError(BenchError):
    """Rest could not be confirmed by measurement. The message gives the manual steps."""
