"""Many specimens: statistics and control charts against published examples, and a made-up laboratory with a drifting laser."""

import json
import random
import time
from dataclasses import replace
from datetime import UTC, datetime, timedelta
from pathlib import Path

import numpy as np
import pytest

from app.archive import Catalogue
from app.cli.main import main
from app.common import ExitCode
from app.fleet.catalogue_values import Fleet, FleetError, FleetValue, read_fleet
from app.fleet.control_chart import TooFewValuesError, control_chart, moving_average
from app.fleet.drift import DriftCause, golden_charts, sensor_drifts
from app.fleet.statistics import capability, outlier_mask, spread_of, trend_of
from app.fleet.summary_tables import quantity_table, specimen_table
from tests.helpers.fleet_runs import BEGIN, DRIFT_FROM_DAY, GOLDEN, write_laboratory
from tests.helpers.messages import assert_names


def test_individuals_chart_as_in_the_handbook() -> None:
    # NIST/SEMATECH e-Handbook 6.3.2.2: mean 50.81, mean moving range 1.8778, limits 55.8041 and 45.8159
    chart = control_chart(np.array([49.6, 47.6, 49.9, 51.3, 47.8, 51.2, 52.6, 52.4, 53.6, 52.1]), 10)
    assert chart.centre == pytest.approx(50.81)
    assert chart.centre + 3 * chart.sigma == pytest.approx(55.8041, abs=1e-3)
    assert chart.centre - 3 * chart.sigma == pytest.approx(45.8159, abs=1e-3)


def test_ewma_as_in_the_handbook() -> None:
    # NIST/SEMATECH e-Handbook 6.3.2.4: weight 0.3 from 50 on
    values = [
        52.0,
        47.0,
        53.0,
        49.3,
        50.1,
        47.0,
        51.0,
        50.1,
        51.2,
        50.5,
        49.6,
        47.6,
        49.9,
        51.3,
        47.8,
        51.2,
        52.6,
        52.4,
    ]
    expected = [50.60, 49.52, 50.56, 50.18, 50.16, 49.21, 49.75, 49.85, 50.26, 50.33, 50.11, 49.36, 49.52, 50.05, 49.38]
    assert moving_average(np.array(values), 50.0, 0.3)[: len(expected)] == pytest.approx(expected, abs=0.011)


def test_capability_as_in_the_handbook() -> None:
    # NIST/SEMATECH e-Handbook 6.1.6: limits 8 and 20, mean 16, standard deviation 2 give Cpk 0.6667
    values = 16 + 2 * np.array([-1.0, 1.0] * 25) / np.std([-1.0, 1.0] * 25, ddof=1)
    found = capability(values, ["A"] * 50, 8, 20)
    assert found.ppk == pytest.approx(2 / 3)
    assert found.cpk == pytest.approx(2 / 3)
    assert found.ppk_error == pytest.approx(1.96 * np.sqrt(1 / 450 + (2 / 3) ** 2 / 98), rel=1e-3)
    assert found.outside == 0
    assert capability(values, ["A"] * 25 + ["B"] * 25, None, 16).outside == 25


BASE = [0.3, -0.5, 0.6, -0.2, -0.4, 0.5, -0.6, 0.2, 0.4, -0.3] * 2
"""In control: neither runs nor trends."""


@pytest.mark.parametrize(
    ("more", "rule"),
    [
        ([5.0], "beyond 3 sigma"),
        ([2.2, 0.0, 2.2], "2 of 3 beyond 2 sigma"),
        ([1.2, 1.2, -0.1, 1.2, 1.2], "4 of 5 beyond 1 sigma"),
        ([0.1, 0.2, 0.1, 0.2, 0.1, 0.2, 0.1, 0.2], "8 on one side"),
        ([-0.7, -0.4, -0.1, 0.1, 0.4, 0.6], "6 in one direction"),
        ([1.1] * 12, "EWMA"),
    ],
)
def test_each_rule_signals(more: list[float], rule: str) -> None:
    sigma = float(np.abs(np.diff(BASE)).mean()) / 1.128
    calm = control_chart(10 + np.array(BASE) / sigma)
    assert calm.in_control
    for side in (1, -1):
        chart = control_chart(10 + np.concatenate((np.array(BASE) / sigma, side * np.array(more))))
        assert rule in {signal.rule for signal in chart.signals}
        assert chart.first_signal >= 20


def test_outliers_spread_and_trend() -> None:
    values = np.array([10.0, 10.1, 9.9, 10.2, 9.8, 10.0, 13.0])
    assert outlier_mask(values).tolist() == [False] * 6 + [True]
    assert not outlier_mask(values[-3:]).any(), "of three values none is an outlier"
    assert not outlier_mask(np.full(6, 3.0)).any()
    spread = spread_of(values, np.full(7, 0.5))
    assert spread.true_sd == pytest.approx(np.sqrt(values.var(ddof=1) - 0.25))
    days = np.arange(60) * 86400.0
    trend = trend_of(days, 5 + days / 86400 * 0.1 + np.tile([0.01, -0.01], 30))
    assert trend is not None
    assert trend.per_month == pytest.approx(3.0, rel=1e-3)
    assert trend_of(days[:2], days[:2]) is None


def test_of_two_protocols_with_as_many_values_the_newer_one_counts() -> None:
    dwell, sweep = (
        replace(_value("T1", "laser", day, value), protocol=name)
        for day, value, name in ((0, 1.0, "dwell"), (1, 2.0, "sweep"))
    )
    assert [each.value for each in Fleet((dwell, sweep)).of("size").newest] == [2.0]
    later = replace(dwell, path="later")
    assert [each.value for each in Fleet((dwell, later, sweep)).of("size").newest] == [1.0]


def _value(specimen: str, sensor: str, day: float, value: float) -> FleetValue:
    start = (BEGIN + timedelta(days=day)).isoformat()
    return FleetValue("size", value, 0.0, 0.01, "m", "", specimen, "A", start, "p", "bench", sensor, "", "", False)


def test_tables_of_quantities_show_names_for_people_and_keep_identifiers() -> None:
    value = replace(_value("G", "L0", 0, 0.01), name="creep_per_decade", unit="1")
    fleet = Fleet((value, replace(value, name="compliance, MFC up", unit="m/N")))
    for name in ("creep_per_decade", "creep per decade", "compliance, MFC up"):
        table = quantity_table([fleet.of(name)], {})
        shown = next(column for column in table.columns if column.displayed)
        assert (shown.displayed_name, shown.values) == ("quantity", [name.replace("_", " ")])
        assert table.columns[0].values == [name if "," in name else "creep_per_decade"]


def _history(golden_drift: float, sensor_drift: float, sensors: int, others: int) -> Fleet:
    draw = random.Random(3)
    values = []
    for day in range(60):
        for s in range(sensors):
            change = 1 + golden_drift * (day > 30) + sensor_drift * (day > 30 and s == 0)
            values.append(_value("G", f"L{s}", day + 0.1 * s, change * (1 + draw.gauss(0, 0.001))))
        for k in range(others):
            change = 1 + sensor_drift * (day > 30)
            if day % 30 == k:
                values.append(_value(f"T{k}", "L0", day + 0.5, 2 * change * (1 + draw.gauss(0, 0.001))))
    return Fleet(tuple(values))


@pytest.mark.parametrize(
    ("golden_drift", "sensor_drift", "sensors", "others", "cause"),
    [
        (0.0, -0.01, 2, 0, DriftCause.BENCH),
        (0.0, 0.01, 1, 4, DriftCause.BENCH),
        (0.0, -0.01, 2, 4, DriftCause.BENCH),
        (-0.01, 0.0, 2, 0, DriftCause.SPECIMEN),
        (0.01, 0.0, 1, 4, DriftCause.SPECIMEN),
        (-0.01, 0.0, 2, 4, DriftCause.SPECIMEN),
        (-0.01, 0.0, 1, 0, DriftCause.UNDECIDED),
        (0.01, -0.02, 2, 4, DriftCause.UNDECIDED),
    ],
)
def test_what_else_changed_tells_the_cause(
    golden_drift: float, sensor_drift: float, sensors: int, others: int, cause: DriftCause
) -> None:
    selection = _history(golden_drift, sensor_drift, sensors, others).of("size")
    chart = golden_charts(selection, "G")[0]
    assert chart.sensor == "L0"
    assert chart.cause is cause, chart.evidence
    assert chart.chart.onset == chart.first_signal == 31


def test_too_few_values_are_named() -> None:
    selection = _history(0, 0, 1, 1).of("size")
    with pytest.raises(TooFewValuesError, match="T0 on L0"):
        golden_charts(selection, "T0")
    with pytest.raises(TooFewValuesError, match="X9"):
        golden_charts(selection, "X9")
    with pytest.raises(FleetError, match=r"'k2'.*\bsize$"):
        _history(0, 0, 1, 1).of("k2")


@pytest.fixture(scope="module")
def laboratory(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("laboratory")
    write_laboratory(folder)
    return folder


def test_values_on_a_drifting_sensor_are_marked_from_its_first_signal_on() -> None:
    fleet = _history(0.0, -0.01, sensors=2, others=4)
    drifts = sensor_drifts(fleet, "G")
    assert set(drifts) == {"L0"}
    table = specimen_table([fleet.of("size")], drifts)
    names, texts = table.columns[0].values, next(c for c in table.columns if c.name.endswith("as text")).values
    newest = {v.specimen: v for v in fleet.of("size").newest}
    for name, text in zip(names, texts, strict=True):
        late = newest[name].sensor == "L0" and newest[name].start_time >= drifts["L0"].since
        assert text.endswith("†") == late
    assert sum(text.endswith("†") for text in texts) == 3  # T0 and the golden one on the other sensor were not
    assert "L0" in table.note
    assert not sensor_drifts(_history(0.01, 0.0, sensors=2, others=4), "G")
    assert not sensor_drifts(fleet, "")


@pytest.mark.deep
def test_fifty_specimens_in_three_batches_and_the_drifting_laser_is_found(
    laboratory: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")
    (laboratory / "limits.toml").write_text(
        'golden = "G1"\n[limits.natural_frequency]\nlow = "150 Hz"\nhigh = "175 Hz"\n'
    )
    assert main(["fleet", str(laboratory), "--json"]) == ExitCode.DONE
    found = json.loads(capsys.readouterr().out)
    assert found["simulated"]
    assert len(found["specimens"]["specimen"]) == 51
    at = found["quantities"]["quantity"].index("natural_frequency")
    assert found["quantities"]["specimens"][at] == 51
    assert found["quantities"]["mean"][at] == pytest.approx(162, abs=1)
    assert float(found["quantities"]["cpk"][at].split(" ± ")[0]) == pytest.approx(12 / (3 * 1.5), rel=0.3)
    assert main(["fleet", str(laboratory), "--json", "--quantity", "natural_frequency"]) == ExitCode.DONE
    groups = json.loads(capsys.readouterr().out)["natural_frequency by batch"]
    assert groups["batch"] == ["A", "B", "C", "no batch"]
    assert np.diff(groups["mean"][:3]) == pytest.approx([2, 2], abs=1.6)
    assert main(["control-chart", str(laboratory), "--json"]) == ExitCode.FAILED
    charts = json.loads(capsys.readouterr().out)["charts"]
    assert charts["sensor"] == ["laser #L1", "laser #L2"]
    assert charts["cause"][1] == DriftCause.BENCH
    assert not DriftCause(charts["cause"][0]).is_drift
    day = (datetime.fromisoformat(charts["first_signal"][1]).replace(tzinfo=UTC) - BEGIN).days
    assert DRIFT_FROM_DAY <= day <= DRIFT_FROM_DAY + 20
    picture, sheet = tmp_path / "chart.png", tmp_path / "chart.csv"
    assert main(["control-chart", str(laboratory), "--picture", str(picture), "--csv", str(sheet)]) == ExitCode.FAILED
    assert f"laser #L2: drift of the bench: {GOLDEN} on laser #L2 -" in capsys.readouterr().out
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert sheet.read_text().startswith("sensor,start_time,value [m],total_uncertainty [m]")
    picture = tmp_path / "fleet.png"
    assert (
        main(["fleet", str(laboratory), "--batch", "A", "--picture", str(picture), "--csv", str(sheet)])
        == ExitCode.DONE
    )
    assert len(sheet.read_text().splitlines()) == 18
    assert main(["fleet", str(laboratory), "--batch", "Z"]) == ExitCode.USAGE
    assert main(["fleet", str(laboratory), "--quantity", "k9"]) == ExitCode.USAGE
    assert_names(capsys.readouterr().err, "k9", "natural_frequency", "amplitude_at_resonance")


@pytest.mark.deep
def test_ten_thousand_runs_are_compared_from_the_index(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from tests.helpers.fleet_runs import write_run

    write_run(tmp_path, "T0", 0.0, 1e-3, 160.0, 1)
    catalogue = Catalogue(tmp_path, tmp_path / "index.sqlite")
    catalogue.scan()
    (one,) = catalogue.entries()
    days = [(BEGIN + timedelta(hours=i)).isoformat() for i in range(10_000)]
    catalogue.upsert(
        [one._replace(path=f"{i}.h5", specimen=f"T{i % 50}", start_time=day) for i, day in enumerate(days)]
    )
    spent = []
    for _ in range(3):
        begin = time.process_time()
        fleet = read_fleet(tmp_path, catalogue)
        selection = fleet.of("amplitude_at_resonance")
        assert len(selection.newest) == 50
        spent.append(time.process_time() - begin)
    assert len(fleet.values) == 3 * 10_001
    with capsys.disabled():
        print(f"\n10 000 runs compared in {min(spent):.2f} s of processor time")
