"""What can go wrong on a bench: one family of errors, each a sentence for the person who stands before it.

The sentence names the instrument, the value, the limit and the remedy. Nothing below the command line prints it.
"""


class BenchError(Exception):
    """Something on the bench prevents the work; `str(error)` is what the operator reads."""


class InstrumentError(BenchError):
    """An instrument is absent, silent, or refused what it was told."""


class LinkError(InstrumentError):
    """The wire to an instrument failed: no answer, a broken answer, a closed connection."""


class AcquisitionError(InstrumentError):
    """The digitizer lost samples, was unplugged, or cannot do what was asked."""


class DriveRejectedError(BenchError):
    """The amplifier's guard refused a drive. Nothing was sent to the source."""


class UnsafeError(BenchError):
    """Rest could not be confirmed by measurement. The sentence says what to do by hand."""
