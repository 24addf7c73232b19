"""Web pages: the state of a running bench for a phone or a second screen, the stop of an unattended run, the catalogue of a folder of runs."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
