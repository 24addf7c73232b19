"""Aspects of the protocol `sweep`."""

from protocols.base import Aspects


class SweepAspects(Aspects):
    """Sweep beside its measurement."""


ASPECTS = SweepAspects()
