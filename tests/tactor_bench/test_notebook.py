"""Notebook of the documentation: runs from top to bottom without Jupyter, and draws its figures."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
NOTEBOOK = ROOT / "docs" / "notebooks" / "first-run.ipynb"
LAST = """
for number in plt.get_fignums():
    plt.figure(number).savefig(f"figure{number}.png")
errors = np.hypot(points.errors("peak_to_peak"), at_points.peak_to_peak_band.standard_error)
inside = abs(points["peak_to_peak"] - at_points.peak_to_peak) < 3 * errors
print("inside:", sum(inside), "of", len(inside))
"""


@pytest.mark.deep
def test_every_cell_runs_and_the_points_are_on_the_band(tmp_path: Path) -> None:
    cells = json.loads(NOTEBOOK.read_text("utf-8"))["cells"]
    assert all(not cell["outputs"] and cell["execution_count"] is None for cell in cells if cell["cell_type"] == "code")
    code = "\n".join("".join(cell["source"]) for cell in cells if cell["cell_type"] == "code")
    done = subprocess.run(
        [sys.executable, "-W", "error", "-c", code + LAST],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT), "MPLBACKEND": "Agg"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "inside: 11 of 11" in done.stdout
    assert len(list((tmp_path / "runs").glob("*_T7_sine-dwell.h5"))) == 1
    assert all((tmp_path / f"figure{number}.png").stat().st_size > 5000 for number in (1, 2, 3))
