"""Problem report: what it has, and what it must not have."""

import getpass
import json
import logging
import socket
import threading
import zipfile
from pathlib import Path

import numpy as np
import pytest

from app.archive import problem_report
from app.archive.problem_report import ProblemFacts, write_problem_report
from app.common.recent_errors import RecentErrors
from protocols.runfile.reader import Run
from tests.helpers.fleet_runs import write_run


def contents(path: Path) -> dict[str, str]:
    with zipfile.ZipFile(path) as archive:
        assert archive.testzip() is None
        return {name: archive.read(name).decode() for name in archive.namelist()}


def test_a_report_has_no_measured_value_no_token_and_no_login(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    home = tmp_path / "home" / "maria"
    home.mkdir(parents=True)
    monkeypatch.setattr(Path, "home", lambda: home)
    monkeypatch.setattr(getpass, "getuser", lambda: "maria.m")
    monkeypatch.setattr(socket, "gethostname", lambda: "lab-pc-17")
    runs = home / "runs"
    runs.mkdir()
    write_run(runs, "T6", 0.0, 1e-3, 150.0, 1)
    run = write_run(runs, "T7", 1.0, 1.2345e-3, 161.2345, 1)
    bench = home / "bench1.toml"
    bench.write_text('name = "bench 1"  # on lab-pc-17\n')
    settings = {"run/folder": str(runs), "remote/token": "very-secret-token", "measure/operator": "Anna Berg"}
    log = ["09:00 info: 161.23 Hz: max - min 1234.5 ± 0.2 µm", "09:01 error: maria.m lost the card"]
    recent = RecentErrors()
    try:
        raise ValueError(f"cannot read {runs}")
    except ValueError as error:
        recent.note(error)
    path, comment = tmp_path / "report.zip", "it hangs"
    write_problem_report(path, ProblemFacts(comment, log, settings, str(bench), None, runs), recent)
    found = contents(path)
    everything = "\n".join(found.values())
    for secret in ("very-secret-token", "maria", "lab-pc-17", str(tmp_path), "1234.5", "161.2345", "0.0012345"):
        assert secret not in everything, secret
    assert "Anna Berg" in found["settings.json"]
    assert "<login> lost the card" in found["log.txt"]
    assert found["comment.txt"] == comment
    assert "ValueError: cannot read ~/runs" in found["errors.txt"]
    assert "numpy " in found["versions.txt"]
    assert "test_a_report_has_no_measured_value" in found["threads.txt"]
    assert 'name = "bench 1"' in found["bench.toml"]
    header = json.loads(found["last_run.json"])
    assert header["name"] == run.name
    assert header["specimen"] == "T7"
    assert header["parameters"]["peak_to_peak_v"] == 5.0
    assert header["bench"]["name"] == "bench 1"
    with Run(run) as whole:
        columns = {name for name, column in whole.points().items() if np.size(column)}
    assert not columns & header.keys()
    assert not list(tmp_path.glob("*.part"))


def test_errors_of_every_thread_and_warnings_are_noted(monkeypatch: pytest.MonkeyPatch) -> None:
    recent, called = RecentErrors(), []
    monkeypatch.setattr(threading, "excepthook", lambda _: None)  # pytest's own would fail the test
    with recent.observe(lambda: called.append(threading.current_thread().name)):
        logging.getLogger("drivers").warning("the card was late")
        thread = threading.Thread(target=lambda: 1 / 0, name="bench 7")
        thread.start()
        thread.join()
    assert called == ["bench 7"]
    assert "in thread bench 7" in recent.errors[-1]
    assert "ZeroDivisionError" in recent.errors[-1]
    assert any("the card was late" in record for record in recent.records)
    logging.getLogger("drivers").warning("later")
    assert not any("later" in record for record in recent.records)


def test_a_damaged_or_missing_run_does_not_prevent_a_report(tmp_path: Path) -> None:
    damaged = tmp_path / "run.h5"
    damaged.write_bytes(b"no HDF5")
    for run, folder in ((damaged, tmp_path), (None, tmp_path / "nowhere")):
        write_problem_report(
            tmp_path / "report.zip", ProblemFacts(run=run, folder=folder, bench="gone.toml"), RecentErrors()
        )
        found = contents(tmp_path / "report.zip")
        assert "gone.toml" in found["bench.toml"]
        assert ("problem" in json.loads(found["last_run.json"])) is (run is not None)


def test_short_names_are_not_replaced_inside_other_words(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(getpass, "getuser", lambda: "po")
    assert problem_report.make_redaction()("points") == "points"
