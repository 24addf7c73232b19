"""Shared widgets: actions, layouts, forms, background work.

Each name is imported when it is first used, so that the package costs nothing at start-up.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
