"""Identification of the paper, one experiment after the other, with its errors and its difference to the joint fit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
