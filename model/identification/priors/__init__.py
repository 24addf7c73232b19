"""Prior distributions: usual effects and assumed parameters of a fit, and priors next to a physical limit."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
