from .request import RunControl as RunControl
from .request import RunRequest as RunRequest
from .runner import PRELOADED_MODULES as PRELOADED_MODULES
from .runner import Runner as Runner
