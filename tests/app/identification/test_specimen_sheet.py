"""Specimen sheets: values with uncertainty, instrument and date, which enter every fit; Table I where there are none."""

import json
import re
from dataclasses import asdict
from pathlib import Path

import numpy as np
import pytest

import tactor_bench as tb
from app.cli.main import main
from app.identification.active_model import PAPER_MODEL, load_active_model
from app.identification.sheet_file import SheetError, create_sheet, load_sheet, parse_sheet, read_sheet, sheet_template
from app.identification.specimen_sheet import DIMENSIONS, SpecimenSheet
from app.identification.table_one import IDENTIFIED, TABLE_ONE
from app.identification.uncertainty_tables import unstated_errors
from model.identification.fit_options import FitOptions
from model.identification.observations import MembraneSagObservation, ObservationSet, StaticLoadingObservation
from model.parameter_spec import parameter_specs
from model.parameters import Membrane, Tactor
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.names import sheet_path
from tests.helpers.importing import brought
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

STATIC = "load [N],deflection [um],u_deflection [um]\n" + "".join(
    f"{n},{137.9 * n * (1 + e):.4f},0.1\n"
    for n, e in ((0.2, 1e-3), (0.5, -5e-4), (1.0, 2e-4), (2.0, -2e-4), (5.0, 1e-4))
)


@pytest.fixture
def static(tmp_path: Path) -> Path:
    (tmp_path / "s.csv").write_text(STATIC)
    return brought(tmp_path / "s.csv", "--specimen", "T7")


def loading() -> ObservationSet:
    return ObservationSet((StaticLoadingObservation("static", np.ones(2), np.ones(2), np.ones(2)),))


def answer(capsys: pytest.CaptureFixture[str], *arguments: str) -> dict:
    capsys.readouterr()
    assert main([*arguments, "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_every_parameter_of_table_one_has_its_source() -> None:
    assert set(TABLE_ONE) == {q.name for kind in (Tactor, Membrane) for q in parameter_specs(kind)}
    known = {name for name, source in TABLE_ONE.items() if source.uncertainty}
    assert known == set(DIMENSIONS)
    for name, source in TABLE_ONE.items():
        assert source.source.startswith(IDENTIFIED) == (name not in known)


def test_a_template_uses_no_value_and_every_line_of_it_is_valid() -> None:
    path = Path("T7.specimen.toml")
    text = sheet_template('T"7')
    empty = parse_sheet(text, path)
    assert (empty.specimen, empty.entries) == ('T"7', {})
    lines = [
        line.removeprefix("#") if "= {" in line and not line.startswith("# ") else line for line in text.splitlines()
    ]
    full = parse_sheet("\n".join(lines), path)
    assert set(full.entries) == set(DIMENSIONS)
    assert asdict(full.tactor) == pytest.approx(asdict(Tactor()))
    assert asdict(full.membrane) == pytest.approx(asdict(Membrane()))
    assert {e.name: e.uncertainty for e in full.values.values()} == pytest.approx(
        {name: TABLE_ONE[name].uncertainty for name in DIMENSIONS}
    )


def test_values_are_set_by_command_and_other_lines_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = ("--folder", str(tmp_path))
    path = sheet_path(tmp_path, "T7")
    assert main(["specimen", "new", "T7", *folder]) == 0
    path.write_text(path.read_text("utf-8") + "\n# my own remark\n", "utf-8")
    given = ("L=22.1 mm ± 0.05 mm", "h_Al=0.203 mm +- 2 %", "serial=MFC-042")
    by = ("--instrument", 'caliper "A"', "--date", "2026-11-20")
    result = answer(capsys, "specimen", "set", "T7", *given, *by, *folder)
    at = result["sheet"]["name"].index("h_Al")
    assert result["sheet"]["value"][at] == pytest.approx(0.203e-3)
    assert result["sheet"]["uncertainty"][at] == pytest.approx(0.00406e-3)
    assert (result["sheet"]["instrument"][at], result["sheet"]["date"][at]) == ('caliper "A"', "2026-11-20")
    assert result["serial"] == "MFC-042"
    assert "# my own remark" in path.read_text("utf-8")
    assert main(["specimen", "set", "T7", "L=22.2 mm +- 0.1 mm", *folder]) == 0
    sheet = load_sheet(tmp_path, "T7")
    assert (sheet.values["L"].value, sheet.serial) == (pytest.approx(22.2e-3), "MFC-042")
    assert not sheet.values["L1"].measured
    before = path.read_bytes()
    for wrong, says in (
        ("L1=30 mm +- 1 mm", "must be less than L2"),
        ("L1=8 mm", "write NAME=VALUE+-ERROR"),
        ("L1=8 g +- 1 g", "not a quantity in m"),
        ("L1=8 mm +- 0 mm", "the uncertainty must be positive"),
        ("colour=8 mm +- 1 mm", "colour is not an identifiable parameter"),
    ):
        assert main(["specimen", "set", "T7", wrong, *folder]) == 2
        assert says in capsys.readouterr().err
    assert path.read_bytes() == before
    assert main(["specimen", "new", "T7", *folder]) == 2
    assert path.name in capsys.readouterr().err
    assert load_sheet(tmp_path, "T7") == sheet


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("line", "says"),
    [
        ("L = 22e-3", "a value needs its uncertainty"),
        ('L = { value = "22 mm" }', "uncertainty is missing"),
        ('L = { value = "22 mm", uncertainty = "0 mm" }', "no instrument is exact"),
        ('L = { value = "22 mm", uncertainty = "1 mm", by = "me" }', "unknown by"),
        ('L = { value = "22 mm", uncertainty = "1 mm", date = "yesterday" }', "date must be a day"),
        ('L = { value = "22 mm", uncertainty = "1 mm", instrument = 3 }', "instrument must be a text"),
        ('L = { mass = "1 g", mass_uncertainty = "1 mg", length = "1 mm", length_uncertainty = "1 um" }', "linear density"),
        ('width = { value = "22 mm", uncertainty = "1 mm" }', "not an identifiable parameter"),
        ("[plates]", "unknown plates"),
        ("serial 4", "not valid TOML"),
    ],
)  # fmt: skip
def test_a_wrong_entry_is_a_sentence(line: str, says: str) -> None:
    with pytest.raises(SheetError, match=says):
        parse_sheet(f'specimen = "T7"\n[plate]\n{line}\n', Path("T7.specimen.toml"))


def test_an_uncertainty_in_percent_is_one_of_its_value() -> None:
    sheet = parse_sheet(
        'specimen = "T7"\n[plate]\nL = { value = "22 mm", uncertainty = "5 %" }\n', Path("T7.specimen.toml")
    )
    assert (sheet.values["L"].value, sheet.values["L"].uncertainty) == pytest.approx((22e-3, 1.1e-3))


def test_a_linear_density_as_weighed() -> None:
    entry = 'rho1 = { mass = "0.588 g", mass_uncertainty = "5 mg", length = "52 mm", length_uncertainty = "0.26 mm" }'
    sheet = parse_sheet(f'specimen = "T7"\n[masses]\n{entry}\n', Path("T7.specimen.toml"))
    rho1 = sheet.values["rho1"]
    assert rho1.value == pytest.approx(0.588e-3 / 52e-3)
    assert rho1.uncertainty / rho1.value == pytest.approx(np.hypot(5 / 588, 0.26 / 52))


def test_a_sheet_enters_the_options_of_a_fit_as_priors() -> None:
    entry = 'L = { value = "22.4 mm", uncertainty = "0.1 mm" }'
    sheet = parse_sheet(f'specimen = "T7"\n[plate]\n{entry}\n', Path("T7.specimen.toml"))
    options = sheet.fit_options(FitOptions(free=("k2", "h_Al"), fixed={"rho1": 1e-2}), loading(), plain=True)
    assert options.tactor.L == 22.4e-3
    assert options.priors["L"] == (22.4e-3, 0.1e-3)
    assert set(options.priors) == {"L", "L1", "L2", "b_Al", "E_Al", "rho2"}  # no membrane in a load test
    usual = set(sheet.fit_options(FitOptions(fixed={"rho1": 1e-2}), loading()).priors) - set(options.priors)
    assert usual == {"h_Al", "creep", "clamp_flexibility"}  # no voltage that hysteresis acts on
    assert options.free is not None
    assert set(options.free) == {"k2", "h_Al", *options.priors}
    hanging = MembraneSagObservation("sag", np.ones(1), np.ones(1), geometry=Membrane())
    assert not SpecimenSheet().fit_options(FitOptions(), ObservationSet((hanging,))).priors  # a strip of its own


@pytest.mark.deep
def test_identify_states_where_its_dimensions_are_from(
    static: Path, capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    capsys.readouterr()
    assert main(["identify", str(static)]) == 0
    first = capsys.readouterr().out.splitlines()[:3]
    assert first[0].startswith("assumed, because neither sheet nor runs determine it: creep")
    assert first[1].startswith(
        "no specimen sheet: dimensions are from the paper's Table I with the uncertainties of ruler"
    )
    assert "'tactor-bench specimen new T7' writes one: L 22.00 ± 0.30 mm, L1 8.00 ± 0.30 mm" in first[1]
    assert first[2].startswith("held as exact")
    table = answer(capsys, "identify", str(static), "--plain")
    folder = ("--folder", str(static.parent))
    given = ("L=22 mm +- 0.02 mm", "L1=8 mm +- 0.02 mm", "L2=15 mm +- 0.1 mm", "h_Al=0.2 mm +- 0.5 %")
    assert main(["specimen", "set", "T7", *given, *folder]) == 0
    better = answer(capsys, "identify", str(static), "--plain")
    exact = answer(capsys, "identify", str(static), "--sheet", "none")
    errors = [each["parameters"]["relative"][0] for each in (table, better, exact)]
    assert 0.05 < errors[0] < 0.15
    assert errors[0] > 5 * errors[1] > 25 * errors[2]
    assert better["dimensions"].startswith("specimen sheet T7.specimen.toml: 4 measured values; b_Al, ")
    assert exact["dimensions"] == ""
    shares = table["uncertainties"]["shares"][0]
    assert shares.index("h_Al") < shares.index("L ")
    assert tb.identify(static, sheet="none").estimates["k2"].standard_error == exact["parameters"]["standard_error"][0]


def test_what_is_implausible_in_a_sheet_is_questioned(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = ("--folder", str(tmp_path))
    assert main(["specimen", "check", "T7", *folder]) == 2
    assert "'tactor-bench specimen new T7' writes one" in capsys.readouterr().err
    day = ("--date", "2096-01-01")
    assert main(["specimen", "set", "T7", "h_Al=20 mm +- 0.1 mm", "photograph=t7.jpg", *day, *folder]) == 0
    capsys.readouterr()
    assert main(["specimen", "check", "T7", *folder]) == 1
    said = capsys.readouterr().out
    for question in (
        "h_Al is 20 mm, usually",
        "the instrument is missing",
        "is in the future",
        "there is no photograph",
    ):
        assert question in said


def test_a_sheet_is_the_model_of_a_specimen_without_a_calibration(tmp_path: Path) -> None:
    assert load_active_model(tmp_path, "T7") is PAPER_MODEL
    path = sheet_path(tmp_path, "T7")
    path.write_text('specimen = "T7"\n[plate]\nL = { value = "22.4 mm", uncertainty = "0.1 mm" }\n', "utf-8")
    active = load_active_model(tmp_path, "T7")
    assert (active.tactor.L, active.estimates) == (22.4e-3, None)
    assert active.description == "the paper's values with the dimensions of T7.specimen.toml"
    for other in ("T8", "t7"):
        path.write_text(f'specimen = "{other}"\n', "utf-8")
        wrong = load_active_model(tmp_path, "T7")
        assert wrong.tactor == Tactor()
        assert_names(wrong.problem, other, "T7")


@pytest.mark.deep
def test_a_calibration_keeps_what_was_known_beforehand(static: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["identify", str(static), "--accept", "--reason", "for the mount only"]) == 0
    kept = tb.calibration("T7", static.parent)
    assert set(kept.known) == {"L", "L1", "L2", "b_Al", "h_Al", "E_Al", "rho1", "rho2", "creep", "clamp_flexibility"}
    assert kept.known["L"] == (22e-3, 0.3e-3)
    assert kept.statistical["k2"] < 0.1 * next(e.standard_error for e in kept.estimates if e.name == "k2")
    capsys.readouterr()
    assert main(["calibration", "show", "T7", "--folder", str(static.parent)]) == 0
    shown = capsys.readouterr().out
    assert "Prior values, and values with the runs" in shown
    assert kept.dimensions
    assert kept.dimensions in " ".join(shown.split())


@pytest.mark.deep
def test_the_report_has_dimensions_sources_and_both_uncertainties(static: Path, tmp_path: Path) -> None:
    given = ("L=22 mm +- 0.1 mm", "serial=MFC-042")
    assert main(["specimen", "set", "T7", *given, "--instrument", "steel rule", "--folder", str(static.parent)]) == 0
    assert main(["report", "T7", "--full", "--folder", str(static.parent), "--out", str(tmp_path)]) == 0
    page = (tmp_path / "T7_report.html").read_text("utf-8")
    for text in ("steel rule", "MFC-042", "Sources of the uncertainties", "statistical", "directly measured (ruler)",
                 "Exact for want of a stated uncertainty",
                 "Uncertainty budget", "share of the squared total", "Held as exact: mu -13.3 N mm/kV"):  # fmt: skip
        assert text in page, text


@pytest.mark.deep
def test_uncertainties_of_slopes_and_delay_of_the_bench_file_enter_the_fit(tmp_path: Path) -> None:
    """mu is never better known than the slopes of the amplifier."""
    config = simulated(seed=3)
    slopes = config.amplifier.model_copy(update={"slope_relative_uncertainty": 0.01})
    late = config.sensor.model_copy(update={"delay_uncertainty_s": 5e-6})
    with laboratory(config.model_copy(update={"amplifier": slopes, "sensor": late})) as lab:
        path = run(SineDwell(frequencies_hz=(50, 100, 145, 160, 200), record_s=0.1), tmp_path, lab).path
        sensor = lab.bench.sensor
    found = tb.identify(path, sheet="none")
    assert found.budget is not None
    shares = dict(zip(found.budget.sources, found.budget.components[:, found.names.index("mu")], strict=True))
    assert shares["slopes of AMT2012-CE3"] == pytest.approx(0.01 * abs(found.tactor.mu), rel=0.02)
    of_sensor = [source for source in found.budget.sources if source.endswith(f" {sensor.name} {sensor.serial}")]
    assert [source.split()[0] for source in of_sensor] == ["gain", "delay"]
    assert not unstated_errors(found.result)


@pytest.mark.deep
def test_a_length_that_the_runs_contradict_is_named(static: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With k2 known, a load test tells the length."""
    capsys.readouterr()
    known = ("--prior", "k2=0.007 N m^2 +- 0.1 %", "--prior", "h_Al=0.2 mm +- 0.1 %", "--prior", "L=24 mm +- 0.2 mm")
    result = answer(capsys, "identify", str(static), "--plain", *known)
    (text,) = (text for text in result["contradictions"] if text.startswith("the runs contradict L:"))
    assert re.match(r"the runs contradict L: 24\.00 ± 0\.20 mm was known, [\d.]+ ± [\d.]+ mm fits", text)


def test_the_repeatability_of_mountings_is_a_table_of_the_sheet(tmp_path: Path) -> None:
    path = tmp_path / "T1.specimen.toml"
    path.write_text('specimen = "T1"\n[mounting]\nmass = "0.05 g"\nplate = "0.5 %"\nlaser = 0.001\n')
    assert read_sheet(path).mountings == {
        "mass": pytest.approx(5e-5),
        "plate": pytest.approx(5e-3),
        "laser": pytest.approx(1e-3),
    }
    for line, fact in (
        ('roof = "1 mm"', "roof"),
        ('mass = "0 g"', "mass"),
        ('mass = "1 mm"', "mass"),
        ("mass = []", "mass"),
    ):
        path.write_text(f'specimen = "T1"\n[mounting]\n{line}\n')
        with pytest.raises(SheetError) as caught:
            read_sheet(path)
        assert_names(str(caught.value), str(path), "mounting", fact)
    created = create_sheet(tmp_path, "T2")
    assert created.mountings == {}
    assert created.path is not None
    text = created.path.read_text("utf-8")
    created.path.write_text(text.replace('#mass = "0.1 g"', 'mass = "0.1 g"'))
    assert read_sheet(created.path).mountings == {"mass": pytest.approx(1e-4)}
