"""Bench files edited by the program: comments stay, what is read back is what was typed; the sensor's calibration line."""

import re
from pathlib import Path

import numpy as np
import pytest

from app.config.bench_editing import BenchDraft, bench_files, benches_folder, changed_text
from app.config.bench_file import SIMULATED_BENCHES, ConfigError, load_bench, read_bench
from app.config.bench_tables import CardTable, SensorTable
from app.config.sensor_calibration import CalibrationPoint, SensorCalibrationError, calibrate_sensor
from app.config.template import TEMPLATE


@pytest.fixture(autouse=True)
def own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path / "data"))


def test_a_new_bench_is_saved_with_its_comments_and_read_back() -> None:
    draft = BenchDraft.new()
    assert draft.edited
    draft = draft.with_tables(
        name="Bench of Ann",
        card=CardTable(device="cDAQ1Mod1"),
        sensor=draft.config.sensor.model_copy(update={"gain_m_per_v": 5.1e-4, "calibration_points": ((0.0, 1.0),)}),
        channels=[{"name": "monitor", "channel": "ai2", "gain": 1000.0, "kind": "voltage-monitor"}],
        meters={"display": {"driver": "keyence-lkg", "port": "COM3"}},
    )
    saved = draft.save()
    assert Path(saved.name) == benches_folder() / "bench-of-ann.toml"
    assert load_bench(saved.name) == draft.config == saved.config
    assert not saved.edited
    text = Path(saved.name).read_text("utf-8")
    for field in ("gain_m_per_v", "rest_v"):
        assert comment_of(field, text) == comment_of(field, TEMPLATE) != ""
    assert bench_files() == [Path(saved.name)]
    removed = saved.with_tables(channels=[], meters={}).save()
    assert load_bench(removed.name).channels == []
    assert comment_of("rest_v", Path(removed.name).read_text("utf-8")) == comment_of("rest_v", TEMPLATE)


@pytest.mark.parametrize("name", ["sim", *(str(path) for path in sorted(Path("docs/benches").glob("*.toml")))])
def test_every_bench_file_keeps_its_text_but_for_the_value_that_changed(name: str) -> None:
    draft = BenchDraft.load(name)
    assert changed_text(draft.text, draft.config, draft.config) == draft.text
    other = draft.with_tables(card=draft.config.card.model_copy(update={"range_v": 5.0}))
    text = changed_text(draft.text, draft.saved, other.config)
    assert read_bench(text, name).same_bench(other.config)
    before, after = draft.text.splitlines(), text.splitlines()
    assert len([line for line in before if line not in after]) <= 1


def test_a_simulated_bench_is_saved_as_a_file_of_the_users_own() -> None:
    draft = BenchDraft.load("sim")
    assert not draft.edited
    assert not draft.has_file
    first, second = draft.with_tables(name="sim 2").save(), draft.with_tables(name="sim 2").save()
    assert Path(first.name).name == "sim-2.toml"
    assert Path(second.name).name == "sim-2-2.toml"
    assert first.config.simulated
    assert SIMULATED_BENCHES["sim"] == "realistic.toml"


def comment_of(field: str, text: str) -> str:
    """Comment beside a field of a bench file."""
    (line,) = (line for line in text.splitlines() if line.split("=")[0].strip() == field)
    return line.partition("#")[2]


def test_a_file_that_another_program_changed_is_not_overwritten() -> None:
    saved = BenchDraft.new().save()
    noted = saved.text + "# a note\n"
    Path(saved.name).write_text(noted, encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(saved.name)):
        saved.with_tables(name="other").save()
    assert Path(saved.name).read_text("utf-8") == noted


def test_tables_that_contradict_each_other_are_a_sentence() -> None:
    with pytest.raises(ConfigError, match="the terminal ai0 is used twice"):
        BenchDraft.new().with_tables(channels=[{"name": "a", "channel": "ai0"}])


# -- calibration ------------------------------------------------------------------------------------------------------


def points(positions_um: list[float], volts: list[float], gauge_um: float = 1.0) -> list[CalibrationPoint]:
    return [CalibrationPoint(1e-6 * x, 1e-6 * gauge_um, v, 1e-5) for x, v in zip(positions_um, volts, strict=True)]


def test_two_points_give_gain_and_zero_with_the_gauges_uncertainty() -> None:
    found = calibrate_sensor(points([0, 1000], [1.0, -1.0]))
    assert found.gain_m_per_v == pytest.approx(-5e-4)
    assert found.zero_v == pytest.approx(1.0)
    assert found.gain_relative_uncertainty == pytest.approx(np.sqrt(2) * 1e-3, rel=0.01)
    assert found.rounded() == {"gain_m_per_v": -5e-4, "zero_v": 1.0, "gain_relative_uncertainty": 0.0014}
    assert found.residuals_m == pytest.approx((0, 0), abs=1e-12)


def test_scatter_about_the_line_enters_the_uncertainty() -> None:
    exact = calibrate_sensor(points([0, 500, 1000, 1500], [0, 1, 2, 3]))
    bent = calibrate_sensor(points([0, 520, 980, 1500], [0, 1, 2, 3]))
    assert bent.gain_relative_uncertainty > 5 * exact.gain_relative_uncertainty
    assert max(map(abs, bent.residuals_m)) == pytest.approx(20e-6, rel=0.2)


def test_the_stated_uncertainty_is_that_of_repeated_calibrations() -> None:
    draws = np.random.default_rng(5)
    positions = np.linspace(0, 2000, 6)
    gains, stated = [], []
    for _ in range(400):
        true = positions + draws.normal(0, 2.0, 6)
        found = calibrate_sensor(points(list(positions), list(true / 500), gauge_um=2.0))
        gains.append(found.gain_m_per_v)
        stated.append(found.gain_relative_uncertainty)
    scatter = np.std(gains) / np.mean(gains)
    assert 0.9 < np.mean(stated) / scatter < 1.3


@pytest.mark.parametrize(
    ("positions", "volts", "says"),
    [
        ([], [], "there are none"),
        ([0], [1], "there is one"),
        ([5, 5], [1, 2], "same position"),
        ([0, 100], [1, 1.00001], "the volts of all points agree"),
    ],
)
def test_points_without_a_line_are_refused_with_a_remedy(positions: list[float], volts: list[float], says: str) -> None:
    with pytest.raises(SensorCalibrationError, match=says):
        calibrate_sensor(points(positions, volts))


def test_the_sensor_of_a_bench_has_no_use_for_the_points() -> None:
    table = SensorTable(calibration_points=((0.0, 1.0), (1e-3, 3.0)))
    assert table.laser_sensor.gain_m_per_v == 1e-4
