"""Attribution of a joint fit's misfit to causes outside the model."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
