"""What the two pages of a report state: people, instruments with their calibration, key figures by source; and its forms."""

import itertools
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pypdfium2
import pytest

from app.cli.main import main
from app.common import sentence_case
from app.config import Certificate, store_certificate
from app.report.content import build_report
from app.report.document import Report
from app.report.figures_of_merit import measured_figures
from app.report.first_page import NOT_RECORDED
from app.report.limits import FIGURES_OF_MERIT
from app.report.runs import ReportRun
from app.report.specimen import SpecimenModel
from model import AmplifierMap, quantity_label
from tests.helpers.report_specimen import texts_of_pages

pytestmark = pytest.mark.deep
LABELS = [
    sentence_case(quantity_label(name)) for name in ("natural_frequency", "quality_factor", "static_gain_above_rest")
]
Gathered = tuple[Report, SpecimenModel, tuple[ReportRun, ...]]
JPEG = bytes.fromhex(
    "ffd8ffe000104a46494600010100000100010000ffdb004300" + "01" * 64 + "ffc0000b080001000101011100ffc40014000100000000000000"
    "000000000000000009ffc40014100100000000000000000000000000000000ffda0008010100003f0054ffd9"
)  # fmt: skip


def smallest_text_pt(path: Path) -> float:
    """The smallest size of a character on any page, as a renderer reads it."""
    document = pypdfium2.PdfDocument(path)
    sizes = []
    for page in document:
        text = page.get_textpage()
        sizes += [pypdfium2.raw.FPDFText_GetFontSize(text.raw, i) for i in range(text.count_chars())]
    return min(size for size in sizes if size > 1)  # generated spaces have size 1


class Elements(HTMLParser):
    """Elements of a page with their attributes, in order."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.found: list[tuple[str, dict[str, str | None]]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.found.append((tag, dict(attrs)))

    def of(self, tag: str) -> list[dict[str, str | None]]:
        return [attributes for name, attributes in self.found if name == tag]


@pytest.fixture(scope="module")
def signed(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Reports of a specimen with certificates, a checked run, a photograph and a style sheet; and of its fleet."""
    runs, out = tmp_path_factory.mktemp("signed") / "runs", tmp_path_factory.mktemp("out")
    shutil.copytree(folder, runs)
    dwell = next(runs.glob("*sine-dwell.h5"))
    (runs / "T1.specimen.toml").write_text('specimen = "T1"\nserial = "MFC-042"\nphotograph = "t1.jpg"\n')
    (runs / "t1.jpg").write_bytes(JPEG)
    (runs / "laboratory.toml").write_text('name = "Haptics Lab"\n[report]\nstyle = "company.css"\n')
    (runs / "company.css").write_text("h1 { color: rebeccapurple }")
    (runs / "limits.toml").write_text('[limits.natural_frequency]\nlow = "100 Hz"\n')
    certificate = Certificate("C-17", "Lab", "2020-01-02", serial="MY00000001", role="generator", due="2020-12-31")
    store_certificate(runs, certificate)
    store_certificate(runs, replace(certificate, number="C-99", date="2999-01-01", due="2999-12-31"))
    assert main(["checked", str(dwell), "--by", "Ben Keller"]) == 0
    assert main(["report", "T1", "--folder", str(runs), "--out", str(out)]) == 0
    assert main(["report", "--fleet", "--folder", str(runs), "--out", str(out)]) == 0
    return out


def test_two_pages_answer_who_when_with_what_and_how_sure(signed: Path) -> None:
    first, second = (" ".join(text.split()) for text in texts_of_pages(signed / "T1_report.pdf"))
    for text in ("Haptics Lab", "serial MFC-042", "Ben Keller (1 run)", NOT_RECORDED, "PASS: the limit is met.", "certificate C-17", "overdue in 2 runs", *LABELS, "at least 100", "model, not measured", "Measured by"):  # fmt: skip
        assert text in first, text
    assert "C-99" not in first  # a certificate of later runs
    for text in ("k2: bending stiffness", "Determined by", "share of the squared total", "1000 MPa"):
        assert text in second, text
    assert smallest_text_pt(signed / "T1_report.pdf") >= 8


def test_the_html_can_be_read_without_eyes_and_on_a_phone(signed: Path) -> None:
    text = (signed / "T1_report.html").read_text("utf-8")
    page = Elements(text)
    assert page.of("html") == [{"lang": "en"}]
    assert [each["content"] for each in page.of("meta") if each.get("name") == "viewport"]
    levels = [int(tag[1]) for tag, _ in page.found if tag in ("h1", "h2", "h3", "h4")]
    assert levels[0] == 1
    assert all(after <= before + 1 for before, after in itertools.pairwise(levels))
    assert {cell.get("scope") for cell in page.of("th")} == {"col", "row"}
    (photograph,) = page.of("img")
    assert photograph["alt"] == "Photograph of specimen T1"
    labels = [svg["aria-label"] or "" for svg in page.of("svg")]
    assert "Hz" in labels[0]
    assert any("k2" in label and "%" in label for label in labels)
    assert text.index("h1 { color: rebeccapurple }") > text.index("@page")


def test_a_style_sheet_cannot_leave_its_element(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = shutil.copytree(folder, tmp_path / "runs")
    (runs / "laboratory.toml").write_text('[report]\nstyle = "x.css"\n')
    (runs / "x.css").write_text("</style><script>")
    assert main(["report", "T1", "--folder", str(runs), "--out", str(tmp_path)]) == 2
    assert "x.css" in capsys.readouterr().err


def test_a_fleet_has_a_summary_and_a_page_for_each_specimen(signed: Path) -> None:
    summary, page = texts_of_pages(signed / "fleet_report.pdf")
    assert "1 specimens" not in summary
    assert "1 specimen" in summary
    assert LABELS[0] in summary
    assert "Specimen T1" in page
    assert "Instruments and their calibration" in page


def test_a_measured_latency_takes_the_place_of_the_models(gathered: Gathered) -> None:
    report, known, runs = gathered
    merits: dict[str, Any] = {m["name"]: m for m in report.record["merits"]}  # type: ignore[attr-defined]
    assert merits["latency"]["source"] == "identified model"
    figure = ("latency, 50 µm, after a step to 5 V", 0.9e-3, 1e-6, 2e-6, "s", "", 0.0)
    other = ("latency, 50 µm, after a step to 4 V", 0.1e-3, 1e-6, 2e-6, "s", "", 0.0)
    measured = replace(runs[-1], summary=runs[-1].summary._replace(figures_json=json.dumps([figure, other])))
    latency = measured_figures([*runs[:-1], measured], AmplifierMap())["latency"]
    assert (latency.value, latency.standard_error, latency.source) == (0.9e-3, 2e-6, runs[-1].path.stem)
    left_out = replace(measured, exclusion_reason="it is a copy")
    assert "latency" not in measured_figures([left_out], AmplifierMap())
    assert known.identifies_free_response


def test_the_natural_frequency_is_the_newest_of_the_free_specimen(folder: Path) -> None:
    report, _, runs = build_report(folder, "T1")
    merits: dict[str, Any] = {m["name"]: m for m in report.record["merits"]}  # type: ignore[attr-defined]
    dwell = next(run for run in runs if "dwell" in run.name)
    assert merits["natural_frequency"]["source"] == dwell.path.stem
    assert merits["natural_frequency"]["value"] > merits["peak_frequency"]["value"]
    ratio = merits["damping_ratio"]["value"]
    assert merits["quality_factor"]["value"] == pytest.approx(1 / (2 * ratio))


LONG = "Tactor 7, batch 2026-10, second prototype of the abdominal belt"
OPERATOR, CHECKER = "Dr. Maximiliane von Hohenlohe-Langenburg", "Prof. Dr. Benedikt Keller-Oberhauser"
NUMBER = "D-K-15070-01-00-2026-"


LIMITS: dict[str, tuple[float, float]] = {
    "natural_frequency": (150, 165), "damped_frequency": (145, 160), "peak_frequency": (145, 170), "damping_ratio": (0.2, 0.25),
    "amplitude_at_resonance": (0.0009, 0.0013), "usable_from": (1, 20), "usable_to": (200, 300), "smallest_margin": (4, 8),
    "smallest_margin_on_membrane": (1.2, 3), "latency": (0.0004, 0.0007), "rise_time": (0.001, 0.0015), "k2": (0.0075, 0.0085),
    "mu": (-1.4e-5, -1.2e-5), "m_add": (0.007, 0.0085), "c0": (150, 180), "E_m": (6e6, 7.5e6), "c_s_0": (150, 200),
    "c_s_delta": (45000, 60000),
}  # fmt: skip


@pytest.fixture(scope="module")
def demanding(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """Texts of the pages of a report with long names, every limit on both sides, a photograph, and doubtful and failed runs."""
    runs, out = tmp_path_factory.mktemp("long") / "runs", tmp_path_factory.mktemp("out")
    common = ["--speed", "max", "--seed", "3", "--out", str(runs), "--specimen", LONG, "--operator", OPERATOR]
    air = ["--temperature", "23.4 °C", "--humidity", "45 %"]
    runs.mkdir()
    sensor = Certificate(
        f"{NUMBER}7654321", "Institute of Metrology", "2020-05-04", serial="SIM-2", role="sensor", due="2021-05-04"
    )
    store_certificate(runs, sensor)
    store_certificate(
        runs, replace(sensor, number=f"{NUMBER}1234567", serial="MY00000001", role="generator", due="2999-05-04")
    )
    for protocol in (
        ["static-loading"], ["voltage-steps"], ["sine-dwell"], ["sweep"], ["latency"], ["sine-dwell"],
    ):  # fmt: skip
        assert main(["run", *protocol, *common, *air]) == 0
    assert main(["run", "electrical", *common]) == 1
    sheet = next(runs.glob("*.specimen.toml"))
    sheet.write_text(
        sheet.read_text("utf-8").replace("simulated = true", 'simulated = true\nphotograph = "t.jpg"'), "utf-8"
    )
    (runs / "t.jpg").write_bytes(JPEG)
    (runs / "laboratory.toml").write_text('name = "Laboratory for Haptics and Smart Materials of the University"\n')
    (runs / "limits.toml").write_text(
        "\n".join(f"[limits.{name}]\nlow = {low}\nhigh = {high}" for name, (low, high) in LIMITS.items())
    )
    assert main(["checked", *map(str, runs.glob("*sweep.h5")), "--by", CHECKER]) == 0
    main(["report", LONG, "--folder", str(runs), "--out", str(out)])
    (pdf,) = out.glob("*.pdf")
    assert smallest_text_pt(pdf) >= 8
    return texts_of_pages(pdf)


def test_long_names_and_every_limit_stay_on_two_pages(demanding: list[str]) -> None:
    assert LIMITS.keys() == set(FIGURES_OF_MERIT)
    assert len(demanding) == 2
    assert "Shaded" in demanding[0]  # the caption of the plot
    assert "Computed" in demanding[1]  # the last one


QUESTIONS = {
    "who measured": f"by {OPERATOR} \\(7 runs\\)",
    "who checked": f"{re.escape(CHECKER)} \\(1 run\\)",
    "when": r"Measured 20\d\d-\d\d-\d\d \d\d:\d\d(?: to [\d: -]*\d\d:\d\d)? UTC",
    "in what air": r"23\.4 °C, 45 % relative humidity",
    "with which laser": r"Sensor simulated laser displacement sensor #SIM-2",
    "was it in calibration": r"2020-05-04 2021-05-04 overdue in 7 runs",
    "by which certificate": f"certificate {NUMBER}7654321",
    "is it a real specimen": "SIMULATED",
    "what is its natural frequency": r"Natural frequency 1\d\d\.\d+ ± \d\.\d+ Hz",
    "is the frequency of the largest response the natural one": r"peak frequency is below the natural \(undamped\) one",
    "what is Q": r"Quality factor Q 2\.\d+ ± 0\.\d+ (dwell|sweep)",
    "is the latency measured": r"after a step to 5 V \d\.\d+ ± \d\.\d+ ms latency \d\d-\d\d",
    "which limits are not met": r"Bending stiffness k₂ [^\n]*? fail",
    "how was L measured": r"L 22\.\d+ ± 0\.050 mm[^()]*\(digital caliper\)",
    "what limits the uncertainty of k2": r"share of the squared total.*k2.*\d+ %",
    "which run failed, and why": r"electrical\.h5 failed: Electrical ",
    "how many points were usable": r"; (\d+) of \1 points usable",
    "which runs are doubtful, and why": r"Doubtful: points with an expired calibration in loading 20",
    "over which threshold is the margin": r"over the threshold, 50 µm on the abdomen",
}  # fmt: skip


@pytest.mark.parametrize("question", QUESTIONS)
def test_a_reader_of_the_two_pages_alone_finds(question: str, demanding: list[str]) -> None:
    assert re.search(QUESTIONS[question], " ".join(" ".join(demanding).split()))
