"""`start.py`: its help sets nothing up, and few failed tests are repeated alone, once."""

import sys
from pathlib import Path

import pytest

import start

BESIDE_OTHERS = "import os\n\n\ndef test_disturbed():\n    assert 'PYTEST_XDIST_WORKER' not in os.environ\n"
BROKEN = "def test_broken():\n    assert False\n"


@pytest.mark.parametrize(
    ("files", "passes"),
    [([BESIDE_OTHERS], True), ([BESIDE_OTHERS, BROKEN], False), ([BESIDE_OTHERS] * (start.REPEATED_TESTS + 1), False)],
    ids=["disturbed", "broken", "many"],
)
@pytest.mark.deep
def test_a_test_that_fails_beside_others_only_is_no_failure(
    files: list[str], passes: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for k, text in enumerate(files):
        (tmp_path / f"test_{k}.py").write_text(text)
    (tmp_path / "pytest.ini").write_text("[pytest]\n")
    monkeypatch.setattr(start, "HERE", tmp_path)
    monkeypatch.setattr(start, "CHECKS", ())
    monkeypatch.setattr(start, "TYPES", (sys.executable,))  # it reads no program and ends
    monkeypatch.delenv("PYTEST_XDIST_WORKER", raising=False)
    assert (start.run_checks([], deep=False) == 0) is passes


def test_help_sets_nothing_up(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    monkeypatch.setattr(start, "set_up", None)
    assert start.main(["--help"]) == 0
    assert capsys.readouterr().out == f"{(start.__doc__ or '').rstrip()}\n"
