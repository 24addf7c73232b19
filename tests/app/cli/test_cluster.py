"""Computing on several processes and computers: `fleet identify`, and what becomes of lost workers and schedulers."""

import importlib.util
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from app.cli.laboratory.fleet_identify import SpecimenFit, identify_specimen
from app.cli.main import main
from app.common import ExitCode, UsageError
from app.services import cluster, cluster_executor
from drivers.watchdog import version
from model.studies import Study
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import DWELL, STEPS, TRUTH
from tests.helpers.simulated_bench import laboratory, run, simulated

needs_dask = pytest.mark.skipif(importlib.util.find_spec("distributed") is None, reason="the extra is not installed")
SMALL = ["study", "-n", "7", "--vary", "E_m=1e6:1e8:3:log", "--frequencies", "100:200:3"]


@contextmanager
def dask_cluster(workers: int, processes: bool = False) -> Iterator[Any]:
    from distributed import LocalCluster

    nowhere = "127.0.0.1:0"
    with LocalCluster(
        n_workers=workers, threads_per_worker=1, processes=processes, protocol="tcp://", host="127.0.0.1",
        dashboard_address=nowhere, worker_dashboard_address=nowhere,
    ) as made:  # fmt: skip
        yield made


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Messages about missing workers, which are told at once."""
    monkeypatch.setattr(cluster, "NO_WORKERS_S", 0.0)
    monkeypatch.setattr(cluster, "POLL_S", 0.02)
    messages: list[str] = []
    monkeypatch.setattr(cluster, "print_message", messages.append)
    return messages


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dwell and steps of two specimens."""
    folder = tmp_path_factory.mktemp("runs")
    for seed, specimen in ((5, "T1"), (6, "T2")):
        with laboratory(simulated(tactor={"mu": TRUTH.mu, "c0": TRUTH.c0}, seed=seed)) as lab:
            for protocol in (DWELL, STEPS):
                run(protocol, folder, lab, specimen=specimen)
    return folder


@pytest.fixture(scope="module")
def fits(folder: Path) -> list[SpecimenFit]:
    """Both specimens, identified in this process."""
    return [identify_specimen(folder, name) for name in ("T1", "T2")]


def rows_of(answer: dict[str, Any]) -> list[tuple[Any, ...]]:
    found = answer["parameters"]
    return list(zip(*(found[name] for name in ("specimen", "parameter", "unit", "value", "error")), strict=True))


@pytest.mark.deep
def test_every_specimen_is_identified_near_its_truth(fits: list[SpecimenFit]) -> None:
    for fit in fits:
        away = {name: (value - getattr(TRUTH, name)) / error for name, _, value, error in fit.estimates}
        assert abs(away["mu"]) < 4
        assert abs(away["c0"]) < 4


@pytest.mark.deep
@pytest.mark.parametrize("place", ["local", pytest.param("cluster", marks=needs_dask)])
def test_several_processes_identify_the_same(place: str, folder: Path, fits: list[SpecimenFit], ask: Any) -> None:
    with dask_cluster(1) if place == "cluster" else nullcontext() as made:
        address = made.scheduler_address if made else place
        there = ask("fleet", "identify", str(folder), "--cluster", address)
    assert rows_of(there) == [(fit.specimen, *estimate) for fit in fits for estimate in fit.estimates]
    assert there["specimens"]["runs"] == [2, 2]


def test_a_computer_without_the_folder_is_named(tmp_path: Path) -> None:
    fit = identify_specimen(tmp_path / "elsewhere", "T1")
    assert str(tmp_path / "elsewhere") in fit.problem
    assert os.uname().nodename in fit.problem if hasattr(os, "uname") else fit.problem


@needs_dask
@pytest.mark.deep
def test_missing_workers_are_told_and_awaited(told: list[str], ask: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    with dask_cluster(0) as made:

        def tell(text: str) -> None:
            told.append(text)
            made.scale(1)

        monkeypatch.setattr(cluster, "print_message", tell)
        there = ask(*SMALL, "--cluster", made.scheduler_address)
    assert made.scheduler_address in told[0]
    assert there["fundamental"] == ask(*SMALL)["fundamental"]


@needs_dask
@pytest.mark.deep
def test_a_lost_scheduler_is_a_sentence_and_leaves_no_file(
    told: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    with dask_cluster(0) as made:

        def close(_: str) -> None:
            with suppress(Exception):  # on a busy computer its parts end late
                made.close()

        monkeypatch.setattr(cluster, "print_message", close)
        assert main([*SMALL, "--cluster", made.scheduler_address, "--out", str(tmp_path / "s.h5")]) == ExitCode.FAILED
    (line,) = capsys.readouterr().err.splitlines()
    assert_names(line, made.scheduler_address, "--cluster")
    assert not list(tmp_path.iterdir())


@needs_dask
@pytest.mark.deep
def test_a_killed_worker_is_survived(monkeypatch: pytest.MonkeyPatch, ask: Any) -> None:
    killed: list[int] = []
    with dask_cluster(2, processes=True) as made:
        compute = Study.chunks

        def chunks(self: Study, executor: Any = None) -> Any:
            for each in compute(self, executor):
                if not killed:
                    killed.append(made.workers[0].process.pid)
                    os.kill(killed[0], signal.SIGKILL)
                yield each

        monkeypatch.setattr(Study, "chunks", chunks)
        monkeypatch.setattr(Study, "chunk_size", 20)
        many = ["study", "-n", "7", "--vary", "E_m=1e6:1e8:400:log", "--frequencies", "1:200:100"]
        there = ask(*many, "--cluster", made.scheduler_address)
    assert killed
    assert there == ask(*many)


def test_another_version_on_a_worker_is_refused() -> None:
    client = SimpleNamespace(run=lambda _: {"tcp://10.0.0.7:4567": "0.0.1"})
    with pytest.raises(UsageError) as refused:
        cluster._check_versions(client)
    assert_names(str(refused.value), "tcp://10.0.0.7:4567", "0.0.1", version())


def test_a_termination_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def chunks(*_: Any) -> Any:
        signal.raise_signal(signal.SIGTERM)
        yield

    before = signal.getsignal(signal.SIGTERM)
    monkeypatch.setattr(Study, "chunks", chunks)
    assert main([*SMALL, "--out", str(tmp_path / "study.h5")]) == ExitCode.FAILED
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not list(tmp_path.iterdir())
    assert signal.getsignal(signal.SIGTERM) is before


@needs_dask
def test_a_worker_without_the_program_is_a_sentence() -> None:
    with (
        dask_cluster(0) as made,
        pytest.raises(cluster.ClusterError, match=r"No module named 'app'.*\[?cluster"),
        cluster_executor(made.scheduler_address),
    ):
        raise ModuleNotFoundError("No module named 'app'", name="app")
