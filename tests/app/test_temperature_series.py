"""A series of a campaign over temperatures: a chamber is set and read, and the coefficients of the hidden specimen are found."""

from pathlib import Path

import numpy as np
import pytest

from app.campaign.campaign import Campaign, CampaignError
from app.campaign.plan import CampaignItem
from app.campaign.series import temperature_coefficient
from app.cli.main import ExitCode, main
from app.config.bench_file import load_bench
from model import Series, SeriesAxis
from model.response import poles

CELSIUS = np.array([15.0, 25.0, 35.0])
BENCH = """
name = "bench in a chamber"
[environment]
port = "simulated"
driver = "espec"
timeout_s = 20.0
[simulation]
seed = 5
[simulation.room]
k2_per_kelvin = -1.4e-3
chamber_lag_s = 10.0
"""


def curve(y: np.ndarray, errors: float) -> Series:
    return Series(
        CELSIUS, y, np.full(3, errors), x_axis=SeriesAxis("t", "degC"), y_axis=SeriesAxis("natural_frequency")
    )


def test_the_coefficient_of_a_line_has_the_errors_of_both_axes() -> None:
    found = temperature_coefficient(curve(200 * (1 - 2e-3 * (CELSIUS - 25)), 0.1), np.full(3, 0.05))
    assert found is not None
    assert found.value == pytest.approx(-2e-3)
    assert found.statistical == pytest.approx(0.1 / 200 / np.sqrt(200))
    assert found.total == pytest.approx(np.hypot(0.1, 0.4 * 0.05) / 200 / np.sqrt(200), rel=1e-3)


def test_scatter_about_the_line_widens_the_errors() -> None:
    bent = 200 * (1 - 2e-3 * (CELSIUS - 25)) + np.array([1.0, -2.0, 1.0])
    found = temperature_coefficient(curve(bent, 0.1), np.zeros(3))
    assert found is not None
    assert found.statistical == pytest.approx(np.sqrt(6) / 200 / np.sqrt(200), rel=1e-3)
    assert temperature_coefficient(curve(bent, 0.0), np.zeros(3)) is None, "errors are not known"


def test_a_series_over_temperatures_needs_a_tolerance(tmp_path: Path) -> None:
    campaign = Campaign.create(tmp_path, "T1", True, ())
    with pytest.raises(CampaignError, match="air_within_k"):
        campaign.add(CampaignItem("warm", "sweep", {}, (), varied="air_temperature_c", values=(15.0, 25.0)))


@pytest.mark.deep
def test_a_series_in_a_chamber_finds_the_hidden_coefficient(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bench, csv = tmp_path / "bench.toml", tmp_path / "warm.csv"
    bench.write_text(BENCH)
    common = ["--bench", str(bench), "--specimen", "T1", "--out", str(tmp_path)]
    waits = ["--set", "air_within_k=0.5", "--set", "air_steady_s=5", "--set", "sweep_s=0.5"]
    varied = ["--protocol", "sweep", "--vary", "air_temperature_c=15,25,35"]
    assert main(["campaign", "new", *common]) == ExitCode.DONE
    assert main(["campaign", "add", "warm", *varied, *waits, *common]) == ExitCode.DONE
    for _ in CELSIUS:
        assert main(["campaign", "run", "warm", "--speed", "max", "--json", *common]) == ExitCode.DONE
    capsys.readouterr()
    assert main(["campaign", "curve", "warm", "--csv", str(csv), *common[2:]]) == ExitCode.DONE
    shown = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("natural_frequency: "))
    value, total = float(shown.split()[1]), float(shown.split()[11])
    seen = [float(line.split(",")[0]) for line in csv.read_text().splitlines()[1:]]
    assert seen == pytest.approx(CELSIUS, abs=0.5)
    assert seen != CELSIUS.tolist(), "the measured temperatures"
    parameters = load_bench(str(bench)).simulation_parameters
    cold, warm = (
        np.abs(poles(parameters.room.tactor_at(parameters.tactor, c), n=parameters.modes)).min() for c in (15.0, 35.0)
    )
    truth = 100 * (warm - cold) / 20 / (0.5 * (warm + cold))
    assert abs(value - truth) < 4 * total
    assert total < 0.2 * abs(truth)
