"""A run file that another program deletes, cuts, moves or detaches ends the run; what can be saved is saved."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from protocols.base import (
    BlockStored,
    Event,
    Outcome,
    PointMeasured,
    RestMeasured,
    RunEnded,
    RunStatus,
    ShutdownStarted,
)
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from protocols.runfile.verify import FileState, verify_run
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import Ran, laboratory, run

pytestmark = pytest.mark.skipif(os.name != "posix", reason="an open file cannot be moved or deleted there")

PROTOCOL = SineDwell(frequencies_hz=(100, 160, 200), record_s=0.05, min_cycles=5)


def run_and_break(folder: Path, hurt: Callable[[Path], object], protocol: SineDwell = PROTOCOL, points: int = 2) -> Ran:
    """Run the protocol; call `hurt` with the file after the first block that follows `points` points."""
    done: list[Event] = []
    broken: list[int] = []

    def watch(event: Event) -> None:
        done.append(event)
        if isinstance(event, BlockStored) and not broken and sum(isinstance(e, PointMeasured) for e in done) == points:
            broken.append(len(done))
            hurt(next(folder.glob("*.h5")))

    with laboratory() as lab:
        ran = run(protocol, folder, lab, watch)
    rest = [e for e in done if isinstance(e, RestMeasured)]
    assert [e.confirmed for e in rest] == [True]
    way_out = next(i for i, e in enumerate(done) if isinstance(e, ShutdownStarted))
    blocks = sum(isinstance(e, BlockStored) for e in done[broken[0] : way_out])
    assert blocks == 0, "noticed with the next block"
    assert ran.status == RunStatus.FAILED
    return ran


def test_deleted_run_file_ends_the_run_and_is_restored(tmp_path: Path) -> None:
    ran = run_and_break(tmp_path, Path.unlink)
    assert "was deleted while it was being written; the measured data are saved in" in ran.reason
    (file,) = tmp_path.glob("*.h5")
    assert ran.path == file
    with Run(file) as saved:
        assert (saved.record.state, saved.record.verdict.outcome, saved.record.point_count) == (
            "failed",
            Outcome.FAILED,
            2,
        )
        assert saved.record.reason == ran.reason
        assert saved.trace.sample_count > 1000
        assert any(e.kind == "AtRest" for e in saved.events())
        assert len(list(saved.recordings())) == 2


@pytest.mark.deep
def test_run_folder_that_was_deleted_is_restored_with_the_run(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    ran = run_and_break(folder, lambda path: shutil.rmtree(path.parent))
    assert "was deleted while it was being written" in ran.reason
    with Run(ran.path) as saved:
        assert (saved.record.state, saved.record.point_count) == ("failed", 2)


def test_moved_run_file_is_finished_where_it_is(tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere.h5"
    folder = tmp_path / "runs"
    ran = run_and_break(folder, lambda path: path.rename(moved))
    assert re.search(rf"{folder}\S+\.h5 .*moved.* {moved}\b.* {moved}$", ran.reason)
    assert ran.path == moved
    with Run(moved) as saved:
        assert (saved.record.state, saved.record.point_count) == ("failed", 2)
        assert saved.record.reason == ran.reason


@pytest.mark.deep
def test_folder_moved_as_a_detached_disk_is_found(tmp_path: Path) -> None:
    folder = tmp_path / "runs"
    folder.mkdir()
    ran = run_and_break(folder, lambda path: path.parent.rename(tmp_path / "gone"))
    assert ran.path.parent == tmp_path / "gone"
    with Run(ran.path) as saved:
        assert saved.record.point_count == 2


def test_points_and_events_of_a_cut_run_file_are_saved_in_another(tmp_path: Path) -> None:
    ran = run_and_break(tmp_path, lambda path: os.truncate(path, 5000))
    assert "to 5000 bytes while it was being written; the samples in it are lost; events, points" in ran.reason
    assert len(list(tmp_path.glob("*.h5"))) == 2
    with Run(ran.path) as saved:
        assert (saved.record.state, saved.record.point_count, saved.trace.sample_count) == ("failed", 2, 0)
        assert saved.points()["fundamental"].tolist() == [point.fundamental for point in ran.points]
        assert any(e.kind == "AtRest" for e in saved.events())


def overwrite(count: int) -> Callable[[Path], object]:
    def hurt(path: Path) -> None:
        with path.open("r+b") as file:
            file.write(b"\xa5" * count)

    return hurt


@pytest.mark.parametrize("count", [1, 4096])
def test_a_run_file_whose_beginning_is_overwritten_is_saved_with_its_samples(count: int, tmp_path: Path) -> None:
    ran = run_and_break(tmp_path, overwrite(count))
    assert_names(ran.reason, "overwritten", ran.path)
    assert len(list(tmp_path.glob("*.h5"))) == 2
    with Run(ran.path) as saved:
        assert (saved.record.state, saved.record.point_count) == ("failed", 2)
        assert saved.trace.sample_count > 1000
        assert len(list(saved.recordings())) == 2
    assert verify_run(ran.path).state is FileState.GOOD


def test_points_and_events_of_a_file_that_is_overwritten_further_are_saved(tmp_path: Path) -> None:
    ran = run_and_break(tmp_path, overwrite(60_000))
    assert_names(ran.reason, "overwritten", "events", ran.path)
    with Run(ran.path) as saved:
        assert (saved.record.state, saved.record.point_count, saved.trace.sample_count) == ("failed", 2, 0)
    assert len(list(tmp_path.glob("*.h5"))) == 2


@pytest.mark.deep
def test_file_lost_at_the_very_end_fails_the_run_and_keeps_its_estimates(tmp_path: Path) -> None:
    moved = tmp_path / "elsewhere.h5"
    folder = tmp_path / "runs"

    def move_at_the_end(event: Event) -> None:
        if isinstance(event, RestMeasured):
            next(folder.glob("*.h5")).rename(moved)

    with laboratory() as lab:
        ran = run(SineDwell(record_s=0.05, min_cycles=5), folder, lab, move_at_the_end)
    assert ran.status == RunStatus.FAILED
    with Run(moved) as saved:
        assert saved.record.estimates
        (ended,) = (e for e in ran.events if isinstance(e, RunEnded))
        assert {e.name: e for e in saved.record.estimates} == {e.name: e for e in ended.estimates}


REFUSED = """
import resource, signal, sys
from pathlib import Path
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
import tests.helpers.killed_writers as writers
from protocols.runfile.errors import StorageError
resource.setrlimit(resource.RLIMIT_FSIZE, (int(sys.argv[2]), int(sys.argv[2])))
try:
    writers.write_run(Path(sys.argv[1]), 1)
except StorageError as error:
    print("sentence:", error)
"""


@pytest.mark.parametrize("limit", [100_000, pytest.param(300_000, marks=pytest.mark.deep)])
def test_a_refused_write_prints_one_sentence_and_no_traceback_of_hdf5(limit: int, tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", REFUSED + LEAVE, str(tmp_path), str(limit)], capture_output=True, text=True, timeout=100
    )
    assert "sentence: the run file" in done.stdout
    assert "cannot be written: File too large" in done.stdout
    assert done.stderr == ""


LEAVE = """
import gc, os
gc.collect()
sys.stdout.flush()
os._exit(0)  # as the program does after such an error
"""
