"""Commissioning: measures at the amplifier's input what a driver assumes of its instrument, with high voltage off."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
