"""Batch of runs on a busy computer: it continues where it was interrupted, and only with the same code."""

import json
import re
from dataclasses import asdict
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import pytest

from drivers.watchdog.client import WatchdogClient
from tests.helpers import loaded_runs
from tests.helpers.loaded_runs import RUNS_PER_BENCH, Batch, LoadedRun, Silence, summary

RUN = LoadedRun(RUNS_PER_BENCH, "sweep", 2.0, 6.0, 3.0, "completed", "good", "", True, "", "", 0, ("stroke",), 0.2)


@pytest.mark.deep
def test_a_batch_continues_with_the_benches_that_are_left(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(loaded_runs, "code_state", lambda: "here")
    (tmp_path / "runs.jsonl").write_text("".join(json.dumps(asdict(RUN)) + "\n" for _ in range(3)))
    batch = Batch(2 * RUNS_PER_BENCH, 1.0, tmp_path)
    batch.resume()
    assert batch.ran == [RUN] * 3
    assert [index for index in range(2) if index not in batch.made] == [0]
    assert "longest silence of a run thread: 0.20 s" in summary(batch.ran)
    Batch(2 * RUNS_PER_BENCH, 1.0, tmp_path).resume()
    with pytest.raises(ValueError, match="seed 2"):
        Batch(2 * RUNS_PER_BENCH, 1.0, tmp_path, seed=2).resume()
    monkeypatch.setattr(loaded_runs, "code_state", lambda: "elsewhere")
    with pytest.raises(ValueError, match=re.escape(str(tmp_path))):
        Batch(2 * RUNS_PER_BENCH, 1.0, tmp_path).resume()


@pytest.mark.deep
def test_the_longest_silence_is_that_in_which_no_longer_one_was_allowed(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s, sent = 0.0, list[str]()
    client = SimpleNamespace(notices_after_s=0.4, _send=sent.append)
    monkeypatch.setattr(loaded_runs.time, "monotonic", lambda: now_s)
    silence = Silence(cast(WatchdogClient, client))
    for passed_s, line in (
        (9.0, "live"),
        (0.1, "beat 0.400"),
        (0.3, "beat 3.000"),
        (2.0, "beat 0.400"),
        (0.2, "rest"),
        (9.0, "live"),
    ):
        now_s += passed_s
        client._send(line)
    assert silence.longest_s == pytest.approx(0.3)
    assert len(sent) == 6
