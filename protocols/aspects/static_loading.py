"""Aspects of the protocol `static-loading`."""

from protocols.base import Aspects


class StaticLoadingAspects(Aspects):
    """Static loading beside its measurement."""


ASPECTS = StaticLoadingAspects()
