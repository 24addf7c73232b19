from .catalogue import CatalogueServer as CatalogueServer
from .server import RemoteView as RemoteView
from .snapshot import Snapshot as Snapshot
from .snapshot import snapshot_record as snapshot_record
from .stop import PhoneStop as PhoneStop
from .web_server import WebServerError as WebServerError
