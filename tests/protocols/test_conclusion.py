"""Conclusion of a run: what happens on the way to rest, and an analysis or a judgement that fails."""

import re
import threading
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from protocols.base import Event, EventBus, LogMessage, Outcome, Record, RunEnded, RunStatus, ShutdownStarted
from protocols.runfile.errors import StorageError
from protocols.runfile.reader import Run
from protocols.runner.conclusion import RunConclusion
from protocols.runner.request import RunControl, RunRequest
from protocols.runner.runner import Runner
from tests.helpers.scripted_protocol import SETTLE, Scripted
from tests.helpers.simulated_bench import Trigger, assert_safe_voltage, laboratory


class Unfit(Scripted):
    """Measures a point that it cannot evaluate."""

    def estimates(self, points: Iterable[Any]) -> Any:
        raise ZeroDivisionError("no weight was placed")


@pytest.mark.deep
def test_a_failing_analysis_and_an_event_of_the_shutdown_are_in_events_file_and_reason(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    events: list[Event] = []
    control = RunControl(threading.Event(), threading.Event())
    during = Trigger(
        lambda event: isinstance(event, ShutdownStarted),
        lambda: control.external_events.put(LogMessage("fault injected on the way to rest")),
    )
    with laboratory() as lab:
        request = RunRequest(Unfit(script=(SETTLE, Record(0.05))), tmp_path, "T1")
        runner = Runner(request, lab.bench, lab.operator, EventBus(events.append, during), control)
        ended = runner.run()
        assert_safe_voltage(lab.control.report())
    assert ended.status is RunStatus.COMPLETED
    assert re.search(rf"{re.escape(__file__)}, line \d+: ZeroDivisionError: no weight was placed$", ended.reason)
    assert ended.verdict.outcome is not Outcome.GOOD
    assert isinstance(events[-1], RunEnded)
    assert [event.text for event in events if isinstance(event, LogMessage)][-1] == "fault injected on the way to rest"
    with Run(runner.path) as file:
        assert file.record.reason == ended.reason
        assert any("on the way to rest" in str(event.fields.get("text", "")) for event in file.events())


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("status", "becomes"),
    [
        (RunStatus.COMPLETED, RunStatus.FAILED),
        (RunStatus.STOPPED, RunStatus.FAILED),
        (RunStatus.FAILED, RunStatus.FAILED),
        (RunStatus.UNSAFE, RunStatus.UNSAFE),
    ],
)
@pytest.mark.parametrize("step", ["check_presence", "finish"])
def test_a_file_that_is_lost_at_the_end_hides_no_reason(status: RunStatus, becomes: RunStatus, step: str) -> None:
    """An unsafe run stays unsafe, with the manual instruction; a failed one keeps why it failed."""

    def refuse(*_: object) -> None:
        raise StorageError("the file was deleted")

    nothing = dict.fromkeys(
        ("check_presence", "close_after_error", "publish_external", "publish_always"), lambda *_: None
    )
    nothing |= {"finish": lambda status, reason, *_: reason, "notify": lambda _: None, step: refuse}
    progress = SimpleNamespace(points=[], plan=[], series=[], warnings=())
    parts: Any = SimpleNamespace(path="run.h5", **nothing)
    conclusion = RunConclusion(Scripted(), cast(Any, None), parts, parts, cast(Any, progress))
    ended = conclusion.conclude(status, "the reason of before", None)
    assert ended.status is becomes
    kept = status in (RunStatus.FAILED, RunStatus.UNSAFE)
    assert ("the reason of before" in ended.reason, "the file was deleted" in ended.reason) == (kept, not kept)
