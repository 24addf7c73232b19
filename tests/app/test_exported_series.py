"""Series of every protocol, exported in every format and read by programs of others."""

import csv
import json
import re
import shutil
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from app.archive import FORMATS, ExportError, export_run
from app.archive.exporting.parts import ExportedRun
from app.cli.main import main
from app.comparison import ComparisonView, open_comparison
from app.comparison.files import ComparisonExport
from drivers.sensors.laser_sensor import LaserSensor
from model import Relation
from protocols.base import EstimatedQuantity, RunStatus, Series, SeriesAxis
from protocols.measurements.sine_dwell import SinePoint
from protocols.registry import PROTOCOLS
from protocols.runfile.reader import Run
from protocols.runfile.verify import FileState, verify_run
from protocols.runfile.writer import RunFileWriter
from tests.compare_runs import SEED, SHORT
from tests.helpers.importing import FULL, brought
from tests.helpers.run_files import begun_run, initial_record

FEW = SHORT | {"endurance": ["cycles=3000", "block_cycles=1000", "per_decade=2"]}
"""Settings that keep a run short."""
MONITORED_BENCH = Path(__file__).parents[2] / "docs/how-to/electrical.toml"
PARTS = ("about", "points", "series", "estimates")
IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,62}\Z")
TIME, MOVED = SeriesAxis("time", "s", "time"), SeriesAxis("displacement", "m", "displacement")


def series_of(path: Path) -> tuple[Series, ...]:
    with Run(path) as run:
        return run.series()


def exported(path: Path, folder: Path, kind: Any) -> list[Path]:
    with Run(path) as run:
        return export_run(run, folder / kind, kind, PARTS)


def columns_of(series: Series) -> dict[str, np.ndarray]:
    return {axis.name: values for axis, values in series.columns()}


def check_rows(rows: dict[tuple[int, str, str], dict[str, list[Any]]], series: tuple[Series, ...]) -> None:
    """The columns of each series, by entry, label and name of y, are its values; empty cells are NaN."""
    assert len(rows) == len(series)
    for one in series:
        got = rows[one.entry, one.label, one.y_axis.name]
        for name, values in columns_of(one).items():
            cells = [np.nan if cell in (None, "") else float(cell) for cell in np.atleast_1d(got[name])]
            np.testing.assert_allclose(cells, values, rtol=1e-12, err_msg=f"{one.title}: {name}")


def split_rows(head: list[str], rows: list[Any], y: str) -> dict[tuple[int, str, str], dict[str, list[Any]]]:
    """Rows of a table by entry and label, its columns by name."""
    found: dict[tuple[int, str, str], dict[str, list[Any]]] = {}
    for row in rows:
        cells = dict(zip(head, row, strict=True))
        key = int(cells["entry"]), str(cells["label"] or ""), y
        for name, cell in cells.items():
            found.setdefault(key, {}).setdefault(name, []).append(cell)
    return found


def read_csv(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    found = {}
    for file in (file for file in files if "_series-" in file.name):
        with file.open(newline="", encoding="utf-8") as text:
            head, *rows = csv.reader(text)
        names = [name.partition(" [")[0] for name in head]
        assert all("[" in name for name in head[2:])
        found |= split_rows(names, rows, names[3])
    return found


def read_xlsx(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    from openpyxl import load_workbook

    found = {}
    for sheet in load_workbook(files[0]):
        assert len(sheet.title) <= 31
        if sheet.title.startswith("series-"):
            head, *rows = sheet.iter_rows(values_only=True)
            names = [name.partition(" [")[0] for name in head]
            found |= split_rows(names, rows, names[3])
    return found


def read_parquet(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    import pyarrow.parquet as pq

    found = {}
    for file in (file for file in files if "_series-" in file.name):
        table = pq.read_table(file)
        assert all(field.metadata[b"unit"] for field in list(table.schema)[2:])
        names = table.column_names
        found |= split_rows(names, [tuple(row.values()) for row in table.to_pylist()], names[3])
    return found


def read_json(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    record = json.loads(files[0].read_text("utf-8"))
    return {(one["entry"], one["label"], one["y"]): one["columns"] for one in record["series"]}


def structures(of: dict[str, Any], at: str = "") -> Iterator[tuple[str, list[str]]]:
    """Names of the fields of every structure."""
    yield at, list(of)
    for name, value in of.items():
        if isinstance(value, dict):
            yield from structures(value, f"{at}/{name}")


def read_mat(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    from scipy.io import loadmat

    record = {name: value for name, value in loadmat(files[0], simplify_cells=True).items() if name[:2] != "__"}
    for place, names in structures(record):
        assert all(IDENTIFIER.match(name) for name in names), (place, names)
        assert len({*names}) == len(names), place
    found = {}
    for one in record.get("series", {}).values():
        assert one["units"][one["x"]]
        found[int(one["entry"]), str(one["label"] if len(one["label"]) else ""), one["y"]] = one
    return found


def read_mat73(files: list[Path]) -> dict[tuple[int, str, str], Any]:
    found: dict[tuple[int, str, str], Any] = {}

    def text(data: Any) -> str:
        return "" if data.attrs.get("MATLAB_empty") else "".join(map(chr, data[:].ravel()))

    with h5py.File(files[0]) as file:
        file.visit(
            lambda path: [
                pytest.fail(path) for name in path.split("/") if name[0] != "#" and not IDENTIFIER.match(name)
            ]
        )
        for one in file.get("series", {}).values():
            cells = {name: data[:].ravel() for name, data in one.items() if isinstance(data, h5py.Dataset)}
            found[int(one["entry"][()].item()), text(one["label"]), text(one["y"])] = cells
    return found


def check_universal_file(file: Path, series: tuple[Series, ...]) -> None:
    """Every series is a function of data set 58 with the same abscissa and values."""
    import pyuff

    assert file.read_bytes().isascii()
    functions = [each for each in pyuff.UFF(str(file)).read_sets() if each["type"] == 58]
    for one in series:
        assert any(
            each["x"].size == one.x.size
            and np.allclose(each["x"], one.x, rtol=2e-5, atol=1e-9)
            and np.allclose(each["data"], one.y, rtol=1e-9, atol=1e-15)
            for each in functions
        ), one.title


READERS: dict[Any, Any] = {
    "csv": read_csv,
    "xlsx": read_xlsx,
    "json": read_json,
    "parquet": read_parquet,
    "mat": read_mat,
    "mat73": read_mat73,
}


def points_read(kind: str, files: list[Path]) -> Mapping[str, Any]:
    """Columns of the points, as another program reads them."""
    match kind:
        case "csv":
            (file,) = (file for file in files if file.stem.endswith("_points"))
            with file.open(newline="", encoding="utf-8") as text:
                head, *rows = csv.reader(text)
        case "xlsx":
            from openpyxl import load_workbook

            head, *rows = load_workbook(files[0])["points"].iter_rows(values_only=True)
        case "parquet":
            import pyarrow.parquet as pq

            (file,) = (file for file in files if file.stem.endswith("_points"))
            return pq.read_table(file).to_pydict()
        case "json":
            return json.loads(files[0].read_text("utf-8"))["points"]
        case "mat":
            from scipy.io import loadmat

            return loadmat(files[0], simplify_cells=True)["points"]
        case _:
            with h5py.File(files[0]) as file:
                return {n: data[:].T for n, data in file["points"].items() if isinstance(data, h5py.Dataset)}
    return dict(zip((name.partition(" [")[0] for name in head), zip(*rows, strict=True), strict=True))


def check_points(got: Mapping[str, Any], points: Mapping[str, np.ndarray]) -> None:
    """Every column of the points is in a table; one of several orders may be several columns."""
    for name, values in points.items():
        orders = values.T if values.ndim == 2 and name not in got else ()
        found = [got[f"{name}_{at + 1}"] for at in range(len(orders))] if len(orders) else got[name]
        cells = np.array(
            [[np.nan if c in (None, "") else float(c) for c in np.ravel(each)] for each in np.atleast_1d(found)]
        )
        expected = orders if len(orders) else values
        np.testing.assert_allclose(cells.reshape(np.shape(expected)), expected, rtol=1e-12, err_msg=name)


def check_every_format(run: ExportedRun, folder: Path) -> None:
    series, points = run.series(), {name: values for name, values in run.points().items() if values.size}
    for kind, read in READERS.items():
        files = export_run(run, folder / kind, kind, PARTS)
        check_rows(read(files), series)
        if points:
            check_points(points_read(kind, files), points)
    if points or any(one.x.size > 1 for one in series):  # a Universal File holds curves
        check_universal_file(*export_run(run, folder / "uff", "uff", PARTS), series)


def check_comparison(path: Path, folder: Path) -> None:
    """Difference of a run and its copy."""
    copy = Path(shutil.copy(path, folder / f"copy_{path.name}"))
    comparison = open_comparison([path, copy], ComparisonView(relation=Relation.DIFFERENCE))
    check_every_format(ComparisonExport(comparison, "comparison"), folder / "comparison")


def check_nexus(path: Path, protocol: str) -> None:
    """A NeXus viewer finds the plot of the protocol, and the samples over time."""
    with h5py.File(path) as file:
        plot, trace = file, file["entry/trace"]
        while "default" in plot.attrs:
            plot = plot[plot.attrs["default"]]
        assert plot.attrs["NX_class"] == "NXdata"
        x, y = plot.attrs["axes"][0], plot.attrs["signal"]
        assert plot[x].shape == plot[y].shape
        assert plot.attrs.get("name", "") == PROTOCOLS[protocol].default_plot
        assert {plot[x].attrs["units"], plot[y].attrs["units"]}
        if protocol in ("sweep", "free-decay", "hysteresis", "mass-resonance", "latency", "electrical"):
            assert plot[y].size > 50
        if protocol == "membrane-series":
            lines = [plot.attrs["signal"], *plot.attrs["auxiliary_signals"]]
            assert [plot[name].attrs["long_name"] for name in lines] == ["free", "0 mm", "2.54 mm", "free"]
            assert np.isfinite([plot[name][:] for name in lines]).all()
            points = file["entry/points"]
            np.testing.assert_array_equal(np.ravel([plot[name][:] for name in lines]), points[y.rpartition("_")[0]])
        assert list(trace.attrs["axes"]) == ["time"]
        with Run(path) as run:
            np.testing.assert_array_equal(trace["time"][:], run.trace.time_s())


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Path]:
    """Measures a protocol once, with the settings of `FEW`, on a bench with the inputs that it needs."""

    @cache
    def run_of(protocol: str) -> Path:
        folder, bench = tmp_path_factory.mktemp("runs"), SEED[:2]
        if PROTOCOLS[protocol].input_kinds:
            bench = ["--bench", str(MONITORED_BENCH)]
        chosen = [part for setting in FEW.get(protocol, ()) for part in ("--set", setting)]
        assert main(["run", protocol, *bench, *SEED[2:], "--out", str(folder), "--specimen", "T1 µ", *chosen]) == 0
        (path,) = folder.glob("*.h5")
        return path

    return run_of


@pytest.mark.deep
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_protocol_is_read_back_from_every_format(
    protocol: str, measured: Callable[[str], Path], tmp_path: Path
) -> None:
    path = measured(protocol)
    check_nexus(path, protocol)
    with Run(path) as run:
        check_every_format(run, tmp_path)
    check_comparison(path, tmp_path)


@pytest.mark.deep
@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_nexus_readers_open_a_protocol(protocol: str, measured: Callable[[str], Path]) -> None:
    """Default plot and trace by the readers of NeXpy and silx view, where they are installed."""
    nexus = pytest.importorskip("nexusformat.nexus", reason="nexusformat is not installed")
    silx = pytest.importorskip("silx.io.nxdata", reason="silx is not installed")
    path = measured(protocol)
    root = nexus.nxload(str(path))
    with h5py.File(path) as file:
        default, trace = silx.get_default(file), silx.NXdata(file["entry/trace"])
        assert (default.is_valid, default.is_curve, default.issues) == (True, True, [])
        assert (trace.is_valid, trace.axes_dataset_names) == (True, ["time"])
        assert root.get_default().nxpath == default.group.name
    assert [axis.nxname for axis in root["entry/trace"].nxaxes] == ["time"]


@pytest.mark.deep
def test_an_import_is_read_back_from_every_format(tmp_path: Path) -> None:
    table = tmp_path / "fig4.csv"
    table.write_text("frequency [Hz],pp [um],phase [deg]\n100,760,-26\n150,1154,-76\n160,1100,-90\n", "utf-8")
    path = brought(table, *FULL)
    with Run(path) as run:
        assert run.record.imported
        check_every_format(run, tmp_path)
    check_comparison(path, tmp_path)


@pytest.fixture
def many(tmp_path: Path) -> Path:
    """A run whose series and estimates have names that formats cannot hold as they are."""
    file = begun_run(tmp_path, "T7 = Müller's", (100.0,), 5000.0)
    time = np.linspace(0, 0.1, 40)
    decay = Series(
        time, np.exp(-9 * time), x_axis=TIME, y_axis=MOVED, name="décay [µm/V]: a long name for a sheet", label="n° 1"
    )
    fitted = Series(
        time,
        np.exp(-9 * time),
        0.1 + time,
        0.2 + time,
        fit=time,
        x_axis=TIME,
        y_axis=MOVED,
        name=decay.name,
        label="2",
        entry=1,
    )
    loop = Series(
        np.cos(60 * time), np.sin(60 * time), x_axis=SeriesAxis("drive", "V", "drive"), y_axis=MOVED, name=decay.name
    )
    names = ("largest max - min, 5 V", "largest max + min, 5 V", "end", "2nd mode", "ζ", "x" * 70, "x" * 69)
    estimates = [EstimatedQuantity(name, 1.0, 0.1, "1", "fit") for name in names]
    file.finish(RunStatus.COMPLETED, "", estimates, (decay, fitted, loop))
    return file.path


@pytest.mark.deep
def test_names_of_any_kind_are_exported(many: Path, tmp_path: Path) -> None:
    from scipy.io import loadmat

    with Run(many) as run:
        check_every_format(run, tmp_path)
    estimates = loadmat(*exported(many, tmp_path, "mat"), simplify_cells=True)["estimates"]
    assert [one["name"] for one in estimates.values()] == [each.name for each in estimates_of(many)]


def estimates_of(path: Path) -> tuple[EstimatedQuantity, ...]:
    with Run(path) as run:
        return run.record.estimates


def test_a_text_that_a_format_cannot_hold_is_not_damage(
    many: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Run, "record", property(lambda run: replace(run.stored_record(), specimen="T\udce4")))
    with Run(many) as run, pytest.raises(ExportError, match=rf"^parquet\b.*{re.escape(many.name)}.*udce4"):
        export_run(run, tmp_path / "out", "parquet")
    assert main(["export", str(many), "--format", "parquet", "--out", str(tmp_path / "out")]) == 1


def test_columns_of_earlier_files_are_series_of_their_own(many: Path) -> None:
    """Files before this version stored the drive of a time series beside its displacement, without a role."""
    with h5py.File(many, "r+") as file:
        group = next(iter(file["entry/curves"].values()))
        del group.attrs["role"]
        group.create_dataset("drive", data=np.arange(40.0)).attrs.update({"units": "V", "long_name": "drive (V)"})
    drive, decay, *_ = series_of(many)
    assert (drive.y_axis, drive.label) == (SeriesAxis("drive", "V", "drive"), decay.label)
    np.testing.assert_array_equal(drive.y, np.arange(40.0))
    np.testing.assert_array_equal(drive.x, decay.x)


@pytest.mark.deep
def test_names_that_hdf5_cannot_hold_lose_nothing(tmp_path: Path) -> None:
    """`/` begins another group there, and a group has a name once."""
    x, y = np.arange(3.0), np.array([1.0, 2.0, 4.0])
    axes = [("level/rest", "moved/2"), ("moved", "moved"), ("title", "share"), ("", "..")]
    curves = [
        Series(x, y, 0 * y, x_axis=SeriesAxis(one, "V"), y_axis=SeriesAxis(two, "1"), name="loop/half", entry=at)
        for at, (one, two) in enumerate(axes)
    ]
    names = ("loop width / stroke", "loop width / stroke", "peak_to_mean", "natural_frequency", "..")
    file = begun_run(tmp_path, "T7", (100.0,), 5000.0)
    file.finish(RunStatus.COMPLETED, "", [EstimatedQuantity(name, 1.5, 0.1, "1", "") for name in names], curves)
    assert verify_run(file.path).state is FileState.GOOD
    assert [each.name for each in estimates_of(file.path)] == [*names]
    read = series_of(file.path)
    assert [(one.name, one.entry) for one in read] == [("loop/half", at) for at in range(4)]
    for one in read:
        np.testing.assert_array_equal([one.x, one.y, one.errors], [x, y, 0 * y])
    for kind in FORMATS:
        assert exported(file.path, tmp_path, kind)


def test_a_displacement_with_errors_has_total_errors_with_the_gain_of_the_sensor(tmp_path: Path) -> None:
    record = replace(
        initial_record("T7", (100.0,), 5000.0), sensor=LaserSensor("laser", 1e-4, gain_relative_uncertainty=0.02)
    )
    file = RunFileWriter.new(tmp_path, record, SinePoint)
    x, y, errors = np.arange(3.0), np.array([1e-4, -2e-4, 4e-4j]), np.full(3, 3e-6)
    response = Series(x, y, errors, x_axis=SeriesAxis("frequency", "Hz"), y_axis=SeriesAxis("response", "m/V"))
    driven = Series(x, y.real, errors, x_axis=TIME, y_axis=SeriesAxis("drive", "V"))
    file.finish(RunStatus.COMPLETED, "", series=(response, replace(driven, y_axis=MOVED, errors=None), driven))
    measured, without, drive = (one.total_errors for one in series_of(file.path))
    np.testing.assert_allclose(measured, np.hypot(3e-6, 0.02 * np.abs(y)))
    assert without is drive is None


def test_values_that_are_not_known_are_no_zeros_in_a_universal_file(tmp_path: Path) -> None:
    import pyuff

    file = begun_run(tmp_path, "T7", (100.0,), 5000.0)
    f, nothing = np.linspace(100.0, 160.0, 7), np.full(7, np.nan)
    fit = np.where(f > 130, 2e-4, np.nan)
    axes = {"x_axis": SeriesAxis("frequency", "Hz"), "y_axis": SeriesAxis("response", "m/V")}
    file.finish(RunStatus.COMPLETED, "", series=(Series(f, np.full(7, 1e-4 + 0j), nothing, fit=fit, **axes),))
    (path,) = exported(file.path, tmp_path, "uff")
    response, fitted = (each for each in pyuff.UFF(str(path)).read_sets() if each["type"] == 58)
    np.testing.assert_allclose(response["x"], f, rtol=1e-5)
    np.testing.assert_allclose(fitted["x"], f[f > 130], rtol=1e-5)
    np.testing.assert_allclose(fitted["data"], 2e-4)


def test_amplitudes_without_phases_are_a_series_of_a_universal_file(tmp_path: Path) -> None:
    import pyuff

    (tmp_path / "fig9.csv").write_text("f [Hz],max-min [um]\n100,760\n150,1154\n200,610\n")
    path = brought(tmp_path / "fig9.csv", "--as", "sine-dwell", "--set", "peak_to_peak_v=5 V")
    (file,) = exported(path, tmp_path, "uff")
    (amplitudes,) = (each for each in pyuff.UFF(str(file)).read_sets() if each["type"] == 58)
    np.testing.assert_allclose(amplitudes["x"], [100, 150, 200])
    np.testing.assert_allclose(amplitudes["data"], [760e-6, 1154e-6, 610e-6])
