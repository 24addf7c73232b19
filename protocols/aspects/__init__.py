"""Aspects of the built-in protocols: one module each, named as in `protocols.measurements`."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
