"""`tactor-bench figures`: every theory figure as a picture and a CSV file, with its caption."""

import csv
import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from matplotlib.text import Text

from app.cli.main import main
from app.common.exit_codes import ExitCode
from app.plotting import run_picture
from app.plotting.charts import draw_figure, typeset_symbols
from app.plotting.panels import new_figure
from model import Series, quantity_label
from model.parameters import Membrane, Tactor
from model.studies.figures_of_the_paper import PaperFigure, figure5, figure9

NAMES = ["fig4", "fig5", "fig6", "fig8", "fig9", "fig10", "fig11", "fig12"]


@cache
def fig9() -> list[PaperFigure]:
    return list(figure9(Tactor(), Membrane()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("figures") / "new" / "folder"
    assert main(["figures", "--out", str(made)]) == ExitCode.DONE
    return made


def sheet(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return head, np.array(rows, float)


@pytest.mark.parametrize(
    ("lines", "layout", "beside"), [(9, "constrained", True), (2, "constrained", False), (9, "none", False)]
)
def test_a_long_legend_lies_beside_the_curves_where_the_layout_makes_room(
    lines: int, layout: str, beside: bool
) -> None:
    figure = new_figure(figsize=(10, 5), layout=layout)
    axes = figure.subplots()
    for number in range(lines):
        axes.plot([0, 1], [0, number], label=f"with {number} g")
    run_picture._add_legend(axes, ["peak frequency 150 Hz", "dashed: model"], 8)
    figure.draw_without_rendering()
    legend, page = axes.get_legend().get_window_extent(), figure.bbox
    assert (legend.x0 >= axes.bbox.x1) == beside
    assert page.x0 <= legend.x0 < legend.x1 <= page.x1


@pytest.mark.deep
def test_all_figures_are_there_as_picture_and_sheet(folder: Path) -> None:
    assert sorted(p.name for p in folder.iterdir()) == sorted(f"{n}.{kind}" for n in NAMES for kind in ("png", "csv"))
    for name in NAMES:
        assert (folder / f"{name}.png").stat().st_size > 20_000


@pytest.mark.deep
def test_sheets_hold_the_settled_numbers(folder: Path) -> None:
    columns = ["frequency [Hz]", "fig9a 2 x fundamental [m]", "fig9a max - min [m]"]
    head, rows = sheet(folder / "fig9.csv")
    assert head[:3] == columns
    assert len(head) == 13
    assert rows[np.isin(rows[:, 0], [75, 150]), 1:3] == pytest.approx(
        1e-6 * np.array([[594.2, 702.7], [1154.0, 1154.2]]), abs=0.06e-6
    )
    stretched = rows[np.isin(rows[:, 0], [100, 150, 200]), head.index("fig9f max - min [m]")]
    assert 1e6 * stretched == pytest.approx(
        [175.7, 122.4, 91.9], rel=3e-3
    )  # settled at 0.0373, here 6.35 mm are 0.03735
    head, rows = sheet(folder / "fig4.csv")
    assert head == [
        "load at the centre [N]",
        "Eq. (7), corrected [m]",
        "Eq. (7) as printed [m]",
    ]
    assert rows[-1, 1:] / rows[-1, 0] == pytest.approx([1.3790e-4, 1.0492e-3], rel=1e-4)
    head, rows = sheet(folder / "fig8.csv")
    assert head == ["pre-stretch []", "c_s = c_s^delta delta + c_s^0 [kg/(m s)]"]
    assert rows[-1, 1] == pytest.approx(2211.9, rel=1e-4)


@pytest.mark.deep
def test_one_figure_or_one_panel_alone_and_as_pdf(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["figures", "--out", str(tmp_path), "--only", "fig9b", "--only", "fig6", "--pdf", "--json"]
    assert main(arguments) == ExitCode.DONE
    result = json.loads(capsys.readouterr().out)
    assert {p.name for p in tmp_path.iterdir()} == {
        f"{n}.{k}" for n in ("fig6", "fig9b") for k in ("png", "pdf", "csv")
    }
    assert (tmp_path / "fig6.pdf").read_bytes().startswith(b"%PDF")
    assert "the equations give" in result["figures"][0]["captions"]["fig9b"]
    assert all(Path(file).exists() for figure in result["figures"] for file in figure["files"])


@pytest.fixture
def drawn(monkeypatch: pytest.MonkeyPatch, tmp_path: Path):  # type: ignore[no-untyped-def]
    """Draws panels and gives the matplotlib figure that would be saved."""
    from matplotlib.figure import Figure as Sheet

    saved = []
    monkeypatch.setattr(Sheet, "savefig", lambda self, path: saved.append(self))

    def drawing(panels: list[PaperFigure]) -> Sheet:
        draw_figure(panels, tmp_path / "x.png")
        return saved[-1]

    return drawing


@pytest.mark.deep
def test_axes_have_units_and_the_caption_speaks_of_the_paper(drawn) -> None:  # type: ignore[no-untyped-def]
    page = drawn(fig9())
    assert len(page.axes) == 6
    assert {axes.get_xlabel() for axes in page.axes} == {f"{quantity_label('frequency')} (Hz)"}
    assert page.axes[0].get_ylabel() == "amplitude of the centre, peak to peak (µm)"
    caption = " ".join(page.get_supxlabel().split())
    assert "The text speaks of a zero before the resonance; Eqs. (1)-(6) with Table I have none" in caption
    assert caption.count("two slopes add even harmonics") == 1
    for axes in page.axes:
        (line,) = [line for line in axes.lines if "50 µm" in str(line.get_label())]
        assert list(line.get_ydata()) == [50, 50]
        assert axes.get_ylim()[0] == 0


@pytest.mark.deep
def test_nothing_of_a_picture_is_clipped_or_covered(drawn) -> None:  # type: ignore[no-untyped-def]
    for panels in ([figure5(Tactor())], fig9()[1:3]):
        page = drawn(panels)
        page.draw_without_rendering()
        (caption,) = (text for text in page.findobj(Text) if text.get_text() == page.get_supxlabel())
        assert caption.get_window_extent().y1 <= min(axes.get_tightbbox().y0 for axes in page.axes)
        box = page.get_tightbbox()
        assert box.x0 >= 0
        assert box.y0 >= 0
        assert box.x1 <= page.get_figwidth()
        assert box.y1 <= page.get_figheight()


def test_metres_become_what_a_person_reads(drawn) -> None:  # type: ignore[no-untyped-def]
    x = np.array([0.0, 1.0])
    small = PaperFigure("a", "time", "s", "deflection", "m", (Series(x, 1e-3 * x, label="w"),), "Small.")
    large = PaperFigure("a", "time", "s", "deflection", "m", (Series(x, 5e-3 * x, label="w"),), "Large.")
    assert drawn([small]).axes[0].get_ylabel() == "deflection (µm)"
    page = drawn([large])
    assert page.axes[0].get_ylabel() == "deflection (mm)"
    assert page.axes[0].get_xlabel() == "time (ms)"
    assert page.axes[0].lines[0].get_ydata()[-1] == pytest.approx(5)
    assert page.axes[0].lines[0].get_xdata()[-1] == pytest.approx(1000)


def test_symbols_are_printed_as_symbols() -> None:
    assert typeset_symbols("E_m = 1e+03 Pa, delta = 1e-05") == r"$E_{m}$ = $10^{3}$ Pa, $\delta$ = $10^{-5}$"
    assert typeset_symbols("24 k1^2 [...], 0..5 V, under 50 um") == "24 $k_1^2$ [...], 0 to 5 V, under 50 µm"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--only", "fig7"], "there is no figure 'fig7'; there are: fig4, fig5, fig6, fig8, fig9"),
        (["--out", "/proc/nowhere"], "the folder /proc/nowhere cannot be made"),
    ],
)
def test_what_cannot_be_drawn_is_refused(
    arguments: list[str], says: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["figures", *arguments]) == ExitCode.USAGE
    assert says in capsys.readouterr().err
    assert list(tmp_path.glob("figures/*")) == []


@pytest.mark.deep
def test_other_parameters_move_the_curves_and_the_caption_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = [
        "figures",
        "--out",
        str(tmp_path),
        "--only",
        "fig4",
        "--json",
        "--set",
        "k2=8e-3",
        "--set",
        "E_m=7 MPa",
    ]
    assert main(arguments) == ExitCode.DONE
    result = json.loads(capsys.readouterr().out)["figures"][0]["captions"]["fig4"]
    assert result.endswith(
        "Drawn with k2 = 0.008, E_m = 7e+06; statements on the text and on single numbers hold for Table I."
    )
    _, rows = sheet(tmp_path / "fig4.csv")
    assert rows[-1, 1] / rows[-1, 0] < 1.35e-4


def test_a_skin_that_the_figures_choose_themselves_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["figures", "--out", str(tmp_path), "--set", "delta=0.01"]) == ExitCode.USAGE
    assert "--set delta: the figures define their own skin" in capsys.readouterr().err
