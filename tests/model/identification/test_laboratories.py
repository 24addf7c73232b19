"""Laboratories whose ruler, scale, laser and amplifier are slightly wrong: total uncertainties hold, statistical ones do not."""

from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).resolve().parents[3] / "benchmarks"
LABORATORIES = 24


@pytest.mark.deep
def test_total_uncertainties_hold_where_every_instrument_is_slightly_wrong(monkeypatch: pytest.MonkeyPatch) -> None:
    """A sample of benchmarks/laboratories.py."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    script = import_module("laboratories")
    found = [script.laboratory(seed) for seed in range(LABORATORIES)]
    rows = [each[name] for each in found for name in script.IDENTIFIED]
    total = np.array([row["deviation"] / row["total"] for row in rows])
    statistical = np.array([row["deviation"] / row["statistical"] for row in rows])
    assert np.sqrt(np.mean(total**2)) == pytest.approx(1.0, abs=0.3)
    assert np.mean(abs(total) < 1.96) > 0.88
    assert np.mean(abs(statistical) < 1.96) < 0.8
    k2 = [each["k2"] for each in found]
    assert np.mean([row["total"] / row["statistical"] for row in k2]) > 3  # points alone do not tell k2
