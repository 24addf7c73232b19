"""Contract test command: `python -m sim_hardware.testing --source module:factory` (or `--digitizer`).

The factory is a context manager without arguments. For a source it yields (source, bench, clock), for a digitizer (digitizer,
bench), with the instrument connected to this `sim_hardware.bench.SimulatedBench`. Further arguments are passed to pytest.
docs/how-to-write-a-driver.md has an example.
"""

import argparse
import os
import sys
from collections.abc import Iterator
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

SUITE_FOLDER = Path(__file__).parent


def main(arguments: list[str] | None = None) -> int:
    """Run the suite; return pytest's exit code (0: the driver passes), or 2 for wrong arguments."""
    parser = argparse.ArgumentParser("python -m sim_hardware.testing", description="Run a contract suite on a driver.")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--source", metavar="MODULE:FACTORY", help="yields (source, bench, clock)")
    kind.add_argument("--digitizer", metavar="MODULE:FACTORY", help="yields (digitizer, bench)")
    chosen, rest = parser.parse_known_args(arguments)
    named = chosen.source or chosen.digitizer
    # The author's module is in the working directory, which must not shadow installed modules.
    sys.path[:] = [*(entry for entry in sys.path if entry not in ("", str(Path.cwd()))), str(Path.cwd())]
    try:
        factory = EntryPoint("factory", named, "contract").load()
    except (ImportError, AttributeError, ValueError) as error:
        parser.error(f"'{named}' cannot be loaded ({error}); give it as module:function, from the folder it is in")
    if not callable(factory):
        parser.error(f"'{named}' is not a function; give it as module:function")
    suite = SUITE_FOLDER / ("source_contract.py" if chosen.source else "digitizer_contract.py")
    try:
        import pytest
    except ModuleNotFoundError:
        parser.exit(
            2, "The contract suite runs on pytest, which is not installed; install it with: pip install pytest\n"
        )

    class FactoryPlugin:
        """A pytest plug-in whose fixture yields the author's device under test."""

        @pytest.fixture
        def device_under_test(self) -> Iterator[Any]:
            with factory() as device_under_test:
                yield device_under_test

    # No pytest configuration of the current folder: the contract is the same everywhere.
    options = ["-c", os.devnull, "--rootdir", str(SUITE_FOLDER), "--import-mode=importlib", "-p", "no:cacheprovider"]
    return int(pytest.main([*options, str(suite), *rest], plugins=[FactoryPlugin()]))


if __name__ == "__main__":
    sys.exit(main())
