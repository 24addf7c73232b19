"""Runs as arrays: same numbers as h5py, same list as the command line."""

import json
import re
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import tactor_bench as tb
from app.cli.main import main
from protocols.base import Quality
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.sweep import Sweep
from tests.helpers.run_files import crashed_run, finished_run, newer_run
from tests.helpers.simulated_bench import laboratory, run


@pytest.fixture(scope="module")
def dwell(tmp_path_factory: pytest.TempPathFactory) -> Path:
    with laboratory() as lab:
        return run(SineDwell(frequencies_hz=(100, 130, 150, 160, 170, 200)), tmp_path_factory.mktemp("runs"), lab).path


def test_points_are_what_the_file_has(dwell: Path) -> None:
    points = tb.open_run(dwell).points
    with h5py.File(dwell) as file:
        group = file["entry/points"]
        assert set(points) == set(group)
        for name, data in group.items():
            np.testing.assert_array_equal(points[name], data[:])
            assert points.unit(name) == data.attrs["units"]
        np.testing.assert_array_equal(points.errors("fundamental"), group["fundamental_errors"][:])
    assert points.flags == (Quality.SIMULATED,) * 6
    assert points.usable.all()
    assert "6 rows of" in repr(points)
    assert f"frequency [{points.unit('frequency')}]" in repr(points)
    for ask in (points.unit, points.errors, points.__getitem__):
        with pytest.raises(KeyError, match=r"there is no column 'cheese.*; the columns are: .*frequency"):
            ask("cheese")


@pytest.mark.deep
def test_samples_are_the_counts_of_the_file_in_si_units(dwell: Path) -> None:
    opened = tb.open_run(dwell)
    with h5py.File(dwell) as file:
        trace, sensor = file["entry/trace"], file["entry/instrument/displacement_sensor"]

        def volts(name: str) -> Any:
            return np.polynomial.Polynomial(trace[f"{name}_scaling_coefficients"][:])(trace[name][:].astype(float))

        drive_v = volts("drive")
        displacement_m = (volts("displacement") - sensor["zero"][()]) * sensor["gain"][()]
        rate_hz, recordings = float(trace["sample_rate"][()]), file["entry/recordings"][:]
        row, scan = file["entry/blocks"]["row"], file["entry/blocks"]["scan"]
        begins_s = float(scan[0]) / rate_hz
        jumps = np.flatnonzero(np.diff(scan) != np.diff(row))
    whole = opened.trace()
    np.testing.assert_allclose(whole.drive_v, drive_v, rtol=1e-12)
    np.testing.assert_allclose(whole.displacement_m, displacement_m, rtol=1e-9, atol=1e-15)
    assert whole.time_s[0] == pytest.approx(begins_s)
    assert np.count_nonzero(np.diff(whole.time_s) > 1.5 / rate_hz) == len(jumps)
    assert (whole.rate_hz, opened.sample_rate_hz, len(whole)) == (rate_hz, rate_hz, len(drive_v))
    assert len(opened.traces) == len(recordings) == 6
    for samples, known in zip(opened.traces, recordings, strict=True):
        rows = slice(known["start_row"], known["stop_row"])
        np.testing.assert_array_equal(samples.drive_v, whole.drive_v[rows])
        np.testing.assert_array_equal(samples.displacement_m, whole.displacement_m[rows])
        np.testing.assert_array_equal(samples.time_s, whole.time_s[rows])
        assert samples.quality == Quality(int(known["quality"]))
    assert opened.traces[-1].entry == 5
    assert len(opened.traces[1:3]) == 2
    with pytest.raises(IndexError):
        _ = opened.traces[6]
    part = opened.trace(whole.time_s[100], whole.time_s[400])
    np.testing.assert_array_equal(part.time_s, whole.time_s[100:400])
    np.testing.assert_array_equal(part.displacement_m, whole.displacement_m[100:400])
    assert len(opened.trace(1e6)) == len(opened.trace(0.5, 0.1)) == 0


def test_the_rest_of_a_run_is_what_show_says(dwell: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["show", str(dwell), "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    with tb.open_run(dwell) as opened:
        assert (opened.protocol, opened.specimen, opened.status, opened.simulated, opened.reason) == tuple(
            shown[name] for name in ("protocol", "specimen", "state", "simulated", "reason")
        )
        assert opened.parameters == shown["parameters"]
        assert opened.software == shown["software"]
        assert opened.start_time == datetime.fromisoformat(shown["start_time"])
        assert opened.duration_s == shown["samples"] / shown["sample_rate_hz"]
        assert [(e.name, e.value, e.standard_error, e.unit) for e in opened.estimates.values()] == [
            (e["name"], e["value"], e["standard_error"], e["unit"]) for e in shown["estimates"]
        ]
        assert "natural_frequency: 15" in repr(opened.estimates)
        assert opened.log[-1].kind == "AtRest"
        assert opened.log[-1].fields["confirmed"]
        assert repr(opened).endswith("good, SIMULATED>")
        with pytest.raises(KeyError, match=r"there is no estimate of 'cheese'; there are: .*natural_frequency"):
            _ = opened.estimates["cheese"]


@pytest.mark.deep
def test_curves_are_tables(tmp_path: Path) -> None:
    with laboratory() as lab:
        path = run(Sweep(), tmp_path, lab).path
    (curve, *_) = tb.open_run(path).series
    with h5py.File(path) as file:
        group = next(iter(file["entry/curves"].values()))
        assert (curve.x, curve.y) == (group.attrs["axes"][0], group.attrs["signal"])
        for name in curve:
            np.testing.assert_allclose(curve[name], group[name][:], rtol=1e-14)
            assert curve.unit(name) == group[name].attrs["units"]


def test_nothing_keeps_the_file(dwell: Path, tmp_path: Path) -> None:
    path = finished_run(tmp_path)
    opened = tb.open_run(path)
    frequencies = opened.points["frequency"]
    with h5py.File(path, "r+") as file:  # would be refused while a reader has it
        file["entry/points/frequency"][0] = 101.0
    assert frequencies[0] == opened.points["frequency"][0] == 100.0
    assert tb.open_run(path).points["frequency"][0] == 101.0
    opened.close()
    assert opened.points["frequency"][0] == 101.0
    path.unlink()
    assert opened.points["frequency"][0] == 101.0
    with pytest.raises(tb.RunReadError, match=re.escape(str(path))):
        opened.trace()


def test_a_file_that_the_notebook_has_open_itself_is_read_all_the_same(dwell: Path) -> None:
    with h5py.File(dwell) as file:
        np.testing.assert_array_equal(tb.open_run(dwell).points["frequency"], file["entry/points/frequency"][:])
    assert tb.open_run(dwell).status == "completed"


def test_what_a_crash_left_is_readable(tmp_path: Path) -> None:
    opened = tb.open_run(crashed_run(tmp_path))
    assert opened.status == "crashed"
    assert opened.points["frequency"].tolist() == [100.0]


def test_what_is_no_run_is_a_sentence(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("no run")
    for path, words in (
        (tmp_path / "gone.h5", "there is no file"),
        (tmp_path / "notes.txt", "is no HDF5 file"),
        (newer_run(tmp_path), "install a newer version"),
    ):
        with pytest.raises(tb.RunReadError, match=words):
            tb.open_run(path)


def test_a_frame_without_pandas_is_a_sentence_with_the_remedy(dwell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "pandas", None)
    for table in (tb.open_run(dwell).points, tb.open_run(dwell).estimates):
        with pytest.raises(ImportError, match=r"needs pandas.*'pip install pandas'.*run.points\['frequency'\]"):
            table.to_pandas()


def test_a_frame_has_a_column_for_each_number_of_a_point(dwell: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Against a stand-in: pandas is not among the test's packages."""

    class Frame:
        def __init__(self, columns: dict[str, Any]) -> None:
            self.columns, self.attrs = columns, dict[str, Any]()

        @classmethod
        def from_dict(cls, rows: dict[str, Any], orient: str, columns: list[str]) -> "Frame":
            assert orient == "index"
            return cls({name: [row[i] for row in rows.values()] for i, name in enumerate(columns)})

    monkeypatch.setitem(sys.modules, "pandas", type(sys)("pandas"))
    monkeypatch.setattr(sys.modules["pandas"], "DataFrame", Frame, raising=False)
    opened = tb.open_run(dwell)
    frame: Any = opened.points.to_pandas()
    assert all(column.shape == (6,) for column in frame.columns.values())
    np.testing.assert_array_equal(frame.columns["harmonics_2"], opened.points["harmonics"][:, 1])
    assert frame.attrs["units"]["harmonics_2"] == "m"
    values: Any = opened.estimates.to_pandas()
    assert values.columns["unit"] == [each.unit for each in opened.estimates.values()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("folder")
    finished_run(folder, "T7")
    finished_run(folder / "older", "T8")
    crashed_run(folder, "T3")
    newer_run(folder, "T5")
    return folder


@pytest.mark.parametrize(
    ("chosen", "options"),
    [
        ({}, []),
        ({"specimen": "T7"}, ["--specimen", "T7"]),
        ({"protocol": "sine-dwell", "status": "crashed"}, ["--protocol", "sine-dwell", "--status", "crashed"]),
        ({"since": "today", "search": "158.3"}, ["--since", "today", "--search", "158.3"]),
        ({"since": "2099-01"}, ["--since", "2099-01"]),
    ],
)
def test_runs_are_those_of_the_command_line(
    folder: Path, chosen: dict[str, str], options: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["runs", str(folder), "--json", *options]) == 0
    listed = json.loads(capsys.readouterr().out)
    found = tb.runs(folder, **chosen)
    assert [str(each.path) for each in found] == [each["path"] for each in listed]
    for mine, theirs in zip(found, listed, strict=True):
        assert (mine.status, mine.specimen, mine.points, mine.duration_s, mine.estimates_text) == tuple(
            theirs[name] for name in ("state", "specimen", "points", "duration_s", "found")
        )


def test_since_may_be_a_time_or_a_length_of_time(folder: Path) -> None:
    assert len(tb.runs(folder, since=timedelta(hours=1))) == len(tb.runs(folder, since=datetime(2020, 1, 1))) == 4
    assert tb.runs(folder, since=datetime.now(UTC) + timedelta(days=1)) == []
    (entry,) = tb.runs(folder, specimen="T7")
    assert entry.open().specimen == "T7"
    assert entry.start_time == entry.open().start_time


def test_a_folder_that_is_not_there_and_a_time_that_is_none_are_sentences(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=re.escape(str(tmp_path / "gone"))):
        tb.runs(tmp_path / "gone")
    with pytest.raises(ValueError, match="'soon' is not a date"):
        tb.runs(tmp_path, since="soon")
