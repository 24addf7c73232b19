"""Import of a table by the command line: returns the run file or the error message."""

from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from protocols.runfile.reader import Run

FULL = ["--set", "peak_to_peak_v=5 V"]
GOOD = "frequency [Hz],pp [um]\n100,760\n150,1154\n"


def brought(path: Path, *arguments: str) -> Path:
    """The run file of an import."""
    out = path.parent / "runs"
    before = set(out.glob("*.h5"))
    assert main(["import", str(path), "--out", str(out), *arguments]) == 0
    (made,) = set(out.glob("*.h5")) - before
    return made


def points(path: Path) -> dict[str, np.ndarray]:
    with Run(path) as run:
        return run.points()


def refused(path: Path, capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    assert main(["import", str(path), "--out", str(path.parent / "runs"), *arguments]) == 2
    captured = capsys.readouterr()
    assert "Traceback" not in captured.err
    assert not list((path.parent / "runs").glob("*.h5"))
    return captured.err
