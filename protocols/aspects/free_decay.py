"""Aspects of the protocol `free-decay`."""

from protocols.base import Aspects


class FreeDecayAspects(Aspects):
    """Free decay beside its measurement."""


ASPECTS = FreeDecayAspects()
