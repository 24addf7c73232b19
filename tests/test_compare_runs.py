"""Comparison of recordings: finds differences, ignores what its tables name (tests/compare_runs.py)."""

import json
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from tests import compare_runs
from tests.compare_runs import Comparison

EVENTS = np.array([(0.5, b"Armed", b'{"high_voltage": true}')], [("time_s", "f8"), ("kind", "S24"), ("text", "S99")])


def recording(folder: Path, **changes: Any) -> Path:
    """A small recording, with some of its values changed."""
    folder.mkdir()
    told = {"level": 2.5, "unit": "V", "start_time": str(folder), "path": "runs/20261122T015919Z_T1.h5"} | changes
    (folder / "a.json").write_text(json.dumps(told))
    (folder / "a.csv").write_text(f"level [V],host\n{told['level']},{folder}\n")
    with h5py.File(folder / "a.h5", "w") as file:
        points = file.create_group("entry/points")
        points["level"] = np.array([1.0, told["level"]])
        points["level"].attrs["units"] = told["unit"]
        file["entry/host"] = str(folder)
        file["entry/parameters"] = json.dumps({"level": told["level"]})
        events = EVENTS if told["unit"] == "V" else EVENTS[:0]
        file.create_dataset("entry/events", data=events, maxshape=(None,), chunks=(8,))
    return folder


def differences(before: Path, after: Path) -> list[str]:
    comparison = Comparison()
    comparison.folders(before, after)
    return [difference.partition("\n")[0].replace("  ", " ") for difference in comparison.differences]


def test_clocks_and_computers_are_left_out(tmp_path: Path) -> None:
    before = recording(tmp_path / "before")
    assert not differences(before, recording(tmp_path / "after", path="runs/20270101T000000Z_T1.h5"))


def test_every_value_that_differs_is_named(tmp_path: Path) -> None:
    before = recording(tmp_path / "before")
    assert differences(before, recording(tmp_path / "after", level=np.nextafter(2.5, 3), unit="mV", more=1)) == [
        "a.csv row 2, level [V]",
        "a.h5 /entry/events",
        "a.h5 /entry/parameters[0]/level",
        "a.h5 /entry/points/level@units[0]",
        "a.h5 /entry/points/level[1], 1 in all",
        "a.json /level",
        "a.json /unit",
        "a.json /more",
    ]


def test_a_file_that_is_missing_is_named(tmp_path: Path) -> None:
    before, after = recording(tmp_path / "before"), recording(tmp_path / "after")
    (after / "a.csv").unlink()
    assert differences(before, after) == ["a.csv "]


def test_announced_names_are_looked_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before, after = recording(tmp_path / "before"), tmp_path / "after"
    after.mkdir()
    for name in ("a.csv", "a.json"):
        (after / name).write_text((before / name).read_text().replace("level", "plateau"))
    with h5py.File(before / "a.h5") as old, h5py.File(after / "a.h5", "w") as new:
        old.copy("entry", new)
        new.move("entry/points/level", "entry/points/plateau")
        del new["entry/parameters"]
        new["entry/parameters"] = json.dumps({"plateau": 2.5})
    monkeypatch.setattr(compare_runs, "RENAMED", {"level": "plateau", "level [V]": "plateau [V]"})
    assert not differences(before, after)
