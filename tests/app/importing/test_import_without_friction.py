"""Tables as laboratories have them are imported without options that only the program needs."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from app.cli.main import main
from protocols.runfile.reader import Run
from tests.helpers.importing import FULL, GOOD, brought, points, refused


@pytest.mark.parametrize(
    ("head", "row", "load_n", "deflection_m"),
    [
        ("weight (g),deflection (um)", "500,676", 4.903325, 676e-6),
        ("load (gf),deflection (mil)", "500,26.6", 4.903325, 26.6 * 25.4e-6),
        ("load_lb,deflection_mil", "1,24.1", 4.4482216, 24.1 * 25.4e-6),
        ("force_lbf,deflection (thou)", "1,24.1", 4.4482216, 24.1 * 25.4e-6),
        ("load [oz],deflection_um", "16,602", 4.4482216, 602e-6),
    ],
)
def test_units_of_weights_and_thousandths_of_an_inch(
    head: str, row: str, load_n: float, deflection_m: float, tmp_path: Path
) -> None:
    (tmp_path / "t.csv").write_text(f"{head}\n{row}\n")
    got = points(brought(tmp_path / "t.csv"))
    np.testing.assert_allclose(got["load"], load_n, rtol=1e-6)
    np.testing.assert_allclose(got["deflection"], deflection_m, rtol=1e-6)


def test_sags_need_no_number_of_the_row(tmp_path: Path) -> None:
    (tmp_path / "s.csv").write_text("sag_mm,sag_errors_mm\n3.46,0.02\n3.48,0.02\n3.46,0.02\n")
    path = brought(tmp_path / "s.csv")
    with Run(path) as run:
        assert run.record.protocol == "membrane-sag"
    np.testing.assert_allclose(points(path)["sag"], [3.46e-3, 3.48e-3, 3.46e-3])
    np.testing.assert_array_equal(points(path)["repeat"], [1, 2, 3])


def series(path: Path, rate_hz: float = 5000.0) -> Path:
    t = np.arange(1000) / rate_hz
    drive, moved = 2.5 + 2 * np.sin(2 * np.pi * 160 * t), 300 * np.sin(2 * np.pi * 160 * t - 0.7)
    rows = zip(t.tolist(), drive.tolist(), moved.tolist(), strict=True)
    path.write_text(
        "time [s],drive [V],displacement [um]\n" + "".join(f"{a:.6f},{b:.6f},{c:.6f}\n" for a, b, c in rows)
    )
    return path


def test_even_samples_are_a_time_series_and_an_unknown_delay_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = brought(series(tmp_path / "t.csv"))
    with Run(path) as run:
        assert run.record.protocol == "sine-dwell"
    assert "the delay of the sensor's output is not given and taken as 0" in " ".join(capsys.readouterr().out.split())
    brought(tmp_path / "t.csv", "--sensor-delay", "0 s")
    assert "the delay of the sensor" not in capsys.readouterr().out


def test_a_setting_of_one_table_is_no_fault_of_the_others(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "d.csv").write_text(GOOD)
    (tmp_path / "l.csv").write_text("load_g,deflection_um\n50,67.6\n")
    files = [str(tmp_path / name) for name in ("d.csv", "l.csv")]
    assert main(["import", *files, "--out", str(tmp_path / "runs"), *FULL]) == 0
    assert len(list((tmp_path / "runs").glob("*.h5"))) == 2
    for made in (tmp_path / "runs").glob("*.h5"):
        made.unlink()
    assert "omit --set peak_to_peak_v for this table" in refused(tmp_path / "l.csv", capsys, *FULL)


def test_the_default_plot_shows_the_column_that_is_there(tmp_path: Path) -> None:
    """A viewer drew nothing of a table of fundamentals: the signal was max - min, all NaN."""
    for head, signal in (("pp", "peak_to_peak"), ("fundamental", "fundamental")):
        (tmp_path / "f.csv").write_text(f"frequency [Hz],{head} [um]\n100,362\n150,577\n")
        with h5py.File(brought(tmp_path / "f.csv", *FULL)) as file:
            assert file["entry/points"].attrs["signal"] == signal
            assert np.isfinite(file[f"entry/points/{signal}"][:]).all()
