from .server import RemoteView as RemoteView
from .snapshot import Snapshot as Snapshot
from .snapshot import snapshot_record as snapshot_record
