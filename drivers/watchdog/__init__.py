"""The watchdog: a process that brings the bench to rest if the program is killed or hangs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
