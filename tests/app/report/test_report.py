"""Report of a specimen: correct statements, SIMULATED on every page, verdicts on limits, reproducible bytes."""

import hashlib
import json
import re
import shutil
import subprocess
import sys
from base64 import b64encode
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import h5py
import numpy as np
import pytest

from app.archive import Catalogue
from app.cli import report as command
from app.cli.main import main
from app.common import typeset
from app.common.text_table import Table
from app.fleet.catalogue_values import read_fleet
from app.plotting.panels import ReportPlot, new_figure
from app.report import drawings, pdf
from app.report.content import ReportError, build_report, page_marks
from app.report.document import Paragraph, Report
from app.report.figures_of_merit import perception_margin_of, step_latency_of
from app.report.runs import ReportRun, read_report_runs
from app.report.signature import verification_command
from app.report.specimen import SpecimenModel
from model import EstimatedQuantity, quantity_label
from model.amplifier_map import AmplifierMap
from model.parameters import Membrane, Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response
from protocols.base import Outcome, Quality, Verdict
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.reader import Run
from protocols.runfile.writer import store_verdict
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import TRUTH, blocks_of, texts_of_pages
from tests.helpers.simulated_bench import laboratory, run

pytestmark = pytest.mark.deep


@pytest.fixture
def copy(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / "runs"))


def texts(report: Report) -> str:
    """All words and all cells of a report."""
    paragraphs = [block.text for block in blocks_of(report, Paragraph)]
    cells = [cell for grid in blocks_of(report, Table) for row in grid.rows for cell in row]
    return "\n".join([*paragraphs, *cells])


def change(path: Path, act: Callable[[Any], None]) -> None:
    with h5py.File(path, "r+") as file:
        act(file["entry"])


def replaced(entry: Any, name: str, value: Any) -> None:
    del entry[name]
    entry[name] = value


@dataclass(frozen=True)
class Written:
    """A report on disk, the texts of its pages, and the runs it is of."""

    runs: Path
    out: Path
    pages: list[str]


@pytest.fixture(scope="module")
def written(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Written:
    runs, out = tmp_path_factory.mktemp("of"), tmp_path_factory.mktemp("report")
    shutil.copy(next(folder.glob("*sine-dwell.h5")), runs)  # one run draws all kinds of pages
    assert main(["report", "T1", "--full", "--folder", str(runs), "--out", str(out)]) == 0
    return Written(runs, out, texts_of_pages(out / "T1_report.pdf"))


@pytest.mark.deep
def test_every_page_says_simulated_and_every_file_is_named_with_its_checksum(written: Written) -> None:
    assert not list(written.out.glob("*.part"))
    assert len(written.pages) >= 4
    for at, page in enumerate(written.pages, 1):
        assert "Specimen T1 SIMULATED" in page  # in its head
        assert page.count("SIMULATED") >= 2, page  # across it
        assert f"page {at} " in page
        assert f"of {len(written.pages)} fingerprint" in page
    assert f"{quantity_label('frequency')} (Hz)" in "".join(written.pages)  # texts of plots too
    html = (written.out / "T1_report.html").read_text("utf-8")
    assert "class='mark'" in html
    assert "class='banner'>SIMULATED" in html
    assert "<h2>Every run</h2>" in html
    (step,) = (caption for caption in re.findall("<caption>(.*?)</caption>", html) if "1500" in caption)
    assert "model" in step
    for path in written.runs.glob("*.h5"):
        assert path.name in html
        assert hashlib.sha256(path.read_bytes()).hexdigest() in html


@pytest.mark.deep
def test_two_reports_of_the_same_files_are_the_same_bytes(written: Written, tmp_path: Path) -> None:
    """Also of a program without threads, which draws in two processes."""
    words = ["report", "T1", "--full", "--folder", str(written.runs), "--out", str(tmp_path)]
    ran = subprocess.run(
        [sys.executable, "-m", "app.cli.main", *words], capture_output=True, text=True, check=False, timeout=120
    )
    assert ran.returncode == 0, ran.stderr
    assert "Traceback" not in ran.stderr
    for name in ("T1_report.pdf", "T1_report.html"):
        assert (tmp_path / name).read_bytes() == (written.out / name).read_bytes()


@pytest.mark.deep
def test_by_default_it_has_two_pages_with_the_laboratory_and_its_picture(
    written: Written, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    logo = tmp_path / "logo.png"
    picture = new_figure(figsize=(1, 0.3))
    picture.savefig(logo)
    words = ["report", "T1", "--folder", str(written.runs), "--out", str(tmp_path), "--laboratory", "Haptics <Lab>"]
    assert main([*words, "--logo", str(logo)]) == 0
    written_pdf, html = (tmp_path / "T1_report.pdf").read_bytes(), (tmp_path / "T1_report.html").read_text("utf-8")
    first, second = texts_of_pages(tmp_path / "T1_report.pdf")
    assert "Haptics <Lab>" in first
    assert "Checked by" in first
    assert "Fig. 12" in second
    assert b"/Subtype /Image" in written_pdf
    assert "Haptics &lt;Lab&gt;" in html
    assert f"data:image/png;base64,{b64encode(logo.read_bytes()).decode()}" in html
    assert "<h2>Every run</h2>" not in html
    capsys.readouterr()
    assert main([*words, "--logo", str(written.runs)]) == 2
    assert_names(capsys.readouterr().err, written.runs)
    logo.write_bytes(b"GIF89a")
    assert main([*words, "--logo", str(logo)]) == 2
    assert "is no PNG picture of at most 2 MB; convert it, or leave it out" in capsys.readouterr().err


@pytest.mark.deep
@pytest.mark.skipif(shutil.which("ssh-keygen") is None, reason="OpenSSH is not installed")
def test_a_signature_verifies_until_the_report_is_changed(
    written: Written, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    key = tmp_path / "key"
    subprocess.run(["ssh-keygen", "-q", "-t", "ed25519", "-N", "", "-f", str(key)], check=True)
    words = ["report", "T1", "--folder", str(written.runs), "--out", str(tmp_path), "--sign", str(key)]
    assert main(words) == 2
    assert_names(capsys.readouterr().err, "--sign", "--by")
    assert not (tmp_path / "T1_report.pdf").exists()
    assert main([*words, "--by", "K. Tanaka"]) == 0
    assert "-I 'K. Tanaka'" in capsys.readouterr().err
    (tmp_path / "allowed_signers").write_text(f'"K. Tanaka" {key.with_suffix(".pub").read_text()}')
    report = tmp_path / "T1_report.pdf"

    def verified() -> bool:
        command = verification_command(report, "K. Tanaka")
        return subprocess.run(command, shell=True, cwd=tmp_path, capture_output=True, check=False).returncode == 0

    assert verified()
    assert "Signed by K. Tanaka" in (tmp_path / "T1_report.html").read_text("utf-8")
    report.write_bytes(report.read_bytes().replace(b"/Title", b"/Titel"))
    assert not verified()
    key.write_text("no key")
    assert main([*words, "--by", "K. Tanaka"]) == 2
    assert "the report is written, but not signed" in capsys.readouterr().err


def test_what_the_first_page_says_is_what_the_plant_is(
    gathered: tuple[Report, SpecimenModel, tuple[ReportRun, ...]],
) -> None:
    report, known, _ = gathered
    assert report.page_marks == ("SIMULATED",)
    merits = {m["name"]: m for m in report.record["merits"]}  # type: ignore[attr-defined]
    for name in ("mu", "c0"):  # their errors are those of a ruler
        assert abs(merits[name]["value"] - getattr(TRUTH, name)) < 3 * merits[name]["standard_error"]
        assert merits[name]["standard_error"] < 0.15 * abs(getattr(TRUTH, name))
    # The peak as measured, against the plant of seven shape functions, and against the twelve interface conditions solved at
    # every frequency, beside which the plant is stiff by a thousandth.
    f = np.arange(130.0, 165.0, 0.005)
    exact = 2 * 1000.0 * np.abs(exact_response(TRUTH, f))
    resonance, plant = merits["peak_frequency"], np.abs(frequency_response(TRUTH, f))
    assert abs(resonance["value"] - f[plant.argmax()]) < 3 * resonance["standard_error"] < 0.5  # points are 10 Hz apart
    assert resonance["value"] == pytest.approx(f[exact.argmax()], rel=2e-3)
    assert merits["amplitude_at_resonance"]["value"] == pytest.approx(exact.max(), rel=0.01)
    assert merits["amplitude_at_resonance"]["standard_error"] > 0.0019 * exact.max()  # 0.2 % of the sensor's gain
    at_top = 2 * 1000.0 * float(np.abs(exact_response(TRUTH, np.array([250.0])))[0]) / 50e-6
    assert merits["smallest_margin"]["value"] == pytest.approx(at_top, rel=0.01)
    assert known.identifies_free_response


def test_margin_and_latency_of_the_papers_tactor_are_the_settled_numbers() -> None:
    table = SpecimenModel(Tactor(), Membrane(), AmplifierMap(), None)
    soon = step_latency_of(table)
    assert soon is not None
    assert soon.latency is not None
    assert soon.latency.value == pytest.approx(0.56e-3, abs=0.01e-3)
    assert soon.overshoot == pytest.approx(0.51, abs=0.005)
    free, pressed = perception_margin_of(table, None), perception_margin_of(table, 6.35e-3)
    assert free is not None
    assert pressed is not None
    assert free.margin == pytest.approx(
        291.1 / 50, rel=1e-3
    )  # of the exact solution; the paper's seven shapes give 291.8
    assert free.felt_bands == ((5.0, 250.0),)
    assert np.interp(
        200.0, np.concatenate((np.linspace(5, 37.5, 14), np.linspace(40, 250, 85))), pressed.band.centre
    ) == (pytest.approx(91.9e-6, rel=5e-3))


def test_r_and_residuals_are_those_of_the_drawn_points(
    gathered: tuple[Report, SpecimenModel, tuple[ReportRun, ...]],
) -> None:
    report, _, _ = gathered
    plots = {plot.title: plot for plot in blocks_of(report, ReportPlot)}
    (dots,) = plots["Fig. 9: frequency response"].panels[0].points
    assert dots.fit is not None
    (table,) = [g for g in blocks_of(report, Table) if g.title == "Validation curves"]
    row = next(row for row in table.rows if row[0].startswith("Fig. 9"))
    assert float(row[2]) == pytest.approx(np.corrcoef(dots.y, dots.fit)[0, 1], abs=1e-4)
    assert float(row[5].split()[0]) == pytest.approx(float(np.sqrt(np.mean((dots.y - dots.fit) ** 2))), rel=5e-3)
    assert (np.abs(dots.y - dots.fit) < 2 * dots.errors).all()


def test_a_flagged_point_is_hollow_out_of_the_fit_and_counted(copy: Path) -> None:
    path = next(copy.glob("*sine-dwell.h5"))

    def flag(entry: Any) -> None:
        entry["points/quality"][4] = int(Quality.CLIPPED | Quality.SIMULATED)
        entry["points/peak_to_peak"][4] *= 3
        entry["points/fundamental"][4] *= 3

    change(path, flag)
    report, _, _ = build_report(copy, "T1")
    assert "1 clipped" in texts(report)
    (dots,) = next(p for p in blocks_of(report, ReportPlot) if "Fig. 9" in p.title).panels[0].points
    assert dots.usable.tolist() == [True, True, True, True, False]
    mu = next(m for m in report.record["merits"] if m["name"] == "mu")  # type: ignore[attr-defined]
    assert mu["value"] == pytest.approx(TRUTH.mu, rel=0.05)
    # Steps and a dwell determine the ratio of moment and stiffness: the wide prior of the stiffness is in the error.
    assert 0.05 < mu["standard_error"] / abs(TRUTH.mu) < 0.15


def test_a_damaged_run_is_named_and_a_run_that_was_gone_on_with_counts_once(copy: Path) -> None:
    first = next(copy.glob("*sine-dwell.h5"))
    later = copy / "20991231T000000Z_T1_sine-dwell.h5"
    shutil.copy(first, later)
    change(later, lambda entry: replaced(entry, "continues", first.name))
    cut = copy / "20991231T000001Z_T1_sweep.h5"
    cut.write_bytes(first.read_bytes()[:20_000])
    runs = read_report_runs(copy, "T1")
    by_name = {run.name: run for run in runs}
    assert by_name[first.name].exclusion_reason == f"its points are continued in {later.name}"
    assert_names(by_name[cut.name].problem, cut.name, "cut", 20_000, first.stat().st_size)
    assert sum(bool(r.observations) and not r.exclusion_reason for r in runs) == 2


def test_runs_are_listed_with_their_verdicts_and_without_a_result_are_not_used(copy: Path) -> None:
    dwell, steps = next(copy.glob("*sine-dwell.h5")), next(copy.glob("*voltage-steps.h5"))
    for path, outcome, reason in (
        (dwell, Outcome.NO_RESULT, "no usable point of 5; look under the laser"),
        (steps, Outcome.DOUBTFUL, "2 of 4 clipped; choose a larger range"),
    ):
        with h5py.File(path, "r+") as file:
            store_verdict(file, Verdict(outcome, (reason,)))
    report, known, _ = build_report(copy, "T1")
    said = texts(report)
    assert (
        f"{dwell.name} is left out of the identification: no result: no usable point of 5; look under the laser" in said
    )
    assert "Doubtful: 2 of 4 clipped in steps" in said
    (table,) = [t for t in blocks_of(report, Table) if t.title.startswith("Runs and the quality")]
    verdicts = {dwell.name: Outcome.NO_RESULT.value, steps.name: Outcome.DOUBTFUL.value}
    assert {row[0]: row[3] for row in table.rows} == verdicts
    cards = {t.title: t for t in blocks_of(report, Table) if t.title.startswith(("sine-dwell, ", "voltage-steps, "))}
    assert list(cards) == [
        f"sine-dwell, {dwell.name}: ○ NO RESULT, SIMULATED",
        f"voltage-steps, {steps.name}: △ DOUBTFUL, SIMULATED",
    ]
    with Run(dwell) as measured:
        names = [typeset(estimate.name).replace("_", " ") for estimate in measured.record.estimates]
    rows = [row[0] for row in next(iter(cards.values())).rows]
    assert rows[1].split()[0] == "largest"
    assert [*rows[:1], *rows[2:]] == names
    assert known.identification is not None
    assert len(known.identification.observations.runs) == 1
    assert {run["file"]: run["verdict"] for run in report.record["runs"]} == verdicts


@pytest.mark.deep
def test_a_copy_in_a_folder_below_counts_once(copy: Path) -> None:
    first = next(copy.glob("*sine-dwell.h5"))
    (copy / "backup").mkdir()
    shutil.copy(first, copy / "backup")
    report, known, _ = build_report(copy, "T1")
    (reason,) = (run.exclusion_reason for run in read_report_runs(copy, "T1") if run.path.parent.name == "backup")
    assert_names(reason, "copy", first.name)
    assert any(f"backup/{first.name} " in line and line.endswith(f": {reason}.") for line in texts(report).splitlines())
    assert known.identification is not None
    assert len(known.identification.observations.runs) == 2


def test_real_runs_are_not_marked_and_simulated_ones_beside_them_take_no_part(copy: Path) -> None:
    real = next(copy.glob("*sine-dwell.h5"))
    change(real, lambda entry: replaced(entry, "simulated", False))
    runs = read_report_runs(copy, "T1")
    assert page_marks(runs) == ()
    assert [run.exclusion_reason for run in runs] == ["", "it is simulated, and there are real runs"]
    change(real, lambda entry: entry.create_dataset("imported", data=json.dumps({"files": []})))
    change(real, lambda entry: entry["points/quality"].__setitem__(slice(None), int(Quality.IMPORTED)))
    runs = read_report_runs(copy, "T1")
    assert page_marks(runs) == ("IMPORTED",)
    assert not runs[0].flag_counts  # where it comes from is no fault of a point
    change(real, lambda entry: replaced(entry, "simulated", True))
    assert page_marks(read_report_runs(copy, "T1")) == ("SIMULATED", "IMPORTED IN PART")


def test_a_table_with_fundamentals_only_is_drawn_against_the_models_fundamental(copy: Path) -> None:
    for path in copy.glob("*sine-dwell.h5"):
        change(path, lambda entry: entry["points/peak_to_peak"].__setitem__(slice(None), np.nan))
    report, _, _ = build_report(copy, "T1")
    panel = next(p for p in blocks_of(report, ReportPlot) if "Fig. 9" in p.title).panels[0]
    assert panel.y_label == "2 x fundamental (µm)"
    (dots,) = panel.points
    exact = 2e6 * 1000.0 * np.abs(exact_response(TRUTH, dots.x))
    assert dots.y == pytest.approx(exact, rel=0.01)
    assert dots.fit == pytest.approx(exact, rel=0.01)


def test_what_cannot_be_identified_is_said_and_nothing_is_claimed_of_it(copy: Path) -> None:
    next(copy.glob("*voltage-steps.h5")).unlink()
    change(next(copy.glob("*sine-dwell.h5")), lambda entry: entry["points/quality"].__setitem__(slice(1, 5), 1))
    report, known, _ = build_report(copy, "T1")
    messages = texts(report)
    assert "Not identifiable from these runs: mu and m_add and c0: relative changes of" in messages
    assert "No statement on threshold and latency" in messages
    assert not known.identifies_free_response
    # The run's own estimates stand, which were stored with it; none is of a model.
    stored = {"natural_frequency", "damped_frequency", "damping_ratio", "quality_factor", "peak_frequency"}
    assert {merit["name"] for merit in report.record["merits"]} == stored


def test_an_expired_calibration_stands_out(copy: Path) -> None:
    for path in copy.glob("*.h5"):

        def expire(entry: Any) -> None:
            known = json.loads(entry["configuration"].asstr()[()])
            known["sensor"] |= {"calibrated": "2019-05-04", "expires": "2020-05-04"}
            replaced(entry, "configuration", json.dumps(known))
            replaced(entry, "instrument/displacement_sensor/calibrated", "2019-05-04")

        change(path, expire)
    report, _, _ = build_report(copy, "T1")
    (grid,) = [g for g in blocks_of(report, Table) if g.title == "Instruments and their calibration"]
    (bad,) = [grid.rows[i] for i in grid.highlighted_rows]
    assert bad[0] == "Sensor"
    assert bad[2:5] == ("2019-05-04", "2020-05-04", "overdue in 2 runs")


def test_a_specimen_whose_runs_tell_nothing_of_the_model_still_has_its_report(tmp_path: Path) -> None:
    with laboratory() as lab:
        run(WiringCheck(record_s=0.5, wait_s=0.2), tmp_path, lab)
    report, known, _ = build_report(tmp_path, "T1")
    assert "Nothing is identified: no run constrains the model" in texts(report)
    assert not blocks_of(report, ReportPlot)
    assert not known.identified_names


def test_a_report_of_nothing_is_a_sentence(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["report", "T9", "--folder", str(tmp_path)]) == 2
    assert "there is no run of specimen 'T9'" in capsys.readouterr().err
    with pytest.raises(ReportError, match="there is no run of specimen 'T9'"):
        build_report(tmp_path, "T9")


@pytest.mark.deep
def test_a_name_is_no_formula_and_no_markup(copy: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    name = r"a$\frac$<b>&"
    next(copy.glob("*sine-dwell.h5")).unlink()
    for path in copy.glob("*.h5"):
        change(path, lambda entry: (replaced(entry, "specimen", name), replaced(entry, "title", f"Steps of {name}")))
    assert main(["report", name, "--folder", str(copy), "--out", str(tmp_path)]) == 0, capsys.readouterr().err
    assert r"<h1>Specimen a$\frac$&lt;b&gt;&amp;</h1>" in next(tmp_path.glob("*.html")).read_text("utf-8")


@pytest.mark.deep
@pytest.mark.parametrize("where", [(drawings, "run_figure"), (pdf, "TextLines")], ids=["a run", "a page"])
def test_interrupted_it_leaves_what_was_there(
    folder: Path, gathered: Any, where: tuple[Any, str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    (tmp_path / "T1_report.pdf").write_text("before")
    report, known, runs = gathered
    monkeypatch.setattr(command, "build_report", lambda *_: (replace(report, first_page=(), appendix=()), known, runs))
    monkeypatch.setattr(drawings.threading, "active_count", lambda: 2)  # no copy of the process

    def interrupted(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(*where, interrupted)
    assert main(["report", "T1", "--full", "--folder", str(folder), "--out", str(tmp_path)]) == 1
    assert capsys.readouterr().err == "tactor-bench: interrupted\n"
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [("T1_report.pdf", "before")]


def test_a_band_has_the_share_of_the_added_mass_that_acts() -> None:
    """What the beam model leaves out is no variable of the model, but a parameter of the fit."""
    estimates = (
        EstimatedQuantity("mu", -1.3e-5, 1e-7, "N m/V", ""),
        EstimatedQuantity("mass_fraction", 0.7, 0.01, "", ""),
    )
    found: Any = SimpleNamespace(estimates=estimates, covariance=np.diag([1e-14, 1e-4]), unidentified=())
    band = SpecimenModel(Tactor(), Membrane(), AmplifierMap(), found).curve_with_band(
        lambda tactor, _, effects: np.array([tactor.mu, 3 * effects["mass_fraction"]])
    )
    assert band is not None
    assert band.standard_error == pytest.approx([1e-7, 0.03])


def test_report_and_fleet_agree_on_a_specimen(
    folder: Path, gathered: tuple[Report, SpecimenModel, tuple[ReportRun, ...]]
) -> None:
    merits = {each["name"]: each for each in gathered[0].record["merits"]}  # type: ignore[attr-defined]
    catalogue = Catalogue(folder)
    catalogue.scan()
    fleet = read_fleet(folder, catalogue)
    for name in ("natural_frequency", "damped_frequency", "damping_ratio", "peak_frequency", "amplitude_at_resonance"):
        (value,) = fleet.of(name).newest
        figure = merits[name]
        assert figure["value"] == pytest.approx(value.value, rel=1e-12), name
        # The peak of the report is computed from the observations, whose errors contain those of the harmonics.
        assert figure["standard_error"] == pytest.approx(value.total, rel=0.02 if name == "peak_frequency" else 1e-3), (
            name
        )
        assert figure["source"] == Path(value.path).stem
