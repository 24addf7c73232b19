"""Commissioning: measures a driver's assumptions about its instrument at the amplifier's input, with high voltage off."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
