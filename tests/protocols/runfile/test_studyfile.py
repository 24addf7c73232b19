"""Study file: written in chunks, read back, in NeXus, never partial, never overwriting."""

import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from model.studies.parameter_study import Axis
from protocols.runfile import study_file as studyfile
from protocols.runfile.errors import StorageError
from protocols.runfile.study_file import StudyFileWriter, StudyHeader, StudyParameter, index_slices, read_study
from tests.helpers.texts import LETTERS, SIGNS, texts

HEADER = StudyHeader(
    "2 x fundamental of the centre over delta, frequency",
    "fundamental",
    "m",
    (Axis("delta", "", (0.0, 0.01, 0.02)), Axis("frequency", "Hz", (10.0, 20.0))),
    parameters=(StudyParameter("L", 2.2e-2, "m", "half length"),),
    description={"n": 7, "measure": "fundamental"},
)
VALUES = np.arange(6.0).reshape(3, 2)


def stored(path: Path, header: StudyHeader = HEADER, values: np.ndarray = VALUES) -> Path:
    with StudyFileWriter(path, header) as file:
        file.write(0, values.reshape(-1, values.shape[-1]))
    return path


names = texts(
    LETTERS + " _-", st.characters(categories=("Lu", "Ll", "Nd"), include_characters=" _-²µ"), min_size=1, max_size=12
)
units = texts(LETTERS + SIGNS, st.characters(exclude_categories=("Cs", "Cc")), max_size=8)
finite = st.floats(allow_nan=False)
complexes = st.complex_numbers(allow_nan=False)


@st.composite
def studies(draw: st.DrawFn) -> tuple[StudyHeader, np.ndarray, list[int]]:
    """A header, values for it, and where the blocks end."""
    signal, *axis_names = draw(st.lists(names, min_size=2, max_size=5, unique=True))
    axes = tuple(Axis(name, draw(units), tuple(draw(st.lists(finite, min_size=1, max_size=4)))) for name in axis_names)
    is_complex = draw(st.booleans())
    shape = tuple(len(axis.values) for axis in axes)
    values = draw(hnp.arrays(complex if is_complex else float, shape, elements=complexes if is_complex else finite))
    parameters = draw(
        st.lists(st.builds(StudyParameter, names, finite, units, units), max_size=3, unique_by=lambda p: p.name)
    )
    description = draw(st.dictionaries(units, st.one_of(st.integers(), texts(max_size=5), st.none()), max_size=3))
    header = StudyHeader(draw(units), signal, draw(units), axes, is_complex, tuple(parameters), description)
    sets = values.size // shape[-1]
    ends = sorted({sets, *draw(st.lists(st.integers(1, sets), max_size=4))})
    return header, values, ends


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(study=studies())
def test_any_study_in_any_chunks_comes_back(study: tuple[StudyHeader, np.ndarray, list[int]], tmp_path: Path) -> None:
    header, values, ends = study
    rows = values.reshape(-1, values.shape[-1])
    path = tmp_path / "study.h5"
    with StudyFileWriter(path, header) as file:
        for start, stop in zip([0, *ends], ends, strict=False):
            file.write(start, rows[start:stop])
    got = read_study(path)
    assert (got.title, got.signal, got.unit, got.axes) == (header.title, header.signal, header.unit, header.axes)
    assert got.values.dtype == values.dtype
    assert np.array_equal(got.values, values)
    assert sorted(got.parameters, key=lambda p: p.name) == sorted(header.parameters, key=lambda p: p.name)
    assert got.description == header.description


@given(shape=st.lists(st.integers(1, 4), max_size=4), data=st.data())
def test_boxes_are_the_flat_range_in_order(shape: list[int], data: st.DataObject) -> None:
    index = np.arange(np.prod(shape, dtype=int)).reshape(shape)
    start, stop = sorted(data.draw(st.tuples(*[st.integers(0, index.size)] * 2)))
    found = [index[box].ravel() for box in index_slices(start, stop, shape)]
    assert np.concatenate([[], *found]).tolist() == list(range(start, stop))
    assert len(found) <= max(2 * len(shape) - 1, 1)


def test_a_nexus_viewer_finds_its_way_to_the_plot(tmp_path: Path) -> None:
    with h5py.File(stored(tmp_path / "study.h5")) as file:
        entry = file[file.attrs["default"]]
        data = entry[entry.attrs["default"]]
        assert (entry.attrs["NX_class"], data.attrs["NX_class"]) == ("NXentry", "NXdata")
        signal = data[data.attrs["signal"]]
        assert signal.attrs["units"] == "m"
        assert [data[name].shape[0] for name in data.attrs["axes"]] == list(signal.shape)
        assert [data[name].attrs["units"] for name in data.attrs["axes"]] == ["", "Hz"]
        assert data.attrs["frequency_indices"].tolist() == [1]
        assert entry["parameters/L"][()] == 0.022
        assert entry["parameters/L"].attrs["units"] == "m"
        assert json.loads(entry["process/software"].asstr()[()]).keys() >= {"tactor-bench", "python", "numpy", "scipy"}


def test_an_interrupted_study_leaves_nothing_and_keeps_the_one_before(tmp_path: Path) -> None:
    path = stored(tmp_path / "study.h5")

    def interrupted() -> None:
        with StudyFileWriter(path, HEADER) as file:
            file.write(0, VALUES[:1] + 100)
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert [p.name for p in tmp_path.iterdir()] == ["study.h5"]
    assert np.array_equal(read_study(path).values, VALUES)


def test_a_run_is_never_overwritten_but_a_study_is(tmp_path: Path) -> None:
    run, text = tmp_path / "run.h5", tmp_path / "notes.txt"
    with h5py.File(run, "w") as file:
        file.attrs["format"] = "tactor-bench-run"
    text.write_text("mine")
    for path in (run, text):
        before = path.read_bytes()
        with pytest.raises(StorageError, match="exists and is not a study, so it is not overwritten"):
            StudyFileWriter(path, HEADER)
        assert path.read_bytes() == before
    stored(tmp_path / "study.h5")
    stored(tmp_path / "study.h5", values=VALUES + 1)
    assert read_study(tmp_path / "study.h5").values[0, 0] == 1


def test_what_cannot_be_stored_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(StorageError, match=re.escape(str(tmp_path / "none"))):
        StudyFileWriter(tmp_path / "none" / "x.h5", HEADER)
    same = StudyHeader("", "a", "m", (Axis("a", "Hz", (1.0,)),))
    with pytest.raises(StorageError, match="names that differ, not a, a"):
        StudyFileWriter(tmp_path / "x.h5", same)
    monkeypatch.setattr(studyfile, "RESERVE_BYTES", 10**18)
    with pytest.raises(StorageError, match="free some space, choose another folder, or vary less"):
        StudyFileWriter(tmp_path / "x.h5", HEADER)
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_study_is_told(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="cannot be read as a study"):
        read_study(tmp_path / "none.h5")
    path = stored(tmp_path / "study.h5")
    with h5py.File(path, "r+") as file:
        file.attrs["format_version"] = 99
    with pytest.raises(StorageError, match="written by a newer version of this program; update it"):
        read_study(path)
    with h5py.File(path, "r+") as file:
        file.attrs["format"] = "tactor-bench-run"
    with pytest.raises(StorageError, match="is not a study of this program"):
        read_study(path)
