from .imported_run import ImportedPoints as ImportedPoints
from .importer import import_files as import_files
from .importer import read_table as read_table
from .importer import read_time as read_time
from .si_columns import ImportOptions as ImportOptions
