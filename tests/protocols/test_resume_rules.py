"""Rules of resuming: which points are carried over, which entries a name means, what counts as drift."""

from collections.abc import Callable
from dataclasses import dataclass, fields, replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from protocols import base, resume, runfile
from protocols.base import Quality, RunStatus
from protocols.resume import ResumableRun, find_entries, load_resumable, measured_points
from protocols.runfile.errors import RunReadError
from protocols.runfile.record import RunRecord

FILE = Path("earlier.h5")


@dataclass
class Point:
    frequency: float
    windows: tuple[float, ...]
    quality: int = 0


class EarlierRun:
    """A run as `resume` reads it: four entries, of which three were begun and two have a point."""

    def __init__(self, **changes: Any) -> None:
        self.record = RunRecord(status=RunStatus.STOPPED, specimen="T1")
        self.labels = ["150 Hz", "155 Hz", "2.54 mm, 155 Hz", "left"]
        self.entry_of = [0, 1, 1]
        self.flags = [0, int(Quality.CLIPPED), 0]
        stored = {f.name for f in fields(RunRecord)} & changes.keys()
        self.record = replace(self.record, **{name: changes.pop(name) for name in stored})
        vars(self).update(changes)

    def __enter__(self) -> "EarlierRun":
        return self

    def __exit__(self, *_: object) -> None: ...

    def entries(self) -> dict[int, Any]:
        return {i: SimpleNamespace(label=label, key=(label,)) for i, label in enumerate(self.labels)}

    def events(self, *kinds: str) -> tuple[Any, ...]:
        return ()

    def points(self) -> dict[str, Any]:
        count = len(self.entry_of)
        return {
            "entry": np.array(self.entry_of),
            "frequency": 150.0 + np.arange(count),
            "windows": np.arange(2.0 * count).reshape(count, 2),
            "quality": np.array(self.flags, np.int64),
        }

    def series(self) -> tuple[Any, ...]:
        return tuple(SimpleNamespace(entry=i) for i in range(4))


Earlier = Callable[..., None]


@pytest.fixture
def earlier(monkeypatch: pytest.MonkeyPatch) -> Earlier:
    def make(plan: tuple[str, ...] = ("150 Hz", "155 Hz", "2.54 mm, 155 Hz", "left"), **changes: Any) -> None:
        run = EarlierRun(**changes)
        protocol = SimpleNamespace(point_type=Point, plan=lambda _: (), repeatable=True, uncounted=lambda _: "")
        monkeypatch.setattr(runfile, "Run", lambda _: run)
        monkeypatch.setattr(resume, "protocol_of_run", lambda *_: protocol)
        monkeypatch.setattr(
            base, "extend_plan", lambda *_: [SimpleNamespace(key=(label,), label=label) for label in plan]
        )

    return make


# -- what is carried over --------------------------------------------------------------------------------------------------


def test_the_last_point_of_every_entry_is_carried_over_and_the_last_entry_checked(earlier: Earlier) -> None:
    earlier()
    state = load_resumable(FILE)
    assert state.points == ((0, Point(150.0, (0.0, 1.0))), (1, Point(152.0, (4.0, 5.0))))
    assert state.drift_check_entry == 1
    assert state.message == "Continues earlier.h5 (stopped), 2 points carried over"
    assert [curve.entry for curve in state.series] == [0, 1]


def test_a_point_whose_entry_the_plan_has_no_more_is_left_behind(earlier: Earlier) -> None:
    for plan in (("150 Hz", "160 Hz"), ("150 Hz",)):
        earlier(plan)
        state = load_resumable(FILE)
        assert [entry for entry, _ in state.points] == [0]
        assert state.drift_check_entry == 0
        assert state.message.endswith("1 points carried over, 1 dropped: the plan has other entries in their place now")


def test_an_entry_that_is_measured_again_needs_no_drift_check(earlier: Earlier) -> None:
    earlier()
    state = load_resumable(FILE, [1])
    assert state.drift_check_entry is None
    assert state.repeat_entries == {1}
    for unknown in (-1, 4):
        with pytest.raises(RunReadError, match=f"has no point of entry {unknown}; it has 2 points"):
            load_resumable(FILE, [unknown])


@pytest.mark.parametrize(
    ("changes", "refused"),
    [
        ({"status": RunStatus.RUNNING}, "is still being written; stop that run first"),
        ({"status": RunStatus.RUNNING, "crashed": True}, ""),
        ({"imported": True}, "was imported, not measured"),
        ({"status": RunStatus.COMPLETED}, ""),
        ({"status": RunStatus.COMPLETED, "entry_of": [0, 1, 2, 3], "flags": [0] * 4}, "is complete: there is nothing"),
        ({"status": RunStatus.FAILED, "entry_of": [0, 1, 2, 3], "flags": [0] * 4}, ""),
    ],
)
def test_what_cannot_be_resumed(earlier: Earlier, changes: dict[str, Any], refused: str) -> None:
    earlier(**changes)
    if refused:
        with pytest.raises(RunReadError, match=refused):
            load_resumable(FILE)
    else:
        assert load_resumable(FILE).record.specimen == "T1"


def test_points_are_read_with_the_types_of_their_fields(earlier: Earlier) -> None:
    found = measured_points(EarlierRun(), Point)  # type: ignore[arg-type]
    assert [entry for entry, _ in found] == [0, 1, 1]
    assert [type(point.quality) for _, point in found] == [int] * 3
    assert Quality.CLIPPED in Quality(found[1][1].quality)
    assert found[2][1] == Point(152.0, (4.0, 5.0))

    @dataclass
    class Plain:
        frequency: float

    assert [point for _, point in measured_points(EarlierRun(), Plain)] == [Plain(150.0), Plain(151.0), Plain(152.0)]  # type: ignore[arg-type]


# -- names of entries ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("names", "entries"),
    [
        (["155"], (1, 2)),
        (["155.0"], (1, 2)),
        (["155 hz "], (1, 2)),
        (["2.54 mm"], (2,)),
        (["2.54 mm, 155 Hz"], (2,)),
        (["left"], (3,)),
        (["150", "left"], (0, 3)),
        (["flagged"], (2, 3)),
    ],
)
def test_entries_are_found_by_label_part_or_number(
    earlier: Earlier, names: list[str], entries: tuple[int, ...]
) -> None:
    earlier()
    assert find_entries(FILE, names) == entries


@pytest.mark.parametrize("name", ["right", "151", "15", "hz"])
def test_a_name_of_no_entry_is_refused_with_the_entries_that_there_are(earlier: Earlier, name: str) -> None:
    earlier()
    with pytest.raises(RunReadError, match=f"has no entry '{name}'; it has: 150 Hz; 155 Hz; 2.54 mm, 155 Hz; left"):
        find_entries(FILE, [name])


def test_a_run_without_flagged_points_has_nothing_to_measure_again(earlier: Earlier) -> None:
    earlier(entry_of=[0, 1, 2, 3], flags=[0] * 4)
    with pytest.raises(RunReadError, match="has no flagged points"):
        find_entries(FILE, ["flagged"])


# -- drift -----------------------------------------------------------------------------------------------------------------


def drift(first: dict[str, float], second: dict[str, float]) -> tuple[str, bool]:
    protocol: Any = SimpleNamespace(axes=("frequency", "peak"))
    message, prompt = ResumableRun(FILE, protocol, RunRecord(specimen="T1")).assess_drift(
        "155 Hz", SimpleNamespace(**first), SimpleNamespace(**second)
    )
    return message, prompt is not None


@pytest.mark.parametrize(
    ("second", "errors", "message", "asks"),
    [
        (1.05, (0.006, 0.008), "peak changed by +5.00 % (5.0 standard errors)", True),
        (0.95, (0.006, 0.008), "peak changed by -5.00 % (5.0 standard errors)", True),
        (1.05, (0.006, 0.012), "peak changed by +5.00 % (3.7 standard errors)", False),
        (1.019, (0.0006, 0.0008), "peak changed by +1.90 % (19.0 standard errors)", False),
        (1.021, (0.0006, 0.0008), "peak changed by +2.10 % (21.0 standard errors)", True),
    ],
)
def test_drift_is_asked_about_where_it_is_large_and_more_than_errors_explain(
    second: float, errors: tuple[float, float], message: str, asks: bool
) -> None:
    seen = drift({"peak": 1.0, "peak_errors": errors[0]}, {"peak": second, "peak_errors": errors[1]})
    assert seen == (f"Drift check at 155 Hz: {message}", asks)


def test_drift_of_points_without_errors_is_judged_by_its_size() -> None:
    assert drift({"peak": 1.0}, {"peak": 1.05}) == ("Drift check at 155 Hz: peak changed by +5.00 %", True)
    assert drift({"peak": 1.0}, {"peak": 1.01}) == ("Drift check at 155 Hz: peak changed by +1.00 %", False)
    assert drift({"peak": 0.0}, {"peak": 0.01}) == ("Drift check at 155 Hz: peak changed by +inf %", True)
