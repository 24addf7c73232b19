"""Importing tables: CSV dialects, MAT files, units, implausible values reported and kept."""

import csv
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from app.archive.importing.import_table import split_heading
from app.cli.main import main
from app.identification.observations import run_observations
from model.identification.observations import (
    FrequencyResponseObservation,
    MassResonanceObservation,
    StaticLoadingObservation,
    VoltageStepsObservation,
)
from protocols.runfile.reader import Run
from tests.helpers.importing import FULL, GOOD, brought, points
from tests.helpers.messages import assert_names

TABLES = {
    "plain": "frequency [Hz],peak_to_peak_um\n100,760.1\n150,1154.2\n",
    "a byte-order mark, remarks, ; and decimal commas": "\ufeff# by hand\r\nf / Hz;Peak to peak (mm)\r\n100;0,7601\r\n\r\n150;1,1542\r\n",
    "tabs, units in a line of their own": "frequency\tp2p\nHz\tum\n100\t760.1\n150\t1154.2\n",
    "an old Macintosh": "frequency [Hz];p2p [um]\r100;760,1\r150;1154,2\r",
    "blanks": "% old\nfrequency_Hz  pk-pk_um\n100   760.1\n150  1154.2\n",
    "Excel's own line, quoted": 'sep=;\n"frequency [Hz]";"max - min [µm]";""\n"100";"760,1";""\n"150";"1154,2";""\n',
}


@pytest.mark.one_in(5)
@pytest.mark.parametrize("name", TABLES)
@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "utf-16"])
def test_every_country_s_table_is_read(name: str, encoding: str, tmp_path: Path) -> None:
    text = TABLES[name] if encoding == "utf-8" else TABLES[name].removeprefix("\ufeff")
    (tmp_path / "t.csv").write_bytes(text.encode(encoding))
    got = points(brought(tmp_path / "t.csv", *FULL))
    np.testing.assert_allclose(got["frequency"], [100, 150])
    np.testing.assert_allclose(got["peak_to_peak"], [760.1e-6, 1154.2e-6], rtol=1e-12)
    assert np.isnan(got["phase"]).all()
    np.testing.assert_array_equal(got["drive_amplitude"], 2.5)


@pytest.mark.parametrize(
    ("head", "name", "unit"),
    [
        ("frequency [Hz]", "frequency", "Hz"),
        ("amplitude_um", "amplitude", "um"),
        ("Load (g)", "Load", "g"),
        ("f/Hz", "f", "Hz"),
        ("drive in V", "drive", "V"),
        ("omega / rad/s", "omega", "rad/s"),
        ("max - min", "max - min", None),
        ("peak_to_peak", "peak_to_peak", None),
    ],
)
def test_a_head_tells_name_and_unit(head: str, name: str, unit: str | None) -> None:
    assert split_heading(head) == (name, unit)


@pytest.mark.parametrize("head", ["frequency (rad/s)", "omega / rad/s"])
def test_an_angular_frequency_is_divided_by_two_pi(head: str, tmp_path: Path) -> None:
    (tmp_path / "w.csv").write_text(f"{head},pp [um]\n628.3185307179586,760\n942.4777960769379,1154\n")
    np.testing.assert_allclose(points(brought(tmp_path / "w.csv", *FULL))["frequency"], [100, 150])


def test_a_load_in_grams_is_a_mass_and_its_side_may_be_a_word(tmp_path: Path) -> None:
    (tmp_path / "l.csv").write_text(
        "Load (g),Displacement (um),u_Displacement (um),side\n20,27,1,MFC\n500,677,2,aluminium\n"
    )
    path = brought(tmp_path / "l.csv", "--specimen", "T1")
    got = points(path)
    np.testing.assert_allclose(got["load"], [0.02 * 9.80665, 0.5 * 9.80665])
    np.testing.assert_array_equal(got["side"], [1, -1])
    np.testing.assert_allclose(got["deflection_errors"], [1e-6, 2e-6])
    with Run(path) as run:
        sides = [o.side for o in run_observations(run) if isinstance(o, StaticLoadingObservation)]
    assert sides == ["mfc", "aluminium"]


def test_volts_on_the_specimen_are_turned_back_to_the_input(tmp_path: Path) -> None:
    (tmp_path / "v.csv").write_text("high voltage [kV],deflection [um]\n-0.5,-119\n1.5,357\n")
    path = brought(tmp_path / "v.csv", "--uncertainty", "deflection=1 %")
    np.testing.assert_allclose(points(path)["level"], [0.0, 5.0])
    with Run(path) as run:
        (steps,) = run_observations(run)
    assert isinstance(steps, VoltageStepsObservation)
    np.testing.assert_allclose(steps.input_v, [0.0, 5.0])
    np.testing.assert_allclose(steps.errors_m, [1.19e-6, 3.57e-6])


def test_a_resonance_says_whether_it_is_a_peak_or_the_natural_frequency(tmp_path: Path) -> None:
    for head, meaning in (("resonance frequency [Hz]", "peak"), ("natural frequency [Hz]", "undamped")):
        (tmp_path / "m.csv").write_text(f"added mass [g];{head};sigma [Hz]\n1,75;300,9;0,3\n9,75;141,8;0,3\n")
        with Run(brought(tmp_path / "m.csv")) as run:
            (found,) = run_observations(run)
        assert isinstance(found, MassResonanceObservation)
        assert found.meaning == meaning
        np.testing.assert_allclose(found.frequency_hz, [300.9, 141.8])
        np.testing.assert_allclose(found.mass_kg, [1.75e-3, 9.75e-3])
        np.testing.assert_allclose(found.errors_hz, [0.3, 0.3])


def test_an_elongation_makes_it_a_membrane_series(tmp_path: Path) -> None:
    (tmp_path / "m.csv").write_text(
        "frequency [Hz],pp [um],elongation [mm]\n100,760,\n150,1154,\n100,437,1.27\n150,357,1.27\n"
    )
    path = brought(tmp_path / "m.csv", *FULL, "--uncertainty", "peak_to_peak=1 %")
    with Run(path) as run:
        assert run.record.protocol == "membrane-series"
        found = [o.elongation_m for o in run_observations(run) if isinstance(o, FrequencyResponseObservation)]
    assert found == [None, pytest.approx(1.27e-3)]
    (tmp_path / "one.csv").write_text("frequency [Hz],pp [um]\n100,437\n")
    assert points(brought(tmp_path / "one.csv", *FULL, "--membrane-elongation", "1.27 mm"))["elongation"] == [
        pytest.approx(1.27e-3)
    ]


def test_a_time_series_gives_amplitude_and_phase(tmp_path: Path) -> None:
    t = np.arange(5000) / 10_000
    drive, moved = 2.5 + 2.0 * np.sin(2 * np.pi * 160 * t), 3e-4 * np.sin(2 * np.pi * 160 * t - 0.7) + 1e-3
    for name, rows in (("a.csv", slice(0, None)), ("b.csv", slice(100, None))):
        with (tmp_path / name).open("w", newline="") as file:
            sheet = csv.writer(file)
            sheet.writerow(["time [ms]", "drive [V]", "displacement [um]"])
            sheet.writerows(zip(1e3 * t[rows], drive[rows], 1e6 * moved[rows], strict=True))
    out = tmp_path / "runs"
    files = [str(tmp_path / "a.csv"), str(tmp_path / "b.csv")]
    assert main(["import", *files, "--as", "raw", "--out", str(out), "--sensor-delay", "100 us"]) == 0
    (path,) = out.glob("*.h5")
    got = points(path)
    np.testing.assert_allclose(got["frequency"], 160, rtol=1e-6)
    np.testing.assert_allclose(got["fundamental"], 3e-4, rtol=1e-6)
    np.testing.assert_allclose(got["phase"], -0.7 + 2 * np.pi * 160 * 1e-4, atol=1e-5)
    np.testing.assert_allclose(got["drive_amplitude"], 2.0, rtol=1e-6)
    with Run(path) as run:
        assert run.record.protocol == "sine-dwell"
        assert run.trace.sample_count == 0
        assert {s.label: s.y.size for s in run.series() if s.x_axis.unit == "s"} == {
            "160 Hz, a.csv": 5000,
            "160 Hz, b.csv": 4900,
        }


@pytest.mark.deep
def test_mat_vectors_and_a_matrix_are_columns(tmp_path: Path) -> None:
    savemat(
        tmp_path / "t.mat", {"frequency_Hz": np.array([[100.0, 150]]), "pp_um": np.array([760.0, 1154]), "room": 23.0}
    )
    np.testing.assert_allclose(points(brought(tmp_path / "t.mat", *FULL))["peak_to_peak"], [760e-6, 1154e-6])
    savemat(tmp_path / "m.mat", {"data": np.array([[100.0, 760], [150, 1154]])})
    messages = [
        "--column",
        "frequency=data_1",
        "--column",
        "peak_to_peak=data_2",
        "--unit",
        "data_1=Hz",
        "--unit",
        "data_2=um",
    ]
    np.testing.assert_allclose(points(brought(tmp_path / "m.mat", *FULL, *messages))["frequency"], [100, 150])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (
            "frequency [Hz],pp [m]\n100,760.1\n150,1154\n",
            "line 2, column 'pp [m]': 760.1 is 760.1 m, and peak to peak is usually",
        ),
        ("frequency [kHz],pp [um]\n100,760.1\n150,1154\n", "is 1e+05 Hz, and frequency is usually"),
        ("frequency [Hz],pp [um]\n150,1154\n100,760.1\n", "frequency does not rise (line 3)"),
        ("frequency [Hz],pp [um]\n100,760\n100,761\n", "frequency 100 occurs 2 times (line 2, line 3)"),
        ("frequency [Hz],pp [um]\n100,760.1\n", "the uncertainty of the values is not given"),
    ],
)
def test_what_looks_odd_is_told_and_kept(
    text: str, message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "t.csv").write_text(text)
    path = brought(tmp_path / "t.csv", *FULL)
    assert message in capsys.readouterr().out
    with Run(path) as run:
        assert any(message in caution for caution in run.record.imported["cautions"])


def test_a_dry_run_writes_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "t.csv").write_text(GOOD)
    assert main(["import", str(tmp_path / "t.csv"), *FULL, "--dry-run", "--out", str(tmp_path / "runs")]) == 0
    assert_names(capsys.readouterr().out, "--dry-run")
    assert not (tmp_path / "runs").exists()
