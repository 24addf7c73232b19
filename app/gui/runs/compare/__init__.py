"""Comparison of runs in the window: plot, table of layers with cursor values, peaks, differences."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
