"""Many runs in one notebook session and one window; `benchmarks/bench_endurance.py` prints what grows."""

import importlib.util
from pathlib import Path

import pytest

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "bench_endurance.py"


@pytest.mark.deep
@pytest.mark.parametrize(("part", "runs"), [("notebook", 24), ("window", 24), ("connections", 6)])
def test_threads_descriptors_processes_and_files_do_not_grow(part: str, runs: int) -> None:
    spec = importlib.util.spec_from_file_location("bench_endurance", SCRIPT)
    assert spec is not None
    assert spec.loader is not None
    benchmark = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(benchmark)
    grown = benchmark.measure(part, runs)
    del grown["MB"]  # its slope needs hundreds of runs
    assert max(grown["processes"], grown["files"]) <= 0, grown
    # A pool of threads may begin one more when it is busy; what leaks grows by 100 or more.
    assert max(grown.values()) < 50, grown
