"""Aspects of the protocol `latency`."""

from protocols.base import Aspects


class OnsetLatencyAspects(Aspects):
    """Latency beside its measurement."""


ASPECTS = OnsetLatencyAspects()
