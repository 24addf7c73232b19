"""Aspects of the protocol `sine-dwell`."""

from protocols.base import Aspects


class SineDwellAspects(Aspects):
    """Sine dwell beside its measurement."""


ASPECTS = SineDwellAspects()
