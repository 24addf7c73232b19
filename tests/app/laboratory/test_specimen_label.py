"""Labels of specimens: what the printed code says, and what is refused."""

import hashlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import segno
from PIL import Image

from app.cli.main import main
from app.common import ExitCode
from app.identification.specimen_label import compare_label, make_label, read_label
from app.plotting import label_figure


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    runs = tmp_path / "runs"
    runs.mkdir()
    (runs / "T7.specimen.toml").write_text('specimen = "T7"\nbatch = "B2"\nserial = "0815"\n')
    return runs


def test_the_printed_code_is_that_of_name_and_hash(folder: Path, tmp_path: Path) -> None:
    path = tmp_path / "label.png"
    assert main(["label", "T7", "--folder", str(folder), "--out", str(path), "--size", "60x30"]) == ExitCode.DONE
    digest = hashlib.sha256((folder / "T7.specimen.toml").read_bytes()).hexdigest()[:12]
    expected = np.array(
        [list(row) for row in segno.make(f"T7 #{digest}", micro=False, error="m").matrix_iter(border=4)]
    )
    image = np.asarray(Image.open(path).convert("L"))
    assert image.shape == pytest.approx((30 / 25.4 * 600, 60 / 25.4 * 600), abs=1)
    side = image.shape[0]
    at = ((np.arange(expected.shape[0]) + 0.5) * side / expected.shape[0]).astype(int)
    assert (image[np.ix_(at, at)] < 128).tolist() == expected.astype(bool).tolist()
    right = image[:, side:] < 128  # the texts: within the label, and not over the code
    assert right.any()
    assert not right[:, -10:].any()


def test_several_labels_are_pages_of_a_pdf(folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "labels.pdf"
    assert main(["label", "T7", "X1", "--folder", str(folder), "--out", str(path)]) == ExitCode.DONE
    assert path.read_bytes().count(b"/MediaBox") == 2
    assert "X1 has no sheet" in capsys.readouterr().err


@pytest.mark.deep
def test_a_list_of_specimens_fills_the_places_of_a4_sheets(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    pages: list[Any] = []
    monkeypatch.setattr(label_figure, "_save", lambda figures, _path: pages.extend(figures))
    names = tmp_path / "names.csv"
    names.write_text("specimen,batch\nT7,B2\n" + "".join(f"X{i};B3\n" for i in range(20)))
    path = tmp_path / "labels.pdf"
    words = ["label", "--list", str(names), "--folder", str(folder), "--sheet", "--size", "63.5x38.1", "--gap", "2.5x0"]
    assert main([*words, "--used", "2", "--out", str(path)]) == ExitCode.DONE
    assert "21 labels on a sheet" in capsys.readouterr().err
    assert [len(page.axes) for page in pages] == [19, 2]
    pages[0].savefig(tmp_path / "page.png", dpi=254)  # ten pixels for each millimetre
    image = np.asarray(Image.open(tmp_path / "page.png").convert("L"))
    assert image.shape == (2970, 2100)
    expected = np.array(
        [list(row) for row in segno.make(make_label(folder, "T7").text, micro=False, error="m").matrix_iter(border=4)]
    )
    left, top, side = 7.25 + 2 * 66.0, 15.15 + (38.1 - 31.75) / 2, 31.75  # the third place of the first row, mm
    at = (np.arange(expected.shape[0]) + 0.5) * side / expected.shape[0]
    rows, columns = (10 * (top + at)).astype(int), (10 * (left + at)).astype(int)
    assert (image[np.ix_(rows, columns)] < 128).tolist() == expected.astype(bool).tolist()
    assert (image[:530, :1380] > 200).all(), "two places are used, and nothing lies beside the labels"


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["T7", "T8", "--out", "labels.png"], "several labels and sheets go into a .pdf"),
        (["T7", "--sheet", "--out", "label.png"], "several labels and sheets go into a .pdf"),
        (["T7", "--sheet", "--size", "250x40"], "does not fit on A4"),
        (["T7", "--used", "-1"], "from 0 to 999"),
        ([], "name the specimens"),
        (["--list", "missing.txt"], "cannot be read"),
        (["T7", "--out", "label.docx"], "ends in .pdf, .png or .svg"),
        (["T7", "--size", "5x400"], "from 10 to 300 mm"),
        (["T7", "--size", "small"], "such as 50x25"),
    ],
)
def test_what_cannot_be_printed_is_refused(arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["label", *arguments]) == ExitCode.USAGE
    assert says in capsys.readouterr().err


def test_a_scan_is_compared_with_the_present_sheet(folder: Path) -> None:
    label = make_label(folder, "T7")
    assert read_label(f"{label.text}\r\n") == read_label(label.text)
    assert read_label(label.text).specimen == "T7"
    assert "its sheet is unchanged since the label was printed" in compare_label(folder, read_label(label.text))
    (folder / "T7.specimen.toml").write_text('specimen = "T7"\nbatch = "B3"\n')
    assert "its sheet has changed since the label was printed" in compare_label(folder, read_label(label.text))
    assert "there is no sheet of it in this folder" in compare_label(folder.parent, read_label(label.text))
    for name in ("T7", "T7 #2", "#1", "T7 #abc"):
        assert read_label(name).specimen == name
        assert compare_label(folder, read_label(name)) == ""
