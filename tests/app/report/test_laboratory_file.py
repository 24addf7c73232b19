"""Laboratory file beside the runs: its threshold wherever one is shown, and its template of the report."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.common import UsageError
from app.config import EXAMPLE_LABORATORY, LABORATORY_FILE_NAME, read_laboratory
from app.identification import chosen_threshold
from app.plotting.run_picture import run_figure
from app.report.content import FULL_SECTIONS, SHORT_SECTIONS, ReportError, build_report
from model import Specimen
from model.response import ABDOMEN_THRESHOLD, UNCOMFORTABLE_HZ
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import texts_of_pages

TEMPLATE = """
name = "Haptics"
threshold = "own.csv"
[report]
header = "Confidential <draft>"
footer = "Form QM-17"
sections = ["method", "uncertainties"]
[report.texts.method]
title = "Method"
text = "Procedure P-12."
"""
CURVE = "frequency,threshold\n50,20\n200,5\n"


@pytest.fixture
def lab(folder: Path, tmp_path: Path) -> Path:
    copy = Path(shutil.copytree(folder, tmp_path / "runs"))
    (copy / LABORATORY_FILE_NAME).write_text(TEMPLATE)
    (copy / "own.csv").write_text(CURVE)
    return copy


def test_without_a_file_nothing_is_stated_and_the_abdomen_is_meant(tmp_path: Path) -> None:
    assert read_laboratory(tmp_path).sections == ()
    assert chosen_threshold(tmp_path) is ABDOMEN_THRESHOLD


def test_every_fault_is_listed_with_its_line(tmp_path: Path) -> None:
    (tmp_path / LABORATORY_FILE_NAME).write_text('nam = "x"\n[report]\nheader = 5\n[report.texts.a]\ntitle = "A"\n')
    with pytest.raises(UsageError) as caught:
        read_laboratory(tmp_path)
    text = str(caught.value)
    assert "line 1: nam: unknown key" in text
    assert "line 3: report.header: " in text
    assert "report.texts.a.text: field required" in text
    (tmp_path / LABORATORY_FILE_NAME).write_text('threshold = "elbow"\n')
    with pytest.raises(UsageError, match=r"laboratory\.toml: threshold 'elbow': neither a site"):
        chosen_threshold(tmp_path)


def test_the_example_is_a_laboratory_file(tmp_path: Path) -> None:
    text = EXAMPLE_LABORATORY.format(sections=", ".join((*SHORT_SECTIONS, *FULL_SECTIONS)))
    keys = ("threshold", "header", "footer", "sections", "[report", "title", "text")
    for line in text.splitlines():
        if line.removeprefix("# ").startswith(keys):
            text = text.replace(line, line.removeprefix("# "))
    (tmp_path / LABORATORY_FILE_NAME).write_text(text)
    found = read_laboratory(tmp_path)
    assert found.sections == ("method", "skin", "uncertainties")
    assert found.texts["method"][0] == "Method"
    assert chosen_threshold(tmp_path).label == "volar forearm, hairy skin"


@pytest.mark.deep
def test_one_threshold_is_in_report_fleet_and_pictures(lab: Path, capsys: pytest.CaptureFixture[str]) -> None:
    threshold = chosen_threshold(lab)
    assert threshold.amplitude_at(100.0) == pytest.approx(10e-6)
    report, _, _ = build_report(lab, "T1", threshold=threshold, full=False)
    (panel,) = next(block.panels for block in report.first_page if getattr(block, "title", "") == "Frequency response")
    assert np.interp(100.0, panel.reference.x, panel.reference.y) == pytest.approx(10, rel=0.01)
    assert panel.shaded == (*UNCOMFORTABLE_HZ, "uncomfortable")
    plot = next(block for block in report.first_page if getattr(block, "title", "") == "Frequency response")
    assert "felt, own (file own.csv)" in plot.caption
    assert "uncomfortable" in plot.caption
    with Run(next(lab.glob("*dwell*.h5"))) as run:
        axes = run_figure(run, Specimen(), threshold).axes[0]
    line = next(each for each in axes.lines if each.get_linestyle() == "--" and each.get_color() == "tab:green")
    assert np.interp(100.0, *line.get_data()) == pytest.approx(10, rel=0.01)
    assert main(["fleet", str(lab), "--quantity", "margin_at_resonance", "--json"]) == 0
    own = json.loads(capsys.readouterr().out)["quantities"]
    assert main(["fleet", str(lab), "--quantity", "margin_at_resonance", "--json", "--threshold", "abdomen"]) == 0
    abdomen = json.loads(capsys.readouterr().out)["quantities"]
    assert "over own" in own["source"][0]
    assert "over 50 µm on the abdomen" in abdomen["source"][0]
    at_peak = float(threshold.amplitude_at(150.0))
    assert own["mean"][0] == pytest.approx(abdomen["mean"][0] * 50e-6 / at_peak, rel=0.1)


@pytest.mark.deep
def test_the_template_sets_header_footer_sections_and_own_texts(lab: Path, tmp_path: Path) -> None:
    out = tmp_path / "out"
    assert main(["report", "T1", "--folder", str(lab), "--out", str(out)]) == 0
    html = (out / "T1_report.html").read_text("utf-8")
    places = [html.index(word) for word in ("Confidential &lt;draft&gt;", "<strong>Haptics", "<h2>Method</h2>", "Procedure P-12.", "What limits the uncertainties", "Form QM-17")]  # fmt: skip
    assert places == sorted(places)
    assert "<h2>On skin</h2>" not in html
    full, _, _ = build_report(lab, "T1", laboratory=read_laboratory(lab))
    for page in texts_of_pages(out / "T1_report.pdf"):
        assert "Confidential <draft>" in page
        assert "Form QM-17" in page
    titles = [section.title for section in full.appendix]
    expected = ["Parameters and their source", "Method", "What limits the uncertainties"]
    assert titles[:3] == expected
    assert "Where the numbers come from" in titles


@pytest.mark.deep
def test_a_laboratorys_own_template_makes_the_page(
    lab: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = lab / "page.html"
    assert main(["report", "--new-template", str(page)]) == 0
    (lab / LABORATORY_FILE_NAME).write_text('name = "O\'Neill & Sons"\n[report]\ntemplate = "page.html"\n')
    command = ["report", "T1", "--folder", str(lab), "--out", str(tmp_path)]
    assert main(command) == 0
    same = (tmp_path / "T1_report.html").read_bytes()
    (lab / LABORATORY_FILE_NAME).write_text('name = "O\'Neill & Sons"\n')
    assert main(command) == 0
    assert (tmp_path / "T1_report.html").read_bytes() == same
    (lab / LABORATORY_FILE_NAME).write_text('name = "O\'Neill & Sons"\n[report]\ntemplate = "page.html"\n')
    needed = "{{ marks }} {{ fingerprint }} {{ signatures | join(' ') }}"
    page.write_text(f'<h1>{{{{ laboratory.name }}}}</h1>{{{{ parts["Key figures"] }}}}{needed}', "utf-8")
    assert main(command) == 0
    own = (tmp_path / "T1_report.html").read_text("utf-8")
    assert own.startswith("<h1>O&#39;Neill &amp; Sons</h1>")
    assert own.count("<table") == 1
    capsys.readouterr()
    for text, names in (
        (f"{needed}\n\n{{{{ nobody }}}}", ("3", "nobody")),
        (f"{needed}\n{{% if %}}", ("2",)),
        ("{{ fingerprint }}", ("SIMULATED",)),
        ("{{ title.__class__.__mro__ }}", ("1", "__class__")),
        ("{% include 'laboratory.toml' %}", ("1",)),
        ("\n{{ 1 / 0 }}", ("2", "zero")),
    ):
        page.write_text(text, "utf-8")
        assert main(command) == 2
        said = capsys.readouterr().err
        assert_names(said, *names)
        assert "Traceback" not in said
        assert (tmp_path / "T1_report.html").read_text("utf-8") == own
    page.unlink()
    assert main(command) == 2
    assert_names(capsys.readouterr().err, "page.html", "template")


@pytest.mark.deep
def test_a_section_that_does_not_exist_is_named(lab: Path) -> None:
    (lab / LABORATORY_FILE_NAME).write_text('[report]\nsections = ["skn"]\n')
    with pytest.raises(
        ReportError, match="asks for the section 'skn'; there are parameters, uncertainties, skin, figures"
    ):
        build_report(lab, "T1", laboratory=read_laboratory(lab))
