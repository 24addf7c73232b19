"""Comparison of runs: curves, relations, views, exports read back by other readers, pictures; command and Python API."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import h5py
import numpy as np
import pytest
import scipy.io

import tactor_bench as tb
from app.archive import FORMATS, compare_runs
from app.cli.main import main
from app.comparison import (
    MAX_RUNS,
    ComparedRun,
    Comparison,
    ComparisonError,
    ComparisonView,
    export_comparison,
    open_comparison,
    read_view,
    save_view,
    view_path,
)
from model import Relation
from protocols.measurements.sweep import Sweep
from tests.helpers.messages import assert_names
from tests.helpers.run_files import finished_run
from tests.helpers.simulated_bench import laboratory, run

FREQUENCIES = (100.0, 160.0, 250.0)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("runs")
    for at in range(4):
        finished_run(folder, f"T{at}", FREQUENCIES, size_m=(at + 1) * 2e-4)
    return folder


@pytest.fixture
def paths(folder: Path) -> list[Path]:
    return sorted(folder.glob("*.h5"), key=lambda path: path.name.split("_")[1])


def view(**fields: Any) -> ComparisonView:
    return ComparisonView(**fields)


def test_ratio_and_difference_are_those_of_the_points_and_the_sensors_gain_cancels(paths: list[Path]) -> None:
    ratio = open_comparison(paths, view(relation=Relation.RATIO, reference=paths[1].name))
    assert [layer.name for layer in ratio.layers] == ["A", "B", "C", "D"]
    assert [layer.series.y.tolist() for layer in ratio.layers] == [pytest.approx([r] * 3) for r in (0.5, 1.0, 1.5, 2.0)]
    difference = ratio.with_view(ratio.view.model_copy(update={"relation": Relation.DIFFERENCE}))
    assert difference.layers[3].series.y == pytest.approx([4e-4] * 3)
    assert ratio.layers[2].series.total_errors == pytest.approx(ratio.layers[2].series.errors), "one sensor"
    assert ratio.layers[0].value_at(130.0)[0] == pytest.approx(0.5)
    assert np.isnan(ratio.layers[0].value_at(300.0)[0])


def test_peaks_are_those_of_the_files(paths: list[Path]) -> None:
    columns = {column.name: column.cells for column in open_comparison(paths).peaks.columns}
    assert columns["run"] == list("ABCD")
    assert columns["natural_frequency"] == [158.35] * 4
    assert columns["largest"] == pytest.approx([2e-4, 4e-4, 6e-4, 8e-4])
    assert columns["quality_factor"] == [None] * 4, "no damping was identified"


def test_one_column_of_peaks_has_one_number_of_decimals(paths: list[Path]) -> None:
    runs = []
    for letter, path, value, error in zip("AB", paths, (158.304, 158.35), (0.34, 2.1), strict=False):
        run = ComparedRun.read(path, letter)
        record = run.summary.record
        found = (replace(record.estimates[0], value=value, standard_error=error),)
        known = run.summary._replace(record_json=replace(record, estimates=found).to_json())
        runs.append(replace(run, summary=known))
    table = Comparison(runs, ComparisonView()).peaks
    at = [column.name for column in table.columns].index("natural_frequency")
    assert [row[at : at + 2] for row in table.text_rows] == [("158.30", "0.34"), ("158.35", "2.10")]


def test_results_whose_difference_rounds_to_nothing_do_not_differ(paths: list[Path]) -> None:
    def are_equal(*values: float) -> bool:
        figures = [json.dumps([["damping_ratio", value, 0.001, 0.001, "1"]]) for value in values]
        run = ComparedRun.read(paths[0]).summary
        rows = compare_runs([run._replace(figures_json=each) for each in figures])
        return next(each.is_equal for each in rows if each.is_result)

    assert are_equal(0.21849, 0.21851)  # 0.218 and 0.219
    assert not are_equal(0.218, 0.224)
    assert not are_equal(0.21849, 0.21851, 0.21851)


def test_values_that_differ_below_the_usual_digits_are_told_with_more_of_them(paths: list[Path]) -> None:
    run = ComparedRun.read(paths[0]).summary
    many = [float(hz) for hz in range(100, 120)]
    runs = []
    for volts, hz, kelvin, um in ((5.0, 110.0, 22.01, 1154.0), (5.0000002, 110.5, 22.04, 1154.4)):
        record = replace(
            run.record,
            parameters={"peak_to_peak_v": volts, "frequencies_hz": [*many, hz, *many]},
            conditions=replace(run.record.conditions, temperature_c=kelvin),
        )
        figures = json.dumps([["natural_frequency", um, 0.01, 20.0, "Hz"]])
        runs.append(run._replace(record_json=record.to_json(), figures_json=figures))
    volts_row, frequencies, temperature, result = (each for each in compare_runs(runs) if not each.is_equal)
    assert volts_row.values == ("5 V", "5.0000002 V")
    assert temperature.values == ("22.01 °C", "22.04 °C")
    assert result.values == ("1154.00 Hz", "1154.40 Hz")
    assert ["110.5" in each for each in frequencies.values] == [False, True]
    same = compare_runs([runs[0], runs[0]])
    assert all(each.is_equal for each in same)
    assert "…" in next(each.values[0] for each in same if each.name == frequencies.name)


def test_a_waterfall_stands_in_the_order_of_its_setting_and_shows_true_values(paths: list[Path]) -> None:
    raised = open_comparison(paths, view(over="time", hidden=(paths[0].name,)))
    offsets = [layer.offset for layer in raised.layers]
    assert offsets[0] == offsets[1] == 0.0, "a hidden layer takes no place"
    assert offsets == sorted(offsets)
    assert [layer.value_at(160.0)[0] for layer in raised.layers] == pytest.approx([2e-4, 4e-4, 6e-4, 8e-4])


@pytest.mark.deep
def test_a_sweep_and_a_dwell_share_the_response_per_volt(tmp_path: Path) -> None:
    with laboratory() as lab:
        swept = run(Sweep(stop_hz=300.0), tmp_path, lab).path
    one = ComparedRun.read(swept)
    assert one.curves[0].series.x.size > 20, "first the response, not the single point"
    dwell = finished_run(tmp_path, "T1", FREQUENCIES)
    shared = Comparison([one, ComparedRun.read(dwell)], ComparisonView())
    assert {layer.name[0] for layer in shared.layers} == {"A", "B"}
    assert shared.layers[0].series.y_axis.unit == "m/V"


def test_a_view_is_read_back_and_what_is_no_view_is_named(paths: list[Path], tmp_path: Path) -> None:
    saved = view(runs=tuple(path.name for path in paths), relation=Relation.RATIO, cursors=(100.0, 160.0), over="mass")
    file = view_path(tmp_path, "four tactors")
    save_view(saved, file)
    assert read_view(file) == saved
    for text, says in (("{", "the file"), ('{"relation": "twice"}', "relation"), ('{"colour": 1}', "colour")):
        file.write_text(text)
        with pytest.raises(ComparisonError, match=says):
            read_view(file)
    with pytest.raises(ComparisonError, match="///"):
        view_path(tmp_path, "///")


def test_too_many_runs_and_unknown_quantities_are_refused(paths: list[Path]) -> None:
    with pytest.raises(ComparisonError, match=r"\b20$"):
        open_comparison(paths[:1] * (MAX_RUNS + 1))
    with pytest.raises(ComparisonError, match="frequency"):
        open_comparison(paths, view(quantity="colour over frequency"))


def read_back(kind: str, files: list[Path]) -> list[float]:
    """Return the values of the first layer by a reader that is not ours."""
    by = {file.suffix: file for file in files}
    match kind:
        case "csv":
            with next(f for f in files if "series" in f.name).open() as file:
                return [float(row["peak_to_peak_ratio [1]"]) for row in list(csv.DictReader(file))[:3]]
        case "json":
            return list(json.loads(by[".json"].read_text())["series"][0]["columns"]["peak_to_peak_ratio"])
        case "mat":
            record = scipy.io.loadmat(by[".mat"], simplify_cells=True)["series"]["comparison_1"]
            return list(record["peak_to_peak_ratio"])
        case "mat73":
            with h5py.File(by[".mat"]) as file:
                return np.ravel(file["series/comparison_1/peak_to_peak_ratio"][()]).tolist()
        case "parquet":
            import pyarrow.parquet as pq

            table = pq.read_table(next(f for f in files if "series" in f.name))
            return list(table["peak_to_peak_ratio"].to_pylist()[:3])
        case "xlsx":
            import openpyxl

            sheet = openpyxl.load_workbook(by[".xlsx"])["series-comparison"]
            head, *rows = sheet.values
            return [row[head.index("peak_to_peak_ratio [1]")] for row in rows[:3]]
        case _:
            import pyuff

            return list(pyuff.UFF(str(by[".uff"])).read_sets(2)["data"])


@pytest.mark.parametrize("kind", FORMATS)
def test_the_shown_values_are_read_back_from_every_format(kind: Any, paths: list[Path], tmp_path: Path) -> None:
    comparison = open_comparison(paths, view(relation=Relation.RATIO, reference=paths[1].name))
    files = export_comparison(comparison, tmp_path, kind)
    assert all("SIMULATED" in file.name for file in files)
    assert read_back(kind, files) == pytest.approx([0.5] * 3)


@pytest.mark.deep
def test_the_command_compares_draws_saves_and_opens_a_view(
    paths: list[Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    here = [finished_run(tmp_path, f"T{at}", FREQUENCIES, size_m=(at + 1) * 1e-4) for at in range(3)]
    picture = tmp_path / "p.svg"
    arguments = ["compare", *map(str, here), "--relation", "ratio", "--over", "time"]
    assert main([*arguments, "--plot", str(picture), "--save", "three", "--export", "csv"]) == 0
    printed = capsys.readouterr().out
    assert_names(printed, "specimen", "T0", "T2")
    assert ElementTree.parse(picture).getroot().tag.endswith("svg")
    assert main(["compare", str(tmp_path / "three.compare.json"), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["peaks"]["largest"] == pytest.approx([1e-4, 2e-4, 3e-4])
    for wrong, says in (
        (["--relation", "twice"], "normalised difference ratio"),
        (["--over", "moon"], "time mass elongation amplitude"),
        (["--reference", str(paths[0])], paths[0].name),
        (["--export", "doc"], "csv json"),
    ):
        assert main(["compare", *map(str, here), *wrong]) == 2
        assert_names(capsys.readouterr().err, *says.split())


def test_one_call_of_the_python_api_compares_runs(paths: list[Path], tmp_path: Path) -> None:
    result = tb.compare(
        [paths[0], tb.open_run(paths[3])],
        relation="ratio",
        picture=tmp_path / "p.png",
        save=tmp_path / "v.compare.json",
    )
    assert result.layers[1].series.y == pytest.approx([4.0] * 3)
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert read_view(tmp_path / "v.compare.json").relation is Relation.RATIO
    with pytest.raises(tb.ComparisonError, match="relation"):
        tb.compare(paths, relation="twice")


def test_the_models_curve_is_a_layer_of_the_reference_specimen(paths: list[Path]) -> None:
    result = tb.compare(paths[:2], model=True)
    model = result.layers[-1]
    assert model.name == "Model"
    assert model.series.x.size == 400
    assert 1e-4 < np.nanmax(model.series.y) < 2e-3
