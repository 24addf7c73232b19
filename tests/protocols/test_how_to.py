"""The protocol of docs/how-to-write-a-protocol.md, taken from the page: form, command line, rehearsal, file, plots, fit, import, report."""

import re
import shlex
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest

from app.archive import Catalogue
from app.cli.main import main
from app.common import Table
from app.common.exit_codes import ExitCode
from app.fleet.catalogue_values import read_fleet
from app.identification.specimen_identification import identify
from app.live.model_overlay import Overlay, curve_request_for
from app.plotting.panels import ReportPlot
from app.report.content import build_report
from app.report.runs import read_report_runs
from app.services import check_form, protocol_fields
from model import Tactor
from model.identification import FitOptions
from protocols import registry
from protocols.base import Protocol
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from tests.helpers.importing import brought
from tests.helpers.simulated_bench import laboratory, run

FIGURE = "Displacement at held levels"
DISPLACEMENT_PER_VOLT = "displacement per volt"
PAGE = Path(__file__).parents[2] / "docs" / "how-to-write-a-protocol.md"


@pytest.fixture
def file(tmp_path: Path) -> Path:
    """The page's code blocks as a file."""
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert blocks[0].startswith("# holds.py")
    path = tmp_path / "holds.py"
    path.write_text("\n\n".join(blocks), encoding="utf-8")
    return path


@pytest.fixture
def kind(file: Path) -> Iterator[type[Protocol]]:
    before = dict(registry.PROTOCOLS)
    yield registry.load_protocol_file(file)
    registry.PROTOCOLS.clear()
    registry.PROTOCOLS.update(before)


def test_it_is_short(file: Path) -> None:
    assert sum(bool(line.strip()) for line in file.read_text().splitlines()) < 100


def test_its_form_has_units_ranges_and_words(kind: type[Protocol]) -> None:
    fields = {field.name: field for field in protocol_fields(kind)}
    assert list(fields)[:3] == ["levels_v", "wait_s", "sample_rate_hz"]
    assert {name.partition("_")[0] for name in list(fields)[3:]} == {"air"}, "of every protocol"
    assert (fields["levels_v"].unit, fields["levels_v"].is_list) == ("V", True)
    assert re.fullmatch(r"0\D+5 V", fields["levels_v"].limits)
    beyond = check_form(kind, {"levels_v": "3 V, 6 V"})
    assert beyond.errors.keys() == {"levels_v"}
    assert check_form(kind, {"levels_v": "3000 mV, 4"}).value == kind(levels_v=(3.0, 4.0))  # type: ignore[call-arg]


def test_its_run_is_rehearsed_measured_and_drawn(kind: type[Protocol], tmp_path: Path) -> None:
    with laboratory() as lab:
        rehearsal = rehearse(kind(), lab.bench.amplifier)  # type: ignore[call-arg]
        ran = run(kind(), tmp_path, lab)  # type: ignore[call-arg]
    assert (rehearsal.entries, rehearsal.highest_specimen_v) == (2, 900.0)
    assert ran.status == "completed"
    assert [round(p.level, 2) for p in ran.points] == [3.0, 4.0]
    assert ran.points[0].displacement == pytest.approx(300 * 2.37886e-7, rel=2e-3)  # Eq. (8): 300 V on the specimen
    with h5py.File(ran.path) as plain:
        points = plain["entry/points"]
        assert (points.attrs["signal"], list(points.attrs["axes"])) == ("displacement", ["level"])
        assert points["displacement"].attrs["units"] == "m"
        assert plain["entry/estimates/displacement_per_volt/value"][()] == pytest.approx(600 * 2.37886e-7, rel=2e-3)


def test_its_runs_and_tables_are_identified_like_those_of_a_built_in_protocol(
    file: Path, kind: type[Protocol], tmp_path: Path
) -> None:
    with laboratory() as lab:
        measured = run(kind(levels_v=(1.0, 3.0, 4.0)), tmp_path, lab).path  # type: ignore[call-arg]
    (tmp_path / "old.csv").write_text("Voltage (V),deflection [um]\n1.0,-71.3664\n3.0,71.3658\n4.0,214.0974\n")
    imported = brought(tmp_path / "old.csv", "--as", str(file), "--uncertainty", "displacement=0.1 %")
    with Run(imported) as opened:
        assert (opened.record.protocol, bool(opened.record.imported)) == ("holds", True)
    for path in (measured, imported):
        found = identify([path], options=FitOptions(free=("mu",)), sheet="none", plain=True)
        (moment,) = found.identified
        assert moment.value == pytest.approx(Tactor().mu, rel=3e-3)


def test_its_points_are_drawn_on_the_curve_of_the_model(kind: type[Protocol], tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(kind(levels_v=(1.0, 3.0, 4.0)), tmp_path, lab)  # type: ignore[call-arg]
    overlay = Overlay(lab.bench.amplifier.map)
    curve = overlay.compute(curve_request_for(kind()))  # type: ignore[call-arg]
    overlay.close()
    assert curve.over_axes is not None
    levels, moved = (np.array([getattr(p, name) for p in ran.points]) for name in ("level", "displacement"))
    np.testing.assert_allclose(curve.over_axes(levels), moved, rtol=2e-3)


@pytest.mark.deep
def test_its_runs_are_reported_and_charted(kind: type[Protocol], tmp_path: Path) -> None:
    runs = tmp_path / "runs"
    with laboratory() as lab:
        ran = run(kind(levels_v=(0.5, 1.5, 3.0, 4.0)), runs, lab)  # type: ignore[call-arg]
    (read,) = read_report_runs(runs, "T1")
    assert read.path == ran.path
    report, _, _ = build_report(runs, "T1", full=True)
    plot, *_ = (block for block in report.blocks if isinstance(block, ReportPlot) and block.title == FIGURE)
    assert [points.y.size for points in plot.panels[0].points] == [4]
    assert plot.panels[0].lines[0].band is not None
    tables = [block for block in report.blocks if isinstance(block, Table) and block.title.startswith("Held levels")]
    with Run(ran.path) as file:
        names = [estimate.name for estimate in file.record.estimates]
    assert names == [DISPLACEMENT_PER_VOLT]
    assert [row[0] for row in tables[0].rows] == [*names, "stroke to 5 V"]
    catalogue = Catalogue(runs)
    del registry.PROTOCOLS[kind.name]
    catalogue.scan()
    assert read_fleet(runs, catalogue).names == (DISPLACEMENT_PER_VOLT,)
    registry.PROTOCOLS[kind.name] = kind  # the protocol's file is loaded after the runs were indexed
    stroke = read_fleet(runs, catalogue).of("stroke to 5 V")
    assert stroke.newest[0].value == pytest.approx(2.5 * 87e-6, rel=0.05)


@pytest.mark.deep
def test_every_command_of_the_page_does_what_it_says(
    file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The commands are taken from the page; the ideal bench takes the place of the realistic one, a file that of one of the page's."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(registry.FILES_VARIABLE, "")
    before, told = dict(registry.PROTOCOLS), dict[str, str]()
    (tmp_path / "old.csv").write_text("level [V],displacement [um]\n1.0,-71.3664\n4.0,214.0974\n")
    blocks = re.findall(r"```\n(tactor-bench .*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for line in "".join(blocks).splitlines():
        registry.PROTOCOLS.clear()  # a new program knows the file by the option, or by the environment
        registry.PROTOCOLS.update(before)
        registry.PROTOCOLS.has_searched = False
        words = shlex.split(line.replace("$PWD", str(tmp_path)), comments=True)
        if words[0] == "export":
            monkeypatch.setenv(*words[1].split("=", 1))
            continue
        runs = {
            word: sorted(map(str, Path().glob(word.replace("20261121T091502Z", "*"))))
            for word in words
            if "runs/" in word
        }
        paths = [run for word in words[2:] for run in runs.get(word, [word])]
        bench = ["--bench", "ideal"] if words[1] in ("run", "resume") else []
        assert main([words[1], *paths, *bench]) == ExitCode.DONE, line
        told[words[1]] = "".join(capsys.readouterr())
    registry.PROTOCOLS.clear()
    registry.PROTOCOLS.update(before)
    assert "levels_v = 3, 4 V" in told["protocols"]
    assert "displacement 142.7" in told["run"]
    assert f"{DISPLACEMENT_PER_VOLT}: 142." in told["show"]
    assert (tmp_path / "holds.png").stat().st_size > 10_000
    assert "mu" in told["identify"]
    assert "T7_report.pdf" in told["report"]
    assert "356." in told["fleet"]  # 2.5 V at 142.7 µm/V
