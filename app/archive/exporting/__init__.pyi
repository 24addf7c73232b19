from .export import Format as Format
from .export import export_run as export_run
from .export import raw_left_out as raw_left_out
from .parts import ExportedRun as ExportedRun
