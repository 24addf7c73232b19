"""Drives: their declared properties hold for their samples."""

import math
from typing import get_args

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from drivers.drive_shapes import (
    DRIVES,
    Drive,
    Hold,
    LinearSweep,
    PeriodicSweep,
    Ramp,
    Sine,
    SquareWave,
    Steps,
    as_record,
    from_record,
)

pytestmark = pytest.mark.one_in(1)

volts = st.floats(-1, 6)
seconds = st.floats(0.01, 5)
hertz = st.floats(1, 500)
drives: st.SearchStrategy[Drive] = st.one_of(
    st.builds(Hold, volts, seconds),
    st.builds(Ramp, volts, volts, seconds),
    st.builds(Sine, hertz, st.floats(0.01, 3), volts, st.integers(1, 50)),
    st.builds(LinearSweep, hertz, hertz, seconds, st.floats(0.01, 3), volts),
    st.builds(
        SquareWave, hertz, st.floats(0.01, 3), volts, st.floats(0.2, 0.8), st.floats(1e-5, 2e-4), st.integers(1, 50)
    ),
    st.builds(Steps, st.lists(volts, min_size=1, max_size=6).map(tuple), seconds, seconds),
)
periodic = st.builds(PeriodicSweep, hertz, hertz, seconds, st.integers(1, 9), st.floats(0.01, 3), volts)


@given(drives)
def test_samples_stay_between_the_extremes_and_begin_and_end_as_told(drive: Drive) -> None:
    t = np.linspace(0, drive.duration_s, 5000)
    v = drive.volts(t)
    assert v.min() >= drive.low_v - 1e-9
    assert v.max() <= drive.high_v + 1e-9
    assert v[0] == pytest.approx(drive.end_levels_v[0], abs=1e-6)
    assert v[-1] == pytest.approx(drive.end_levels_v[1], abs=1e-6)


@given(drives)
def test_no_two_samples_differ_by_more_than_the_slope_allows(drive: Drive) -> None:
    t = np.linspace(0, drive.duration_s, 5000)
    steepest = np.abs(np.diff(drive.volts(t))).max() / (t[1] - t[0])
    assert steepest <= drive.slew_v_per_s * (1 + 1e-6) + 1e-6


@given(drives | periodic)
def test_a_drive_survives_its_record(drive: Drive) -> None:
    assert from_record(as_record(drive)) == drive


def test_kinds_in_files_never_change_and_every_drive_has_its_own() -> None:
    assert set(DRIVES) == {"Hold", "Ramp", "Sine", "LinearSweep", "PeriodicSweep", "Steps", "SquareWave"}
    assert list(DRIVES.values()) == list(get_args(Drive))
    assert as_record(Hold(2.5, 1.0)) == {"kind": "Hold", "level_v": 2.5, "duration_s": 1.0}


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"kind": "Chirp", "level_v": 1.0}, "unknown drive 'Chirp': this version has Hold, .*; install a newer one"),
        ({"level_v": 1.0}, "unknown drive None"),
        ({"kind": "Hold", "volts": 1.0}, "not a drive: "),
    ],
)
def test_a_record_that_is_no_drive_of_this_version_is_refused(record: dict[str, object], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        from_record(record)


def test_extremes_are_reached_not_just_bounded() -> None:
    sine = Sine(100, 2.0, 2.5, 10)
    v = sine.volts(np.linspace(0, sine.duration_s, 100_001))
    assert v.min() == pytest.approx(0.5, abs=1e-4)
    assert v.max() == pytest.approx(4.5, abs=1e-4)


def test_a_sweep_reaches_its_end_frequency() -> None:
    sweep = LinearSweep(25, 525, 4.0, 2.5, 2.5)
    t = np.linspace(3.99, 4.0, 20_001)
    rises = np.flatnonzero(np.diff(np.sign(sweep.volts(t) - 2.5)) > 0)
    assert 1 / np.diff(t[rises]).mean() == pytest.approx(525, rel=0.01)


@pytest.mark.parametrize(
    "make",
    [
        lambda: Sine(0, 1, 2.5, 1),
        lambda: Sine(100, -1, 2.5, 1),
        lambda: Sine(math.nan, 1, 2.5, 1),
        lambda: Hold(math.inf, 1),
        lambda: Ramp(0, 1, 0),
        lambda: Steps((), 1, 1),
        lambda: from_record({"kind": "Trapezium"}),
        lambda: from_record({"kind": "Hold", "level_v": 1}),
    ],
)
def test_what_is_no_drive_is_refused(make) -> None:
    with pytest.raises(ValueError, match=r"\w"):
        make()
