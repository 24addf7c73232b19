"""Aspects of the protocol `membrane-series`."""

from protocols.base import Aspects


class MembraneSeriesAspects(Aspects):
    """Membrane series beside its measurement."""


ASPECTS = MembraneSeriesAspects()
