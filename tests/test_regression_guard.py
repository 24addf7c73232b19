"""Benchmarks: every one can be imported, and no short one is several times slower, beside its reference, than the committed table."""

import json
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
GUARD, TABLE = ROOT / "benchmarks" / "regression.py", ROOT / "benchmarks" / "ratios.toml"
ATTEMPTS = 3


@pytest.mark.deep
def test_every_benchmark_finds_the_names_of_the_product_that_it_uses() -> None:
    names = [path.stem for path in sorted(GUARD.parent.glob("*.py"))]
    code = f"import sys; sys.path[:0] = [{str(GUARD.parent)!r}, {str(ROOT)!r}]; import {', '.join(names)}"
    ran = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stderr


@pytest.mark.deep
def test_no_ratio_is_several_times_that_of_the_table() -> None:
    """A ratio counts as exceeded if it is in every attempt: another process may take the cache from one of both ways."""
    slower = set(tomllib.loads(TABLE.read_text("utf-8")))
    for _ in range(ATTEMPTS):
        ran = subprocess.run(
            [sys.executable, str(GUARD), "--json"], cwd=ROOT, capture_output=True, text=True, check=False
        )
        assert ran.stdout, ran.stderr
        found = json.loads(ran.stdout)
        assert found["ratios"].keys() == found["table"].keys()
        slower &= set(found["slower"])
        if not slower:
            return
    pytest.fail(f"slower than {GUARD.name} allows: {sorted(slower)}; {found['ratios']}")
