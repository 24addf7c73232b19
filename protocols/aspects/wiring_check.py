"""Aspects of the protocol `wiring-check`."""

from protocols.base import Aspects


class WiringCheckAspects(Aspects):
    """Wiring check beside its measurement."""

    short_name = "wiring"


ASPECTS = WiringCheckAspects()
