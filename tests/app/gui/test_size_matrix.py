"""Every page at four screen sizes and four scale factors: nothing is cut, Stop, Pause and the state sign are whole."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.size_matrix import SCALES

pytestmark = pytest.mark.deep


@pytest.mark.parametrize("scale", SCALES)
def test_nothing_is_cut_and_stop_pause_and_state_are_whole(scale: float, tmp_path: Path) -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("QT_")}
    done = subprocess.run(
        [sys.executable, "-m", "tests.helpers.size_matrix", "--scale", f"{scale:g}"],
        env={**environment, "PYTHONPATH": str(Path(__file__).parents[3])},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, f"{done.stdout}\n{done.stderr[-2000:]}"
