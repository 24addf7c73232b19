"""Fixtures of all tests: no display, no user settings, no thread left behind."""

import gc
import math
import os
import threading
import time
from collections import defaultdict
from collections.abc import Iterator
from itertools import count
from pathlib import Path
from types import FunctionType
from zlib import crc32

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is there

from drivers.transport import lock
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.history_report import VoltageReport
from sim_hardware.service.process import BenchProcess
from tests.helpers.simulated_bench import assert_safe_voltage

os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")  # without it a GUI test aborts the interpreter


settings.register_profile("quick", max_examples=5, deadline=None)  # a busy computer is no failure
settings.register_profile("deep", max_examples=100, deadline=None)


def pytest_configure(config: pytest.Config) -> None:
    """Hypothesis tries five examples of everything where the deep tests are left out, and a hundred where they are not."""
    settings.load_profile("quick" if config.option.markexpr == "not deep" else "deep")
    gc.disable()  # a sixth of the time of the collection, which leaves no garbage


class _Backwards(pytest.Dir):
    """A folder whose tests are collected from the last to the first."""

    def collect(self) -> Iterator[pytest.Item | pytest.Collector]:
        return reversed(list(super().collect()))


def pytest_collect_directory(path: Path, parent: pytest.Collector) -> pytest.Dir | None:
    """Let every other worker collect from the end: each compiles half of the tests and reads the other half's cache."""
    second = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw")) % 2
    return _Backwards.from_parent(parent, path=path) if second else None


def pytest_pycollect_makeitem(collector: pytest.Collector, obj: object) -> list[pytest.Item] | None:
    """Make no items of functions that are deep as a whole, where deep tests are left out."""
    if collector.config.option.markexpr != "not deep" or not isinstance(obj, FunctionType):
        return None
    return [] if any(mark.name == "deep" for mark in getattr(obj, "pytestmark", ())) else None


TEST_NUMBERS = count(1)

QUICK_CASES = 2
"""Of more cases of a parametrised test than this, so many are quick; `one_in` chooses another share."""


@pytest.hookimpl(tryfirst=True)  # before deep tests are left out
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark as deep the cases that the quick tier leaves out, and let what waits for real wires and watchdogs begin first.

    At the end every worker would wait for it.
    """
    cases: defaultdict[tuple[Path, str], list[pytest.Item]] = defaultdict(list)
    for item in items:
        if item.get_closest_marker("deep") is None:
            cases[item.path, item.originalname].append(item)  # type: ignore[attr-defined]
    for (_, name), same in cases.items():
        marker = same[0].get_closest_marker("one_in")
        every = marker.args[0] if marker else max(len(same) / QUICK_CASES, 1)
        first = 0 if marker else crc32(name.encode()) % math.ceil(every)  # other cases of another function
        quick = {math.floor(first + every * k) % len(same) for k in range(math.ceil(len(same) / every))}
        for k, item in enumerate(same):
            if k not in quick:
                item.add_marker("deep")
    items.sort(key=lambda item: ("safety" not in item.path.parts, item.path.parts))  # the same for all workers


def pytest_collection_finish() -> None:
    """Let the garbage collector pass over what was collected: modules and tests, which stay until the end."""
    gc.collect()
    gc.freeze()
    gc.enable()


@pytest.fixture(autouse=True, scope="session")
def lock_folder_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Keep the locks of the tests apart from the computer's: a killed test would leave its instruments on record."""
    folder = tmp_path_factory.mktemp("locks") / "tactor-bench"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(lock, "lock_folder", lambda: folder)
        yield


@pytest.fixture(autouse=True, scope="session")
def user_folders_of_the_tests(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Keep settings, records and caches of the tests apart from the user's: a result must not depend on the computer."""
    folder = tmp_path_factory.mktemp("user")
    with pytest.MonkeyPatch.context() as patch:
        for name in ("CONFIG", "CACHE", "DATA", "STATE"):
            patch.setenv(f"XDG_{name}_HOME", str(folder / name.lower()))
        yield folder


@pytest.fixture(autouse=True)
def settings_of_the_test(user_folders_of_the_tests: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Let a test begin without the settings of another: an operator stated there would have measured the runs here."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(user_folders_of_the_tests / f"config-{next(TEST_NUMBERS)}"))


@pytest.fixture(autouse=True)
def no_thread_left_running() -> Iterator[None]:
    """Fail a test that leaves one of our threads running: it would also keep a generator playing."""
    before = set(threading.enumerate())
    yield
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        left = [t for t in threading.enumerate() if t not in before and not t.daemon]
        if not left:
            return
        left[0].join(0.05)
    raise AssertionError(f"the test left threads running: {[t.name for t in left]}")


@pytest.fixture(autouse=True)
def voltages_were_safe(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Check the voltages that reached the simulated amplifier, whatever the test was about.

    Tests that remove the drive on purpose have the marker `breaks_the_drive`.
    """
    if request.path.relative_to(Path(__file__).parent).parts[0] not in ("app", "protocols", "safety", "tactor_bench"):
        yield
        return
    benches: list[SimulatedBench] = []
    reports: list[VoltageReport] = []
    make, close = SimulatedBench.__init__, BenchProcess.close

    def made(self: SimulatedBench, *arguments: object, **named: object) -> None:
        make(self, *arguments, **named)  # type: ignore[arg-type]
        self.history.keeps_past = True
        benches.append(self)

    def closed(self: BenchProcess) -> None:
        if self._child.poll() is None and hasattr(self, "server"):
            reports.append(self.report())
        close(self)

    monkeypatch.setattr(SimulatedBench, "__init__", made)
    monkeypatch.setattr(BenchProcess, "close", closed)
    yield
    if request.node.get_closest_marker("breaks_the_drive") is None:
        for report in [*reports, *(bench.report() for bench in benches)]:
            assert_safe_voltage(report)
