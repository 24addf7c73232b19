"""Read-only web page of the window's state, for a phone or a second screen."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
