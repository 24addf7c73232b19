"""Results kept by hash: computed once for the same inputs and code, never believed without this user's signature."""

import hmac
import os
import pickle
import shutil
from collections.abc import Callable
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from reportlab.pdfgen.canvas import Canvas

from app.common import content_digest, forget_results, kept_result, kept_results, kept_table
from app.identification import IdentificationResult, SpecimenSheet, identify_observations, specimen_identification
from app.identification.observations import ObservationError, read_observations
from app.plotting import ReportPlot, VectorDrawing
from app.plotting.panels import PlotPanel
from app.report import drawings
from benchmarks.campaigns import SHARED, Noise, World, perfect
from model import Series
from model.identification import FitOptions, ObservationSet, StaticLoadingObservation
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile import open as open_run
from tests.helpers.simulated_bench import laboratory, run

pytestmark = pytest.mark.skipif(not hasattr(os, "getuid"), reason="the folder is set by XDG_CACHE_HOME")


@pytest.fixture
def kept(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "tactor-bench" / "results"


def counted() -> tuple[Callable[[], list[float]], list[int]]:
    calls: list[int] = []

    def compute() -> list[float]:
        calls.append(1)
        return [1.5, 2.5]

    return compute, calls


def painted(drawing: VectorDrawing) -> tuple[str, bytes]:
    canvas = Canvas(file := BytesIO(), invariant=1)
    drawing.paint(canvas)
    canvas.save()
    return drawing.svg, file.getvalue()


def test_an_equal_plot_of_a_report_is_drawn_once(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def plot(height: float) -> ReportPlot:
        line = Series(np.arange(3.0), np.array([1.0, height, 2.0]), label="model")
        return ReportPlot("a plot", (PlotPanel("(a)", "x", "y", (line,)),))

    first = painted(drawings._kept_plot(plot(3.0)))
    draw = drawings.draw_report_plot
    monkeypatch.setattr(drawings, "draw_report_plot", lambda _: pytest.fail("it was drawn again"))
    assert painted(drawings._kept_plot(plot(3.0))) == first
    monkeypatch.setattr(drawings, "draw_report_plot", draw)
    assert painted(drawings._kept_plot(plot(4.0))) != first


def test_the_same_inputs_are_computed_once_and_any_other_anew(kept: Path) -> None:
    compute, calls = counted()
    inputs = ("T7", {"L": 22e-3}, np.array([1.0, 2.0]), FitOptions())
    others = (
        ("T8", *inputs[1:]),
        (inputs[0], {"L": np.nextafter(22e-3, 1)}, *inputs[2:]),
        (*inputs[:2], np.array([1.0, np.nextafter(2.0, 3)]), inputs[3]),
        (*inputs[:2], inputs[2].astype(np.float32), inputs[3]),
        (*inputs[:3], FitOptions(n=8)),
    )
    assert [kept_result("a", inputs, compute) for _ in range(3)] == [[1.5, 2.5]] * 3
    assert len(calls) == 1
    for number, other in enumerate(others, 2):
        kept_result("a", other, compute)
        assert len(calls) == number
    kept_result("b", inputs, compute)
    assert len(calls) == len(others) + 2 == len(list(kept.iterdir()))
    forget_results()
    assert list(kept.iterdir()) == []


def test_another_state_of_the_code_computes_anew(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    compute, calls = counted()
    kept_result("a", 1, compute)
    monkeypatch.setattr(kept_results, "_code_digest", lambda: "another")
    kept_result("a", 1, compute)
    assert len(calls) == 2


class _Malicious:
    """A result that would make a folder when it is read."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __reduce__(self) -> tuple[Callable[[str], None], tuple[str]]:
        return os.mkdir, (str(self._folder),)


def test_a_damaged_or_foreign_result_is_removed_and_computed_again(kept: Path, tmp_path: Path) -> None:
    compute, calls = counted()
    kept_result("a", 1, compute)
    kept_result("a", 2, lambda: "another result")
    (one,) = (path for path in kept.iterdir() if b"another result" not in path.read_bytes())
    (two,) = (path for path in kept.iterdir() if path != one)
    good = one.read_bytes()
    hostile = pickle.dumps((_Malicious(tmp_path / "executed"),))
    wrong = [
        good[: len(good) // 2],
        b"",
        bytes([*good[:-5], good[-5] ^ 1, *good[-4:]]),
        two.read_bytes(),
        hmac.digest(bytes(32), one.name.encode() + hostile, "sha256") + hostile,
    ]
    for number, content in enumerate(wrong, 2):
        one.write_bytes(content)
        assert kept_result("a", 1, compute) == [1.5, 2.5]
        assert len(calls) == number
        assert one.read_bytes() == good
    assert not (tmp_path / "executed").exists()


def test_a_key_that_others_may_read_signs_nothing(kept: Path) -> None:
    compute, calls = counted()
    kept_result("a", 1, compute)
    (kept.parent / "results.key").chmod(0o644)
    kept_result("a", 1, compute)
    assert len(calls) == 2


def test_a_folder_that_cannot_be_used_keeps_nothing_and_disturbs_nothing(kept: Path) -> None:
    kept.parent.mkdir(parents=True)
    kept.write_text("no folder")
    compute, calls = counted()
    assert [kept_result("a", 1, compute) for _ in range(2)] == [[1.5, 2.5]] * 2
    assert len(calls) == 2


def test_results_that_were_not_used_for_longest_make_room(kept: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    size = 10_000
    monkeypatch.setattr(kept_results, "MAX_BYTES", 3 * size + 1000)
    for number in range(3):
        kept_result("a", number, lambda: bytes(size))
    for age, path in enumerate(sorted(kept.iterdir(), key=lambda path: path.stat().st_mtime_ns)):
        os.utime(path, (age, age))
    kept_result("a", 0, lambda: bytes(size))  # used now
    kept_result("a", 3, lambda: bytes(size))
    asked: list[int] = []
    for number in (0, 3, 2, 1):
        kept_result("a", number, lambda number=number: (asked.append(number), bytes(size))[1])  # type: ignore[misc]
    assert asked == [1]


def test_a_value_without_known_content_is_not_kept(kept: Path) -> None:
    compute, calls = counted()
    with pytest.raises(TypeError, match="content of a object"):
        content_digest(object())
    for _ in range(2):
        kept_result("a", object(), compute)
    assert len(calls) == 2


@pytest.mark.deep
def test_an_identification_is_fitted_again_only_if_runs_sheet_or_options_changed(
    kept: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fits: list[object] = []
    joint_fit = specimen_identification.joint_fit

    def fitted(*arguments: Any) -> Any:
        """The first result, whatever changed: the test is about how often it is asked for."""
        fits.append(fits[0] if fits else joint_fit(*arguments))
        return fits[0]

    monkeypatch.setattr(specimen_identification, "joint_fit", fitted)
    sheet, runs = SpecimenSheet("T7"), perfect(World(), Noise(), SHARED)

    def identified(observed: ObservationSet, sheet: SpecimenSheet, n: int = 7) -> IdentificationResult:
        return identify_observations("T7", observed, "joint", FitOptions(n=n), sheet=sheet)

    first = identified(runs, sheet)
    again = identified(perfect(World(), Noise(), SHARED), SpecimenSheet("T7"))
    assert len(fits) == 1
    assert again.estimates == first.estimates
    assert again.verdict == first.verdict
    np.testing.assert_array_equal(again.covariance, first.covariance)
    loading = next(run for run in runs.runs if isinstance(run, StaticLoadingObservation))
    moved = loading.deflection_m.copy()
    moved[0] *= 1 + 1e-12
    changed = ObservationSet(tuple(replace(r, deflection_m=moved) if r is loading else r for r in runs.runs))
    identified(changed, sheet)
    identified(runs, sheet, n=8)
    identified(runs, SpecimenSheet("T7", simulated=True))
    assert len(fits) == 4
    shutil.rmtree(kept)
    assert identified(runs, sheet).estimates == first.estimates
    assert len(fits) == 5


def test_files_found_in_order_are_checked_once_and_their_samples_at_every_reading(
    kept: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with laboratory() as lab:
        path = run(SineDwell(frequencies_hz=(150.0,), record_s=0.05), tmp_path, lab).path
    checks: list[int] = []
    check = open_run.check_structure
    monkeypatch.setattr(open_run, "check_structure", lambda *opened: (checks.append(1), check(*opened)))
    monkeypatch.setattr(open_run, "SETTLED_NS", -1)  # the times of the file are of now

    def read_by_another_program() -> None:
        open_run.CHECKED_FILES.clear()
        read_observations([path])

    read_by_another_program()
    assert len(checks) == 1
    read_by_another_program()
    assert len(checks) == 1
    (table,) = kept.glob("files-in-order-*")
    forged = table.read_bytes()
    table.write_bytes(forged[:-1] + bytes([forged[-1] ^ 1]))
    read_by_another_program()
    assert len(checks) == 2, "a table that nobody signed is not believed"

    with h5py.File(path, "r") as file:
        place = int(file["entry/trace/displacement"].id.get_chunk_info(0).byte_offset) + 6
    damaged = bytearray(path.read_bytes())
    damaged[place] ^= 16
    path.write_bytes(damaged)
    stamp = open_run._stamp(path)
    assert stamp is not None
    with kept_table("files-in-order", open_run.CHECKED_FILES):
        open_run.CHECKED_FILES[stamp[0]] = stamp[1]
    with pytest.raises(ObservationError) as told:
        read_by_another_program()
    assert path.name in str(told.value)
    assert len(checks) == 2, "the damage is in the samples, and the file counts as found in order"
