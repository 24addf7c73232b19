"""Aspects of the protocol `mass-resonance`."""

from protocols.base import Aspects


class MassResonanceAspects(Aspects):
    """Mass resonance beside its measurement."""


ASPECTS = MassResonanceAspects()
