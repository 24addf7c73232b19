"""Imported tables with delay, order and times: the fit of the same data is the one of the measured runs."""

from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.config import load_bench
from app.identification import identify
from app.identification.observations import read_observations
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile import Run
from tests.helpers.simulated_bench import laboratory, run

TABLE = "frequency [Hz],fundamental [um],fundamental_errors [um],phase [deg],phase_errors [deg]\n"
DWELL = TABLE + "".join(f"{f},{500 + f},1,{-10 - f / 5},0.1\n" for f in range(50, 260, 20))


def dwell_errors(tmp_path: Path, *options: str) -> dict[str, float]:
    """Return the shared errors of an imported dwell by name."""
    tmp_path.mkdir(exist_ok=True)
    (tmp_path / "dwell.csv").write_text(DWELL, encoding="utf-8")
    out = tmp_path / "runs"
    arguments = ("import", str(tmp_path / "dwell.csv"), "--set", "peak_to_peak_v=5 V", "--out", str(out), *options)
    assert main([*arguments, "--specimen", "T7", "--as", "sine-dwell"]) == 0
    (observation,) = read_observations(list(out.glob("*.h5")))[1].runs
    return {e.name: e.standard_error for e in observation.shared_errors}


def test_the_delay_and_its_error_are_those_of_the_bench_file_or_of_the_option(tmp_path: Path) -> None:
    (tmp_path / "bench.toml").write_text(
        '[generator]\nresource = "TCPIP::192.0.2.1::5025::SOCKET"\n[sensor]\nname = "laser"\nserial = "7"\ngain_m_per_v = 1e-4\ngain_relative_uncertainty = 0.004\ndelay_uncertainty_s = "3 us"\n',
        encoding="utf-8",
    )
    bench = ("--bench", str(tmp_path / "bench.toml"))
    assert not [name for name in dwell_errors(tmp_path / "a") if name.startswith(("gain", "delay"))]
    stated = dwell_errors(tmp_path / "b", *bench)
    assert stated["delay of laser 7"] == pytest.approx(3e-6)
    assert stated["gain of laser 7"] == pytest.approx(0.004)
    given = dwell_errors(tmp_path / "c", *bench, "--delay-error", "8 us", "--gain-error", "1 %", "--sensor", "other")
    assert given["delay of other"] == pytest.approx(8e-6)
    assert given["gain of other"] == pytest.approx(0.01)


def test_times_of_weights_and_of_levels_are_columns(tmp_path: Path) -> None:
    """Ten minutes under each load: creep of the earlier ones is in the later readings."""
    (tmp_path / "loads.csv").write_text(
        "load [N],deflection [um],deflection_errors [um],placed [s],read [s]\n"
        "1,138,1,0,600\n2,276,1,700,1300\n5,690,1,1400,2000\n",
        encoding="utf-8",
    )
    (tmp_path / "levels.csv").write_text(
        "level [V],deflection [um],deflection_errors [um],reached [s],read_time [s]\n5,357,1,0,60\n0.5,-95,1,90,60\n3,71,1,180,60\n",
        encoding="utf-8",
    )
    out = tmp_path / "runs"
    tables = [str(tmp_path / name) for name in ("loads.csv", "levels.csv")]
    assert main(["import", *tables, "--specimen", "T7", "--out", str(out)]) == 0
    found = read_observations(list(out.glob("*.h5")))[1].runs
    loads, levels = sorted((run.history for run in found), key=lambda history: history.read_s[0], reverse=True)
    assert loads.read_s == pytest.approx([600, 1300, 2000])
    assert loads.start_s == pytest.approx([0, 700, 1400])
    assert levels.start_s == pytest.approx([0, 90, 180])
    assert levels.read_s - levels.start_s == pytest.approx([60, 60, 60])
    assert np.ptp(loads.crept(loads.drive, 1.0) - loads.decades(1.0) * loads.steps(loads.drive)) > 0


@pytest.mark.deep
def test_the_same_data_measured_or_imported_give_the_same_fit(tmp_path: Path) -> None:
    """Every parameter within a tenth of its error, and every error within a tenth."""
    own, imported, tables = (tmp_path / name for name in ("own", "imported", "tables"))
    with laboratory(load_bench("sim")) as lab:
        runs = [
            run(protocol, own, lab, safe=False).path
            for protocol in (
                StaticLoading(repeats=2, weights_kg=(0.05, 0.2, 0.5)),
                VoltageSteps(repeats=2),
                SineDwell(frequencies_hz=(40, 80, 120, 150, 170, 210)),
            )
        ]
        with Run(runs[0]) as first:
            sensor = f"{first.record.sensor.name} {first.record.sensor.serial}".strip()
    assert (
        main(
            ["export", *map(str, runs), "--format", "csv", "--part", "points", "--part", "about", "--out", str(tables)]
        )
        == 0
    )
    points = sorted(map(str, tables.glob("*_points.csv")))
    assert main(["import", *points, "--bench", "sim", "--sensor", sensor, "--out", str(imported)]) == 0
    measured, again = (identify(sorted(folder.glob("*.h5")), n=20) for folder in (own, imported))
    assert measured.joint_fit is not None
    assert again.joint_fit is not None
    assert again.joint_fit.degrees_of_freedom == measured.joint_fit.degrees_of_freedom
    estimates = {e.name: e for e in again.estimates}
    for e in measured.estimates:
        assert abs(estimates[e.name].value - e.value) < 0.1 * e.standard_error, e.name
        assert estimates[e.name].standard_error == pytest.approx(e.standard_error, rel=0.1), e.name
