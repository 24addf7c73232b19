"""`tactor-bench study`: presets and custom ranges, as table, JSON, CSV and HDF5; sensitivity; a cluster; Ctrl-C."""

import csv
import importlib.util
from concurrent.futures import BrokenExecutor, CancelledError
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli.main import main
from app.common.exit_codes import ExitCode
from model import Membrane, Specimen, replace_variables
from model.response import exact_response
from model.studies.parameter_study import STUDY_PRESETS, Study
from protocols.runfile.study_file import read_study
from tests.helpers.messages import assert_names

needs_dask = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="the extra is not installed")
SMALL = ["study", "-n", "7", "--vary", "E_m=1e6:1e8:3:log", "--vary", "delta=0,0.01", "--frequencies", "100:200:3"]


@pytest.mark.parametrize("preset", ["fig10", "fig11", "fig12"])
def test_presets_are_the_papers(preset: str, tmp_path: Path) -> None:
    path = tmp_path / "study.h5"
    assert main(["study", preset, "--out", str(path)]) == ExitCode.DONE
    got = read_study(path)
    assert np.array_equal(got.values, STUDY_PRESETS[preset]().run().values)
    assert got.axes == STUDY_PRESETS[preset]().axes
    assert got.description["n"] == 7


def test_own_ranges_give_the_settled_numbers_in_every_form(tmp_path: Path, ask: Any) -> None:
    path, sheet = tmp_path / "study.h5", tmp_path / "study.csv"
    arguments = [
        "study",
        "-n",
        "7",
        "--vary",
        "delta=0,0.0075,0.0373",
        "--frequencies",
        "100,150,200",
        "--quantity",
        "peak_to_peak",
    ]
    told = ask(*arguments, "--out", str(path), "--csv", str(sheet))
    expected = 1e-6 * np.array([[652.2, 705.9, 447.0], [436.9, 357.4, 257.8], [175.7, 122.4, 91.9]])
    stored = read_study(path)
    assert stored.values == pytest.approx(expected, abs=0.15e-6)
    assert [(a.name, a.unit) for a in stored.axes] == [("delta", ""), ("frequency", "Hz")]
    assert stored.unit == "m"
    assert told["peak_to_peak"] == {"unit": "m", "values": stored.values.tolist()}
    assert told["axes"][0]["values"] == [0, 0.0075, 0.0373]
    columns = ["delta []", "frequency [Hz]", "peak_to_peak [m]"]
    with sheet.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    assert head == columns
    assert np.array(rows, float)[:, 2] == pytest.approx(stored.values.ravel(), rel=1e-15)


@pytest.mark.parametrize("accuracy", [1e-2, 1e-3, 2e-5])
def test_a_study_is_as_accurate_as_it_states_at_every_combination(accuracy: float, ask: Any) -> None:
    """Against the closed form, which shares no shape functions with the study."""
    told = ask("study", "--vary", "delta=0,0.03", "--vary", "m_add=5e-3,2e-2", "--frequencies", "50:500:10", "--quantity", "receptance", "--accuracy", f"{accuracy:g}")  # fmt: skip
    values = np.array(told["receptance"]["values"]) @ [1, 1j]
    f = np.linspace(50, 500, 10)
    for i, delta in enumerate((0.0, 0.03)):
        for j, m_add in enumerate((5e-3, 2e-2)):
            specimen = replace_variables(Specimen(membrane=Membrane()), {"delta": delta, "m_add": m_add})
            exact = exact_response(specimen.tactor, f, specimen.skin)
            assert np.max(np.abs(values[i, j] - exact) / np.abs(exact)) < accuracy


def test_chunks_land_where_they_belong(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, ask: Any) -> None:
    path = tmp_path / "study.h5"
    whole = ask(*SMALL)["fundamental"]["values"]
    monkeypatch.setattr(Study, "chunk_size", 4)
    assert ask(*SMALL, "--out", str(path))["fundamental"]["values"] == whole
    assert read_study(path).values.tolist() == whole


def test_the_file_names_what_was_not_varied(tmp_path: Path) -> None:
    path = tmp_path / "study.h5"
    assert main([*SMALL, "--set", "m_add=5 g", "--out", str(path)]) == ExitCode.DONE
    got = read_study(path)
    parameters = {p.name: (p.value, p.unit) for p in got.parameters}
    assert parameters["m_add"] == (pytest.approx(0.005), "kg")
    assert not parameters.keys() & {"E_m", "delta", "k_s", "c_s"}  # varied, or following from it
    assert got.values.shape == (3, 2, 3)


def test_a_complex_receptance_is_pairs_in_json_and_complex_in_the_file(tmp_path: Path, ask: Any) -> None:
    path = tmp_path / "study.h5"
    told = ask("study", "--vary", "c0=159", "--frequencies", "0", "--quantity", "receptance", "--out", str(path))
    assert told["receptance"]["values"][0][0] == pytest.approx([2.37886e-7, 0], rel=2e-3)
    assert read_study(path).values.dtype == complex


def test_a_person_sees_the_peak_of_each_combination(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "fig10"]) == ExitCode.DONE
    rows = [line.split() for line in capsys.readouterr().out.splitlines()]
    assert ["1e+09", "216.3", "250", "103.2", "216.3"] in rows
    assert main(["study", "--vary", "c0=100:200:50", "--frequencies", "100,200"]) == ExitCode.DONE
    assert "the first 30 of 50 combinations" in capsys.readouterr().out


def test_a_study_can_be_drawn(tmp_path: Path) -> None:
    assert main([*SMALL, "--picture", str(tmp_path / "study.png")]) == ExitCode.DONE
    assert (tmp_path / "study.png").read_bytes().startswith(b"\x89PNG")


def test_sensitivity_at_rest_is_all_the_couplings(ask: Any, tmp_path: Path) -> None:
    sheet = tmp_path / "sobol.csv"
    told = ask(
        "study", "--sensitivity", "--vary", "mu=-1.6e-5,-1e-5", "--vary", "c0=100:200:2", "--frequencies", "0.5",
        "--samples", "256", "--csv", str(sheet),
    )["sobol"]  # fmt: skip
    assert told["output"] == ["peak [m]", "frequency of peak [Hz]", "amplitude at 0.5 Hz [m]"]
    assert (told["total_mu"][2], told["total_c0"][2]) == pytest.approx((1, 0), abs=0.02)
    assert sheet.read_text(encoding="utf-8").startswith("output [],first_mu [],first_c0 []")


@pytest.mark.deep
@pytest.mark.parametrize("more", [[], ["--sensitivity", "--samples", "16"]])
def test_all_cores_give_the_same(more: list[str], ask: Any) -> None:
    there = ask(*SMALL, *more, "--cluster", "local")
    here = ask(*SMALL, *more)
    assert there == here


@needs_dask
def test_a_cluster_is_found_by_its_address(ask: Any) -> None:
    from distributed import LocalCluster

    nowhere = "127.0.0.1:0"
    with LocalCluster(
        n_workers=1, threads_per_worker=1, processes=False, protocol="tcp://", host="127.0.0.1",
        dashboard_address=nowhere, worker_dashboard_address=nowhere,
    ) as cluster:  # fmt: skip
        there = ask(*SMALL, "--cluster", cluster.scheduler_address)
    assert there["fundamental"] == ask(*SMALL)["fundamental"]


def test_without_dask_a_sentence_names_the_extra(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    assert main([*SMALL, "--cluster", "127.0.0.1:8786"]) == ExitCode.USAGE
    assert "tactor-bench[cluster]" in capsys.readouterr().err


@pytest.mark.parametrize("ended", [BrokenExecutor, CancelledError])
def test_processes_that_end_early_are_a_sentence(
    ended: type[Exception], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def chunks(*_: Any) -> Any:
        raise ended
        yield

    monkeypatch.setattr(Study, "chunks", chunks)
    assert main([*SMALL, "--cluster", "local", "--out", str(tmp_path / "study.h5")]) == ExitCode.FAILED
    assert "--cluster local" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_ctrl_c_stops_with_exit_code_1_and_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    closed = []

    def blocks(self: Study, executor: object = None):  # type: ignore[no-untyped-def]
        try:
            yield 0, np.zeros((1, 3))
            raise KeyboardInterrupt
        finally:
            closed.append(True)

    monkeypatch.setattr(Study, "chunks", blocks)
    assert main([*SMALL, "--out", str(tmp_path / "x.h5"), "--csv", str(tmp_path / "x.csv")]) == ExitCode.FAILED
    captured = capsys.readouterr()
    assert captured.err == "tactor-bench: stopped; nothing was written\n"
    assert captured.out == ""
    assert closed == [True]
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_a_failure_not_a_misuse(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("protocols.runfile.study_file.RESERVE_BYTES", 10**18)
    assert main([*SMALL, "--out", str(tmp_path / "x.h5")]) == ExitCode.FAILED
    told = capsys.readouterr().err
    assert str(tmp_path) in told
    assert_names(told, "disk", "MB")
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ([], 'fig10, fig11, fig12'),
        (["fig13"], "'fig13'"),
        (["fig10", "--vary", "k2=1,2"], "fig10 defines the varied parameters"),
        (["fig10", "--set", "E_m=1 MPa"], '--set E_m'),
        (["fig10", "--pre-stretch", "0"], "fig10 has its own pre-stretch"),
        (["--vary", "delta=0,1", "--elongation", "1 mm"], '--elongation'),
        (["--vary", "cheese=1,2"], "'cheese'"),
        (["--vary", "k2"], "--vary k2: write NAME=VALUE"),
        (["--vary", "k2=-1:1:3"], '-1 N m^2'),
        (["--vary", "L1=1 mm:16 mm:3"], 'L1 is 0.016 m'),
        (["--vary", "delta=-0.1,0"], '-0.1'),
        (["--vary", "c0=1,2", "--frequencies", "-1,5"], '-1 Hz'),
        (["--vary", "c0=1,2", "--frequencies", "0", "--quantity", "peak_to_peak"], '0 Hz'),
        (["--vary", "c0=1,2", "--quantity", "cheese"], "invalid choice: 'cheese'"),
        (["--vary", "c0=1,2", "-n", "0"], 'is 0'),
        (["--vary", "c0=1,2", "--peak-to-peak", "9 V"], "leaves the amplifier's input range"),
        (["--vary", "c0=1,2", "--out", "/nowhere/x.h5"], '/nowhere'),
        (["--vary", "c0=1,2", "--csv", "/nowhere/x.csv"], '/nowhere'),
        (["--vary", "c0=1,2", "--out", __file__], "exists and is not a study, so it is not overwritten"),
        (["--vary", "c0=1,2", "--sensitivity", "--samples", "100"], 'samples is 100'),
        (["--vary", "c0=1", "--sensitivity"], 'c0'),
        (["--vary", "c0=1,2", "--sensitivity", "--quantity", "receptance"], 'receptance'),
        (["--vary", "c0=1,2", "--sensitivity", "--seed", "-1"], '--seed -1'),
        (["--vary", "c0=1,2", "--sensitivity", "--out", "x.h5"], '--csv or --json'),
        (["--vary", "c0=1:2:9999", "--vary", "k2=1:2:9999", "--json"], '--out'),
        pytest.param(["fig10", "--cluster", "cheese"], "'cheese'", marks=needs_dask),
    ],
)  # fmt: skip
def test_bad_input_gets_one_sentence_and_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["study", *arguments]) == ExitCode.USAGE
    captured = capsys.readouterr()
    assert says in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""


@pytest.mark.parametrize("command", ["study", "figures", "model"])
def test_help_has_an_example(command: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main([command, "--help"])
    assert left.value.code == 0
    assert f": tactor-bench {command}" in " ".join(capsys.readouterr().out.split())
