"""Aspects of the protocol `square-dwell`."""

from protocols.base import Aspects


class SquareDwellAspects(Aspects):
    """Square dwell beside its measurement."""


ASPECTS = SquareDwellAspects()
