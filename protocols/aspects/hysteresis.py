"""Aspects of the protocol `hysteresis`: the usual ones."""

from protocols.base import Aspects

ASPECTS = Aspects()
