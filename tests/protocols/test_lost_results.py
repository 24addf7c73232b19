"""A program that is killed between the end of a run and its results: the next start stores or disclaims them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from protocols.base import RunStatus
from protocols.rejudgement import complete_results
from protocols.runfile import writer
from protocols.runfile.reader import Run
from protocols.runfile.repair import RESULTS_LOST, needs_repair, repair_folder
from protocols.runfile.verify import FileState, verify_run
from tests.helpers.killed_writers import write_run

RUN = """
import os, sys
from pathlib import Path
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile import writer
from tests.helpers.simulated_bench import laboratory, run
if sys.argv[2] == "killed":
    writer.append_results = lambda *_, **__: os._exit(9)
steps = VoltageSteps(levels_v=(1.5, 3.5), repeats=2, rest_s=0.3, read_s=0.3, hold_s=0.5)
with laboratory() as lab:
    run(steps, Path(sys.argv[1]), lab)
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="programs cannot fork here")
def test_a_run_that_ended_without_its_results_says_so_and_is_not_touched_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tests.helpers.killed_writers.BLOCKS", 3)
    monkeypatch.setattr(writer, "append_results", lambda *_, **__: os._exit(0))
    if (child := os.fork()) == 0:
        write_run(tmp_path, os.open(os.devnull, os.O_WRONLY))
    os.waitpid(child, 0)
    (path,) = tmp_path.glob("*.h5")
    assert needs_repair(path)
    (sentence,) = repair_folder(tmp_path, complete_results)
    assert f"It had ended: {RESULTS_LOST}. They cannot be computed" in sentence
    with Run(path) as run:
        assert run.record.status is RunStatus.COMPLETED
        assert run.record.reason.endswith(f"; {RESULTS_LOST}")
    assert verify_run(path).state is FileState.GOOD
    assert list(tmp_path.iterdir()) == [path]
    assert list(repair_folder(tmp_path, complete_results)) == []


@pytest.mark.deep
def test_the_results_that_a_killed_program_had_not_stored_are_computed_from_the_points(tmp_path: Path) -> None:
    paths = {}
    for name in ("killed", "whole"):
        subprocess.run([sys.executable, "-c", RUN, str(tmp_path / name), name], check=name == "whole", timeout=120)
        (paths[name],) = (tmp_path / name).glob("*.h5")
    (sentence,) = repair_folder(tmp_path / "killed", complete_results)
    with Run(paths["killed"]) as killed, Run(paths["whole"]) as whole:
        assert "They are computed from its points now" in sentence
        assert f"; {RESULTS_LOST}; " in killed.record.reason
        assert [e.name for e in killed.record.estimates] == [e.name for e in whole.record.estimates]
        assert [e.value for e in killed.record.estimates] == pytest.approx([e.value for e in whole.record.estimates])
        assert killed.record.verdict.outcome is whole.record.verdict.outcome
    assert verify_run(paths["killed"]).state is FileState.GOOD
