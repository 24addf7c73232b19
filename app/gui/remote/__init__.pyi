from .controller import RemoteController as RemoteController
from .setting import DESCRIPTION as DESCRIPTION
from .setting import RemoteSetting as RemoteSetting
