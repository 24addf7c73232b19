"""Verdict: what a run is worth, from protocol to file and exit code."""

import dataclasses
import json
import math
from dataclasses import dataclass
from pathlib import Path

import h5py
import pytest
from hypothesis import given
from hypothesis import strategies as st

from protocols.base import CheckResult, Outcome, Quality, RunEnded, RunStatus, Verdict, judge, to_jsonable
from protocols.base.quality import REMEDIES
from protocols.base.verdict import usability_checks
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck
from protocols.runfile.reader import Run
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run
from tests.helpers.texts import texts

pytestmark = pytest.mark.one_in(1)

CHECK = CheckResult("gain above rest", 0.5e-6, "m/V", 1e-6, 1e-3, "check the optics", Outcome.DID_NOT_PASS)
numbers = st.floats(allow_nan=True, allow_infinity=False)
checks = st.builds(
    CheckResult,
    texts(max_size=20),
    numbers,
    st.sampled_from(("1", "m/V", "Hz")),
    st.none() | st.floats(-1e6, 1e6),
    st.none() | st.floats(-1e6, 1e6),
    texts(max_size=20),
    st.sampled_from(Outcome),
)


@given(
    st.builds(Verdict, st.sampled_from(Outcome), st.lists(texts(max_size=30)).map(tuple), st.lists(checks).map(tuple))
)
def test_json_round_trip(verdict: Verdict) -> None:
    again = Verdict.from_record(json.loads(verdict.to_json()))
    assert (again.outcome, again.reasons) == (verdict.outcome, verdict.reasons)
    for one, other in zip(again.checks, verdict.checks, strict=True):
        same = [dataclasses.replace(check, value=0.0) for check in (one, other)]
        assert same[0] == same[1]
        assert one.value == other.value or (math.isnan(one.value) and math.isnan(other.value))


@pytest.mark.parametrize(
    ("value", "low", "high", "passed"),
    [
        (1, None, None, True),
        (1, 1, 1, True),
        (1, 2, None, False),
        (3, None, 2, False),
        (math.nan, None, None, False),
        (math.inf, 1, None, False),
        (-math.inf, None, 2, False),
    ],
)
def test_check_limits(value: float, low: float | None, high: float | None, passed: bool) -> None:
    assert CheckResult("x", value, "1", low, high, "").passed is passed


@pytest.mark.parametrize("first", range(3))
def test_the_worst_consequence_is_the_outcome_whichever_check_it_is_of(
    first: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    mildest_first = (Outcome.DOUBTFUL, Outcome.NO_RESULT, Outcome.DID_NOT_PASS)
    protocol, fine = SineDwell(frequencies_hz=(100,)), CheckResult("fine", 1.0, "", 0.0, None, "")
    monkeypatch.setattr("protocols.base.verdict.usability_checks", lambda *_: (fine,))
    for worst in range(3):
        those = mildest_first[: worst + 1]
        failed = [CheckResult(each, 0.0, "", 1.0, None, "", each) for each in (*those[first:], *those[:first])]
        monkeypatch.setattr(SineDwell, "checks", lambda *_, failed=failed: tuple(failed))
        assert judge(protocol, [], 1).outcome is those[-1]


def test_good_run_is_good_in_event_and_file(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 150)), tmp_path, lab)
    assert ran.verdict.outcome is Outcome.GOOD
    assert all(check.passed for check in ran.verdict.checks)
    ended = ran.events[-1]
    assert isinstance(ended, RunEnded)
    assert to_jsonable(ended)["verdict"]["outcome"] == "good"
    with Run(ran.path) as file:
        assert file.record.verdict == ran.verdict
    with h5py.File(ran.path) as plain:  # without this program
        assert plain["entry/verdict"].asstr()[()] == "good"


@pytest.mark.deep
def test_unusable_points_are_no_result_or_doubtful(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 150)), tmp_path, lab)
    protocol, points = SineDwell(frequencies_hz=(100, 150)), ran.points
    lost = [dataclasses.replace(point, quality=int(Quality.OUT_OF_RANGE | Quality.SIMULATED)) for point in points]
    assert judge(protocol, lost, 2).outcome is Outcome.NO_RESULT
    assert judge(protocol, [], 2).outcome is Outcome.NO_RESULT
    for some in ([points[0], lost[1]], points[:1]):
        verdict = judge(protocol, some, 2)
        assert verdict.outcome is Outcome.DOUBTFUL
        assert verdict.reasons
    (check,) = usability_checks(lost, 2)
    assert_names(check.detail, 2, "range")
    assert check.detail in judge(protocol, lost, 2).reasons[0]


@pytest.mark.deep
def test_wiring_check_outside_its_limits_did_not_pass(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(WiringCheck(polarity=-1), tmp_path, lab)
    assert ran.status is RunStatus.COMPLETED
    assert ran.verdict.outcome is Outcome.DID_NOT_PASS
    assert "polarity" in ran.verdict.reasons[0]
    assert "swap the sign" in ran.verdict.reasons[0]


def test_run_without_completion_is_judged_by_its_status() -> None:
    for status in (RunStatus.STOPPED, RunStatus.FAILED, RunStatus.UNSAFE):
        verdict = RunEnded(status, "because", "run.h5").verdict
        assert (str(verdict.outcome), verdict.reasons) == (str(status), ("because",))
    assert RunEnded(RunStatus.COMPLETED, "all points measured", "run.h5").verdict.outcome is Outcome.NOT_JUDGED


@dataclass(frozen=True)
class Flagged:
    """A point of which only the quality matters."""

    quality: int


def test_the_check_of_the_points_names_causes_missing_points_and_the_remedy_of_the_first_cause() -> None:
    points = [Flagged(int(each)) for each in (Quality.UNSETTLED, Quality.OUT_OF_RANGE, Quality.GOOD)]
    (check,) = usability_checks(points, 3)
    assert (check.detail, check.passed) == ("1 unsettled, 1 out of range", False)
    assert check.remedy == REMEDIES[Quality.OUT_OF_RANGE]
    (check,) = usability_checks(points, 5)
    assert check.detail == "1 unsettled, 1 out of range, 2 without a point"
    (check,) = usability_checks(points[2:], 1)
    assert (check.detail, check.passed) == ("", True)


@pytest.mark.parametrize(
    ("value", "unit", "limit", "text"),
    [
        (2.0, "1", 3.0, "it: 2, limit at least 3"),
        (0.061, "kg", 0.05, "it: 61 g, limit at least 50 g"),
        (0.02, "V", 0.05, "it: 0.02 V, limit at least 0.05 V"),
        (2e-3, "m", 5e-3, "it: 2000 µm, limit at least 5000 µm"),
        (155.0, "Hz", 20.0, "it: 155 Hz, limit at least 20 Hz"),
        (1.0, "", 3.0, "it"),
    ],
)
def test_a_check_is_worded_with_readable_units(value: float, unit: str, limit: float, text: str) -> None:
    assert CheckResult("it", value, unit, limit, None, "remedy").figure == text
