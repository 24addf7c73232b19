"""Run a contract suite on a driver: `python -m sim_hardware.testing --source module:factory` (or `--digitizer`).

The factory takes nothing and is a context manager. For a source it yields (source, bench, clock), for a digitizer
(digitizer, bench), the instrument being wired to that `sim_hardware.bench.SimulatedBench`. What else is given goes to
pytest. docs/how-to-write-a-driver.md has an example.
"""

import argparse
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from importlib.metadata import EntryPoint
from pathlib import Path
from typing import Any

import pytest

from drivers import deprecated
from drivers.interfaces import Digitizer, Source

SUITE_FOLDER = Path(__file__).parent


class FactoryPlugin:
    """A pytest plug-in that gives the suite what the author's factory makes."""

    def __init__(self, factory: Callable[[], AbstractContextManager[Any]]) -> None:
        self._factory = factory

    @pytest.fixture
    def made(self) -> Iterator[Any]:
        with self._factory() as made:
            deprecated.adapt_driver(type(made[0]), Source if len(made) == 3 else Digitizer)
            yield made


def main(arguments: list[str] | None = None) -> int:
    """Run the suite; the exit code is pytest's (0: the driver passes), 2 where it was asked wrongly."""
    parser = argparse.ArgumentParser("python -m sim_hardware.testing", description="Run a contract suite on a driver.")
    kind = parser.add_mutually_exclusive_group(required=True)
    kind.add_argument("--source", metavar="MODULE:FACTORY", help="yields (source, bench, clock)")
    kind.add_argument("--digitizer", metavar="MODULE:FACTORY", help="yields (digitizer, bench)")
    asked, rest = parser.parse_known_args(arguments)
    named = asked.source or asked.digitizer
    sys.path.insert(0, str(Path.cwd()))
    deprecated.install()
    try:
        factory = EntryPoint("factory", named, "contract").load()
    except (ImportError, AttributeError, ValueError) as error:
        parser.error(f"'{named}' cannot be loaded ({error}); give it as module:function, from the folder it is in")
    if not callable(factory):
        parser.error(f"'{named}' is no function; give it as module:function")
    suite = SUITE_FOLDER / ("source_contract.py" if asked.source else "digitizer_contract.py")
    # No configuration of whatever folder this happens in: the contract is the same everywhere.
    options = ["-c", os.devnull, "--rootdir", str(SUITE_FOLDER), "--import-mode=importlib", "-p", "no:cacheprovider"]
    return int(pytest.main([*options, str(suite), *rest], plugins=[FactoryPlugin(factory)]))


if __name__ == "__main__":
    sys.exit(main())
