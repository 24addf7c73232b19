"""Aspects of the protocol `membrane-sag`."""

from protocols.base import Aspects


class MembraneSagAspects(Aspects):
    """Membrane sag beside its measurement."""


ASPECTS = MembraneSagAspects()
