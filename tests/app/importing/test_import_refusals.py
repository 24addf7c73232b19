"""Rejected tables: the message names the file, the place, the value and the remedy."""

from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from tests.helpers.importing import FULL, GOOD, refused
from tests.helpers.messages import assert_names
from tests.helpers.run_files import finished_run

BAD: dict[str, tuple[str, list[str], str]] = {
    "empty": ("", FULL, "is empty; give a table"),
    "header only": ("frequency [Hz],pp [um]\n", FULL, "no values below it"),
    "remarks only": ("# nothing\n", FULL, "remarks only"),
    "no header": ("100,760\n150,1154\n", FULL, "line 1: '100,760' are numbers where the names"),
    "a title without #": ("Measured by K.\nfrequency [Hz];pp [um]\n1;2\n", FULL, "begin remarks with #"),
    "unknown unit": ("frequency [Hz],pp [furlongs per]\n100,760\n", FULL, "'furlongs per' is not a unit of peak to peak; m or a multiple"),
    "wrong unit": ("frequency [Hz],pp [kg]\n100,760\n", FULL, "'kg' is not a unit of peak to peak"),
    "no unit": ("frequency,pp [um]\n100,760\n", FULL, "column 'frequency': no unit; write it in the header, 'frequency [Hz]', or give it with --unit"),
    "missing column": ("frequency [Hz],colour [um]\n100,760\n", ["--as", "sine-dwell", *FULL], "no column peak_to_peak or fundamental"),
    "unknown table": ("a [Hz],colour [um]\n100,760\n", FULL, "which belong to no known measurement; name the measurement and its columns with --as"),
    "unclear amplitude": ("frequency [Hz],amplitude_um\n100,760\n", FULL, '--column "peak_to_peak=amplitude_um"'),
    "twice": ("frequency [Hz],f [Hz],pp [um]\n100,100,760\n", FULL, "may both be the frequency; choose"),
    "no drive": (GOOD, [], 'the amplitude of the drive is not given; give it as max - min at the amplifier\'s input: --set "peak_to_peak_v=5 V"'),
    "drive too large": ("frequency [Hz],pp [um],drive pp [V]\n100,760,2000\n", [], "line 2: a drive of 2000 V, max - min, leaves the amplifier's range"),
    "not a number": ("frequency [Hz],pp [um]\n100,760\n150,about 9\n", FULL, "line 3, column 'pp [um]': 'about 9' is not a number"),
    "thousands": ("frequency [Hz];pp [um]\n100;1.154,2\n", FULL, "'1.154,2' is not a number; write it without thousands separators"),
    "nan": ("frequency [Hz],pp [um]\n100,NaN\n", FULL, "line 2, column 'pp [um]': 'NaN' is not a number"),
    "no value": ("frequency [Hz],pp [um]\n100,\n", FULL, "line 2, column 'pp [um]': '' is not a number"),
    "infinite": ("frequency [Hz],pp [um]\n100,inf\n", FULL, "'inf' is not a number"),
    "negative frequency": ("frequency [Hz],pp [um]\n-100,3\n", FULL, "-100 is not a frequency: it must be above 0"),
    "the same line": ("frequency [Hz],pp [um]\n100,3\n150,4\n100,3\n", FULL, "line 4 is the same as line 2"),
    "uneven": ("frequency [Hz],pp [um]\n100,3,9\n", FULL, "line 2: 3 cells where the header (line 1) names 2 columns"),
    "commas between commas": ("frequency [Hz],pp [um]\n100,0,760,1\n", FULL, "save it with ; between the cells"),
    "comma and point": ("frequency [Hz];pp [um]\n100,5;3\n150.5;4\n", FULL, "decimal comma in line 2 ('100,5') and a decimal point in line 3"),
    "negative error": ("frequency [Hz],pp [um],pp error [um]\n100,3,-1\n", FULL, "-1 is not an uncertainty"),
    "volts": ("level [V],deflection [um]\n1500,350\n", [], '--column "specimen_voltage=level [V]"'),
    "side": ("load [N],deflection [um],side\n1,137,left\n", [], "line 2, column 'side': 'left' is not a side"),
    "no such column": (GOOD, [*FULL, "--column", "phase=phi"], "has no such column; it has: 'frequency [Hz]', 'pp [um]'"),
    "no such quantity": (GOOD, [*FULL, "--column", "colour=pp"], "sine-dwell has no 'colour'"),
    "no such kind": (GOOD, ["--as", "dance"], "there is no such measurement; there are: static-loading,"),
    "no such setting": (GOOD, ["--set", "volume=11"], "has no parameter 'volume'"),
    "no such uncertainty": (GOOD, [*FULL, "--uncertainty", "phase=1 %"], "phase is not one of the values"),
    "uncertainty of what": (GOOD, [*FULL, "--uncertainty", "peak_to_peak=1 kg"], "not a quantity in m"),
    "day to come": (GOOD, [*FULL, "--measured", "2999-01-01"], "still to come"),
    "no day": (GOOD, [*FULL, "--measured", "once"], "write a day, 2019-05-04"),
    "series backwards": ("time [s],drive [V],displacement [um]\n0,2.5,0\n0.2,3,1\n0.1,3,1\n", ["--as", "raw"], "line 4, column 'time [s]': 0.1 does not come after 0.2"),
    "series with a gap": ("time [s],drive [V],displacement [um]\n0,2.5,0\n0.1,3,1\n0.2,3,1\n0.5,3,1\n0.6,3,1\n", ["--as", "raw"], "cut it at its gaps"),
    "series without a drive": ("time [s],displacement [um]\n0,2.5\n0.1,3\n0.2,3\n", ["--as", "raw"], "has no column of the drive"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_a_bad_table_is_a_sentence(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    text, arguments, words = BAD[name]
    (tmp_path / "t.csv").write_text(text)
    assert words in refused(tmp_path / "t.csv", capsys, *arguments)


def test_a_bad_file_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name, data, words in (
        ("new.mat", b"MATLAB 7.3 MAT-file, Platform" + bytes(600), "not a readable MAT file"),
        ("broken.mat", b"MATLAB 5.0 MAT-file" + bytes(200), "not a readable MAT file"),
        ("book.xlsx", b"PK\x03\x04" + bytes(50), "save its sheet as CSV"),
        ("picture.csv", bytes(range(256)), "is neither text nor a MAT file"),
    ):
        (tmp_path / name).write_bytes(data)
        assert words in refused(tmp_path / name, capsys, *FULL)
    assert_names(refused(tmp_path / "gone.csv", capsys), "gone.csv")
    assert str(tmp_path) in refused(tmp_path, capsys)
    run = finished_run(tmp_path / "old")
    assert_names(refused(run, capsys), run.name, "HDF5")


@pytest.mark.deep
def test_mat_vectors_of_different_length_are_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    savemat(tmp_path / "t.mat", {"frequency_Hz": np.arange(1.0, 4), "pp_um": np.arange(1.0, 6)})
    assert "the columns differ in length: 'frequency_Hz' 3, 'pp_um' 5" in refused(tmp_path / "t.mat", capsys, *FULL)
    savemat(tmp_path / "e.mat", {"words": "none"})
    assert "holds no vectors of numbers (it has: words)" in refused(tmp_path / "e.mat", capsys, *FULL)


def test_a_mat_file_that_is_damaged_is_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    savemat(tmp_path / "t.mat", {"frequency_Hz": np.arange(1.0, 400), "pp_um": np.arange(1.0, 400)})
    whole = (tmp_path / "t.mat").read_bytes()
    (tmp_path / "t.mat").write_bytes(whole[:-100])
    assert "is cut off or damaged, 100 bytes are missing" in refused(tmp_path / "t.mat", capsys, *FULL)
    (tmp_path / "t.mat").write_bytes(whole[:132] + b"\xff\xff\xff\x7f" + whole[136:])  # two gigabytes, it says
    assert_names(refused(tmp_path / "t.mat", capsys, *FULL), "t.mat", "damaged")
    (tmp_path / "t.mat").write_bytes(whole)
    monkeypatch.setattr(
        "app.archive.importing.mat_table.READER_SCRIPT", "import os; os.abort()"
    )  # as scipy's does of some damaged bytes
    assert "not a readable MAT file (its reader crashed)" in refused(tmp_path / "t.mat", capsys, *FULL)
