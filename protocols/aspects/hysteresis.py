"""Aspects of the protocol `hysteresis`."""

from protocols.base import Aspects


class HysteresisAspects(Aspects):
    """Hysteresis beside its measurement."""


ASPECTS = HysteresisAspects()
