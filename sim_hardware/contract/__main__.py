"""Deprecated command: `python -m sim_hardware.contract` is now `python -m sim_hardware.testing`."""

import sys
import warnings

from sim_hardware.testing.__main__ import main

if __name__ == "__main__":
    warnings.warn("'sim_hardware.contract' is deprecated; use 'sim_hardware.testing'", DeprecationWarning, stacklevel=1)
    sys.exit(main())
