"""Comparison of up to 20 runs: their curves in one relation, peaks, differences, saved views, pictures and exports."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
