"""The command line; its import removes the working directory from the module search path."""

import sys
from pathlib import Path

PACKAGES = str(Path(__file__).resolve().parents[2])  # the folder of `app`, `drivers`, ...


def forget_working_directory() -> None:
    """Take the working directory out of the imports of this process.

    An absolute path in PYTHONPATH remains, even the working directory: it was given on purpose.
    """
    kept = [entry for entry in sys.path if Path(entry).is_absolute()]
    if not sys.flags.safe_path and kept[:1] == [str(Path.cwd())] == sys.path[:1]:  # `python -m` puts it there
        del kept[0]
    if PACKAGES not in kept:
        kept.insert(0, PACKAGES)
    sys.path[:] = kept


forget_working_directory()  # here, because the modules of the command line import other packages
