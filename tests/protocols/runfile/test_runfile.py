"""Run file: readable at every moment, no raw data lost, errors as sentences."""

import contextlib
import json
import os
import shutil
import subprocess
import sys
import threading
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import h5py
import numpy as np
import pytest
from annotated_types import Unit
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from app.archive.replay import load_run
from drivers.deadlines import Deadline, threads_left_behind
from drivers.drive_shapes import Sine
from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from protocols.base import (
    EntryStarted,
    EstimatedQuantity,
    Event,
    LogMessage,
    Quality,
    RestMeasured,
    RunStatus,
    SpecimenMounted,
)
from protocols.measurements.sine_dwell import SineDwell, SinePoint
from protocols.runfile.errors import StorageError
from protocols.runfile.reader import Run, RunReadError
from protocols.runfile.record import RunRecord
from protocols.runfile.writer import RunFileWriter, append_estimates, append_results
from tests.helpers.messages import assert_names
from tests.helpers.run_files import SCALES
from tests.helpers.simulated_bench import laboratory, run
from tests.helpers.texts import texts


@dataclass(frozen=True, slots=True)
class Spot:
    """A small point."""

    frequency: Annotated[float, Unit("Hz"), "frequency"]
    height: Annotated[float, Unit("m"), "height"]


SENSOR = LaserSensor("laser", 1e-4, 0.5, -10, 10, 1e-4, 0.01, "S1", "2026-01-01")
SCALE = Scale((1e-4, 3.2e-4, 2e-14, -3e-19))
RECORD = RunRecord(
    protocol="sine-dwell",
    title="Sine dwell of T 1/µ",
    specimen="T 1/µ",
    simulated=True,
    parameters={"x": 1},
    axes=("frequency", "height"),
    sensor=SENSOR,
    configuration={"name": "b"},
)


def test_a_disk_that_does_not_answer_ends_the_run_and_not_the_program(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    answer = threading.Event()
    file = new(tmp_path)
    monkeypatch.setattr(file._presence, "check", answer.wait)
    monkeypatch.setattr(Deadline.DISK, "seconds", 0.05)
    with pytest.raises(StorageError) as lost:
        file.append_event(LogMessage("during the silence"), 0.0)
    assert_names(str(lost.value), file.path)
    with pytest.raises(StorageError):
        file.finish(RunStatus.FAILED, "no answer")
    assert threads_left_behind() == [file.calls.name]
    answer.set()
    file.calls.join()
    monkeypatch.undo()
    file.calls.given_up = False
    file.calls.end()
    file.finish(RunStatus.FAILED, "no answer")


def new(folder: Path, record: RunRecord = RECORD) -> RunFileWriter:
    file = RunFileWriter.new(folder, record, Spot)
    file.start_stream(5000.0, (SCALE, SCALE))
    return file


def test_what_was_mounted_before_the_first_entry_is_the_set_up_of_the_run_and_a_later_mounting_is_not(
    tmp_path: Path,
) -> None:
    before, later = (SpecimenMounted("mass", f"2026-11-28T0{hour}:00:00+00:00") for hour in (1, 2))
    file = new(tmp_path)
    for event in (before, EntryStarted(0, "with the mass", ()), later):
        file.append_event(event, 0.0)
    file.finish(RunStatus.COMPLETED, "all points measured")
    with Run(file.path) as run:
        assert [each.time for each in run.mountings] == [before.time]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("runs")


@given(
    raw=hnp.arrays(np.int16, st.tuples(st.just(2), st.integers(1, 400))),
    text=texts(max_size=1500),
    quality=st.integers(0, 63),
)
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_what_is_written_is_read_back(folder: Path, raw: np.ndarray, text: str, quality: int) -> None:
    drive = Sine(123.456, 1.5, 2.5, 77)
    file = new(folder)
    file.append_block(Block(0, raw), 0.1)
    file.append_block(Block(raw.shape[1], raw[:, ::-1]), 0.2)
    file.append_event(LogMessage(text), 0.3)
    file.append_recording((1, raw.shape[1]), quality, drive)
    file.append_point(Spot(1.5, 2.5e-6))
    estimate = EstimatedQuantity("c0", 159.0, 0.5, "kg/(m s)", "here")
    file.finish(RunStatus.COMPLETED, "fine", [estimate])
    with Run(file.path) as run:
        both = np.concatenate([raw, raw[:, ::-1]], axis=1)
        assert np.array_equal(run.trace.read_raw("drive"), both[0])
        assert np.array_equal(run.trace.read_raw("displacement"), both[1])
        np.testing.assert_allclose(
            run.trace.displacement_m(), (SCALE.to_volts(both[1]) - 0.5) * 1e-4, rtol=0, atol=1e-12
        )
        (event,) = run.events()
        assert (event.time_s, event.kind, event.fields) == (0.3, "Noted", {"text": text})
        (recording,) = run.recordings()
        assert (recording.drive, recording.quality, recording.sensor_delay_s) == (drive, Quality(quality), 1e-4)
        assert run.points()["height"].tolist() == [2.5e-6]
        assert run.units() == {"frequency": "Hz", "height": "m", "entry": "1"}
        assert run.record.estimates == (estimate,)
        assert run.record.sensor == SENSOR
        assert run.record.specimen == "T 1/µ"
    file.path.unlink()


def test_results_are_read_in_the_order_in_which_they_were_written(tmp_path: Path) -> None:
    file = new(tmp_path)
    names = ("natural_frequency", "damping_ratio", "quality_factor", "interference_at_rest")
    file.finish(RunStatus.COMPLETED, "fine", [EstimatedQuantity(name, 1.0, 0.1, "1", "here") for name in names])
    with Run(file.path) as run:
        assert tuple(estimate.name for estimate in run.record.estimates) == names


@pytest.mark.deep
def test_it_can_be_read_while_it_is_written(tmp_path: Path) -> None:
    file = new(tmp_path)
    try:
        for k in range(2):
            file.append_block(Block(100 * k, np.full((2, 100), k, np.int16)), k)
            file.append_point(Spot(k, k))
            code = "import sys; from pathlib import Path; from protocols.runfile.reader import Run; r = Run(Path(sys.argv[1])); print(r.record.state, r.trace.sample_count, len(r.points()['height']))"
            seen = subprocess.run(
                [sys.executable, "-c", code, str(file.path)], capture_output=True, text=True, check=True
            )
            assert seen.stdout.split() == ["running", str(100 * (k + 1)), str(k + 1)]
    finally:
        file.finish(RunStatus.STOPPED, "")


WRITER = """
import sys, numpy as np
from pathlib import Path
from dataclasses import dataclass
from typing import Annotated
from annotated_types import Unit
from drivers.interfaces import Block, Scale
from drivers.sensors.laser_sensor import LaserSensor
from protocols.runfile.record import RunRecord
from protocols.runfile.writer import RunFileWriter
@dataclass
class Spot:
    frequency: Annotated[float, Unit("Hz"), "f"]
    height: Annotated[float, Unit("m"), "h"]
sensor, scale = LaserSensor("laser", 1e-4), Scale((0.0, 3e-4))
file = RunFileWriter.new(Path(sys.argv[1]), RunRecord(protocol="p", axes=("frequency", "height"), sensor=sensor), Spot)
file.start_stream(5000.0, (scale, scale))
print(file.path, flush=True)
for k in range(100000):
    file.append_block(Block(500 * k, np.full((2, 500), k % 1000, np.int16)), 0.1 * k)
    if k % 7 == 0:
        file.append_point(Spot(k, k))
    print(500 * (k + 1), flush=True)
"""


@pytest.mark.one_in(5)
@pytest.mark.parametrize("blocks", [85, 3, 44, 126, 167])
def test_a_killed_program_leaves_everything_it_had_acknowledged(blocks: int, tmp_path: Path) -> None:
    """`kill -9` at any moment: every acknowledged sample is there and right, the state says crashed."""
    writer = subprocess.Popen([sys.executable, "-c", WRITER, str(tmp_path)], stdout=subprocess.PIPE, text=True)
    assert writer.stdout is not None
    path = Path(writer.stdout.readline().strip())
    for _ in range(blocks):
        acknowledged = int(writer.stdout.readline())
    writer.kill()
    rest = writer.stdout.read().split()
    acknowledged = int(rest[-1]) if rest and rest[-1].isdigit() else acknowledged
    writer.wait()
    writer.stdout.close()
    with Run(path) as run:
        assert run.record.state == "crashed"
        assert run.record.status == RunStatus.RUNNING
        assert run.trace.sample_count >= acknowledged - 500  # the last number printed may be cut
        raw = run.trace.read_raw("displacement")
        assert np.array_equal(raw, (np.arange(len(raw)) // 500 % 1000).astype(np.int16))


LIMITED = """
import resource, signal, sys
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (200_000, 200_000))
from app.cli.main import entry
sys.argv = ["tactor-bench", "run", "sine-dwell", "--speed", "max", "--json", "--out", sys.argv[1]]
entry()
"""


@pytest.mark.deep
@pytest.mark.skipif(os.name == "nt", reason="file size limits are a POSIX thing")
def test_file_that_cannot_grow_fails_the_run_at_rest_and_keeps_data(tmp_path: Path) -> None:
    """The operating system refuses a write, the worst a disk can do to HDF5."""
    done = subprocess.run([sys.executable, "-c", LIMITED, str(tmp_path)], capture_output=True, text=True, timeout=180)
    assert done.returncode == 1, done.stderr
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    events = [each for each in lines if each["event"] != "BenchState"]  # it follows the events that change it
    assert events[-1]["event"] == "RunEnded"
    assert events[-1]["status"] == "failed"
    assert "cannot be written: File too large" in events[-1]["reason"]
    assert events[-2]["event"] == "AtRest"
    assert events[-2]["confirmed"]
    with Run(Path(events[-1]["path"])) as file:
        assert file.trace.sample_count > 5_000
        assert file.record.state in ("crashed", "failed")  # the status is written if that is still possible
        assert file.trace.drive_v().max() == pytest.approx(5, abs=0.01)


def test_a_disk_that_fills_up_is_noticed_in_time_to_close_in_order(tmp_path: Path, monkeypatch: Any) -> None:
    free = [300e6]

    def usage(folder: Path) -> Any:
        free[0] -= 4e6
        return shutil._ntuple_diskusage(1e9, 1e9 - free[0], free[0])  # type: ignore[attr-defined]

    monkeypatch.setattr(shutil, "disk_usage", usage)
    with laboratory() as lab:
        ran = run(SineDwell(), tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert str(tmp_path) in ran.reason
    assert_names(ran.reason, 28, "MB")
    with Run(ran.path) as file:
        assert file.record.status == RunStatus.FAILED
        assert len(file.points()["frequency"]) == len(ran.points) > 0


@pytest.mark.skipif(
    os.name == "nt" or (os.geteuid() == 0 and not Path("/proc").exists()), reason="needs a folder nobody may write"
)
def test_a_folder_that_cannot_be_written_is_a_sentence() -> None:
    with pytest.raises(StorageError, match=r"cannot be created: .*; choose another folder"):
        RunFileWriter.new(Path("/proc/nowhere"), RECORD, Spot)


def test_what_is_no_run_is_told_apart(tmp_path: Path) -> None:
    text, other, newer = tmp_path / "a.h5", tmp_path / "b.h5", tmp_path / "c.h5"
    text.write_text("hello")
    with h5py.File(other, "w") as file:
        file["x"] = 1
    with h5py.File(newer, "w") as file:
        file.attrs.update({"format": "tactor-bench-run", "format_version": 99})
    for path, says in (
        (tmp_path / "none.h5", "there is no file"),
        (text, "is no HDF5 file; give a run file"),
        (other, "not a run of this program"),
        (newer, "run format 99; this program reads up to 3: install a newer version"),
    ):
        with pytest.raises(RunReadError, match=says):
            Run(path)


class Once(SineDwell):
    """Identifies one quantity."""

    def estimates(self, points: Any) -> tuple[EstimatedQuantity, ...]:
        return (EstimatedQuantity("gain", 1.0, 0.1, "1", "the test"),)


class Unstorable(SineDwell):
    """Identifies something that no file can hold: a name that is not text."""

    def estimates(self, points: Any) -> tuple[EstimatedQuantity, ...]:
        return (EstimatedQuantity("gain \ud800", 1.0, 0.1, "1", "the test"),)


@pytest.mark.deep
def test_estimates_that_cannot_be_stored_are_reported_and_file_is_closed(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(Unstorable(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert "all points measured; the identified parameters could not be stored: " in ran.reason
    with Run(ran.path) as file:
        assert (file.record.state, file.record.reason) == (RunStatus.COMPLETED, ran.reason)
        assert len(file.points()["frequency"]) == 1


@pytest.mark.deep
def test_a_reader_that_holds_the_file_does_not_keep_the_estimates_out(tmp_path: Path) -> None:
    fcntl = pytest.importorskip("fcntl")
    kept: list[Any] = []

    def hold(event: Event) -> None:
        if isinstance(event, RestMeasured):
            kept.append(next(tmp_path.glob("*.h5")).open("rb"))
            fcntl.flock(kept[0], fcntl.LOCK_SH | fcntl.LOCK_NB)  # as a program does that has the file open to read it

    with laboratory() as lab:
        ran = run(Once(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path, lab, hold)
    kept[0].close()
    assert ran.reason == "all points measured"
    with Run(ran.path) as file:
        assert [estimate.value for estimate in file.record.estimates] == [1.0]


def test_two_runs_of_one_second_get_two_files(tmp_path: Path) -> None:
    files = [new(tmp_path) for _ in range(3)]
    assert len({file.path for file in files}) == 3
    assert all("T%201%2Fµ" in file.path.name for file in files)
    for file in files:
        file.finish(RunStatus.COMPLETED, "")


def test_analysis_is_appended_and_raw_data_stays_as_it_was(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100,)), tmp_path, lab)
    with Run(ran.path) as file:
        before = file.trace.read_raw("displacement").tobytes()
    with append_results(ran.path) as file:
        append_estimates(file, [EstimatedQuantity("quality_factor", 2.4, 0.1, "1", "by hand")])
    with Run(ran.path) as file:
        assert file.trace.read_raw("displacement").tobytes() == before
        assert [e.name for e in file.record.estimates] == ["quality_factor"]


@pytest.mark.deep
def test_groups_attributes_and_events_of_a_newer_version_are_ignored(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 160)), tmp_path, lab)
    with append_results(ran.path) as file:
        append_estimates(file, [EstimatedQuantity("quality_factor", 2.4, 0.1, "1", "by hand")])

    def read() -> tuple[Any, ...]:
        with Run(ran.path) as file:
            points = {name: column.tolist() for name, column in file.points().items()}
            curves = [(c.name, c.label, c.entry, sorted(axis.name for axis, _ in c.columns())) for c in file.series()]
            samples = [r.displacement_m.tobytes() for r in file.recordings()]
            state = (
                file.record.state,
                file.record.reason,
                file.units(),
                file.record.axes,
                file.record.point_count,
                file.entries(),
            )
            return points, curves, samples, file.record.estimates, state, [e.kind for e in file.events()]

    before = read()
    with h5py.File(ran.path, "r+") as file:
        entry = file["entry"]
        for group in (entry, entry["trace"], entry["points"], entry["instrument"]):
            group.attrs["checksum"] = "0" * 64
            group["operator"] = "A. N. Other"
            group.create_group("signature")["passed"] = True
        entry["estimates/quality_factor/systematic_error"] = 0.1
        events = entry["events"]
        events.resize((len(events) + 1,))
        events[-1] = (1.0, 0, b"VerdictGiven", b'{"passed": true}')
    after = read()
    assert after[:-1] == before[:-1]
    assert after[-1] == [*before[-1], "VerdictGiven"]
    assert load_run(ran.path).points


def test_a_nexus_viewer_finds_the_plot_and_every_number_its_unit(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 150)), tmp_path, lab)
    with h5py.File(ran.path, "r") as file:
        entry = file[file.attrs["default"]]
        assert entry.attrs["NX_class"] == "NXentry"
        data = entry[entry.attrs["default"]]
        assert data.attrs["NX_class"] == "NXdata"
        signal_name, (axis,) = data.attrs["signal"], data.attrs["axes"]
        assert data[signal_name].shape == data[axis].shape == data[f"{signal_name}_errors"].shape == (2,)
        assert data[signal_name].attrs["units"] == "m"
        trace = entry["trace"]
        scaled = {
            name: (trace[name][:] + trace[f"{name}_offset"][()]) * trace[f"{name}_scaling_factor"][()]  # NXdata
            for name in ("drive", "displacement")
        }
        assert trace["displacement_offset"].attrs["units"] == trace["displacement"].attrs["units"] == "counts"
        unitless = []
        numbers = (entry["points"], entry["trace"], entry["instrument/displacement_sensor"])
        for group in numbers:
            unitless += [d.name for d in group.values() if d.dtype.kind in "fi" and "units" not in d.attrs]
    assert unitless == []
    with Run(ran.path) as run_:
        np.testing.assert_allclose(scaled["displacement"], run_.trace.displacement_m(), rtol=0, atol=1e-9)
        np.testing.assert_allclose(scaled["drive"], run_.trace.drive_v(), rtol=0, atol=1e-5)
        assert run_.record.configuration["speed"] == "max"
        assert set(run_.points()) == {*SinePoint.__slots__, "entry"}


def test_everything_exists_before_the_first_volt(tmp_path: Path) -> None:
    """No object and no attribute is created while samples come in: that is what a kill damages."""
    with contextlib.closing(
        h5py.File(new(tmp_path, replace(RECORD, reference={"model": "any"})).path, "r", swmr=True)
    ) as file:
        names: list[Any] = []
        file.visit(names.append)
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100,)), tmp_path / "b", lab)
    with h5py.File(ran.path, "r") as file:
        after: list[Any] = []
        file.visit(after.append)
        kept = json.loads(file["entry/configuration"].asstr()[()])
    assert kept["amplifier"]["rest_v"] == 2.5
    top = {name for name in after if name.count("/") < 2} - {name for name in names if name.count("/") < 2}
    assert top <= {"entry/estimates", "entry/verdict_details", "entry/checksums"}


@dataclass(frozen=True)
class FlaggedSpot:
    frequency: Annotated[float, Unit("Hz"), "frequency"]
    height: Annotated[float, Unit("m"), "height"]
    quality: Annotated[int, Unit("1"), "flags"]


def test_superseded_point_keeps_its_other_flags(tmp_path: Path) -> None:
    file = RunFileWriter.new(tmp_path, RECORD, FlaggedSpot)
    file.append_point(FlaggedSpot(1.0, 2.0, int(Quality.UNSETTLED | Quality.SIMULATED)))
    file.flag_point(0, Quality.SUPERSEDED)
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run:
        assert Quality(int(run.points()["quality"][0])) == Quality.UNSETTLED | Quality.SIMULATED | Quality.SUPERSEDED


def test_run_of_another_computer_is_not_called_crashed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its process id means nothing here: it may still be measuring on a shared folder."""
    file = new(tmp_path)
    file.close_after_error()
    monkeypatch.setattr("protocols.runfile.reader.writer_is_alive", lambda *_: False)
    with Run(file.path) as run:
        assert run.record.crashed
    monkeypatch.setattr("socket.gethostname", lambda: "another-computer")
    with Run(file.path) as run:
        assert not run.record.crashed
        assert run.record.state == "running"


def test_columns_of_a_point_that_a_kill_cut_are_of_equal_length(tmp_path: Path) -> None:
    file = new(tmp_path)
    for k in range(3):
        file.append_point(Spot(k, 10.0 * k))
    file.finish(RunStatus.COMPLETED, "")
    with h5py.File(file.path, "r+") as plain:
        plain["entry/points/height"].resize((2,))
    with Run(file.path) as run:
        columns = run.points()
    assert {len(column) for column in columns.values()} == {2}
    assert (columns["frequency"].tolist(), columns["height"].tolist()) == ([0.0, 1.0], [0.0, 10.0])


def test_blocks_that_are_held_are_written_together_before_anything_that_follows_them(tmp_path: Path) -> None:
    file = RunFileWriter.new(tmp_path, RECORD, Spot, hold_s=1e9)
    file.start_stream(1000.0, SCALES)
    blocks = [np.full((2, 10), number, np.int16) for number in range(7)]

    def rows() -> int:
        with Run(file.path) as run:
            return run.trace.sample_count

    assert [file.append_block(Block(100 * i, raw), float(i)) for i, raw in enumerate(blocks[:3])] == [0, 10, 20]
    assert rows() == 10, "the first one is written at once"
    file.append_event(LogMessage("something"), 2.5)
    assert rows() == 30
    file.append_block(Block(300, blocks[3]), 3.0)
    file.append_block(Block(400, blocks[4]), 4.0)
    np.testing.assert_array_equal(file.read_raw("drive", (30, 50)), [3] * 10 + [4] * 10)
    file.append_block(Block(500, blocks[5]), 5.0)
    file.append_point(Spot(100.0, 1e-6))
    assert rows() == 60
    file.append_block(Block(600, blocks[6]), 6.0)
    file.finish(RunStatus.COMPLETED, "")
    with Run(file.path) as run:
        np.testing.assert_array_equal(run.trace.read_raw("displacement"), np.concatenate([raw[1] for raw in blocks]))
        np.testing.assert_allclose(run.trace.times_of_rows(range(5, 70, 10)), 0.005 + 0.1 * np.arange(7))
