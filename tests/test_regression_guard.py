"""Benchmarks: every one can be imported, and no short one is several times slower, beside its reference, than the committed table."""

import importlib
import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

from protocols.signals import sine

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS = ROOT / "benchmarks"
GUARD, TABLE = BENCHMARKS / "guard" / "regression.py", BENCHMARKS / "guard" / "ratios.toml"
ATTEMPTS = 3


@pytest.mark.deep
def test_every_benchmark_finds_the_names_of_the_product_that_it_uses() -> None:
    folders = (BENCHMARKS, GUARD.parent)
    names = [path.stem for folder in folders for path in sorted(folder.glob("*.py"))]
    code = f"import sys; sys.path[:0] = {[*map(str, folders), str(ROOT)]!r}; import {', '.join(names)}"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.deep
def test_no_ratio_is_several_times_that_of_the_table() -> None:
    """With a wider bound than the guard's own, because the computer and its load are not those of the table.

    A ratio counts as exceeded if it is in every attempt: another process may take the cache from one of both ways.
    """
    slower = {name for part in tomllib.loads(TABLE.read_text("utf-8")).values() for name in part}
    for _ in range(ATTEMPTS):
        only = [word for name in sorted(slower) for word in ("--only", name)]
        words = [sys.executable, str(GUARD), "--json", "--allowed", "2.5", *only]
        ran = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
        if ran.returncode == 2:
            pytest.skip(f"no table for the extras that are installed here: {ran.stderr}")
        assert ran.stdout, ran.stderr
        found = json.loads(ran.stdout)
        slower &= set(found["slower"])
        if not slower:
            return
    pytest.fail(f"slower than {GUARD.name} allows: {sorted(slower)}; {found['ratios']}")


@pytest.mark.deep
def test_a_planted_function_takes_longer_by_the_factor(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(GUARD.parent))
    regression = importlib.import_module("regression")
    now_s = 0.0

    def clock() -> float:
        nonlocal now_s
        now_s += 0.001
        return now_s

    def work() -> str:
        nonlocal now_s
        now_s += 0.5
        return "done"

    monkeypatch.setattr(regression, "thread_time", clock)
    monkeypatch.setattr(sine, "fit_sine", work)
    regression.plant("protocols.signals.sine:fit_sine", 3.0)
    assert sine.fit_sine() == "done"
    assert 1.5 <= now_s < 1.6
