from .export import Format as Format
from .export import export_run as export_run
