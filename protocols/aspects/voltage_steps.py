"""Aspects of the protocol `voltage-steps`."""

from protocols.base import Aspects


class VoltageStepsAspects(Aspects):
    """Voltage steps beside its measurement."""


ASPECTS = VoltageStepsAspects()
