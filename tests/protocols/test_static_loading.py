"""Static loading on the simulated bench: the plant's compliance is measured, operator errors are reported."""

import math
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from drivers import Hold
from model.parameters import Tactor
from model.response.statics import load_compliance
from protocols.base import Prompt, PromptAnswered, PromptShown, Quality, Recording, RunStatus
from protocols.measurements.load_point import compliance, nonlinearity
from protocols.measurements.static_loading import StaticLoading, uncertainty_kg
from protocols.rehearsal import rehearse
from protocols.runfile.reader import Run
from tests.helpers import simulated_bench
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import Ran, run

COMPLIANCE = load_compliance(Tactor())
SHORT = StaticLoading(repeats=1, weights_kg=(0.05, 0.2), sides="MFC up", sample_rate_hz=1000, settle_s=0.5)


def simulated(**truth: Any) -> Any:
    """A bench whose plant has a coarse grid: nothing here moves fast."""
    return simulated_bench.simulated(**{"plant_rate_hz": 10e3, **truth})


@contextmanager
def laboratory(config: Any) -> Iterator[Any]:
    with simulated_bench.laboratory(config) as lab:
        lab.bench.block_s = 0.2  # fewer, larger blocks: latency does not matter here
        yield lab


class Clumsy:
    """A simulated operator who once performs another action, given by `does`."""

    def __init__(self, lab: Any, does: Callable[["Clumsy", Prompt], Prompt | str | None]) -> None:
        self.operator, self.bench, self.does = lab.operator, lab.control, does
        self.asked: list[Prompt] = []
        self._answers: dict[int, str] = {}

    def show(self, ask_id: int, prompt: Prompt) -> None:
        self.asked.append(prompt)
        instead = self.does(self, prompt)
        if isinstance(instead, str):
            self._answers[ask_id] = instead
        else:
            self.operator.show(ask_id, instead or prompt)

    def answer(self, ask_id: int) -> str | None:
        return self._answers.pop(ask_id, None) or self.operator.answer(ask_id)

    def times(self, action: str) -> int:
        return sum(prompt.action == action for prompt in self.asked)


def estimates_of(ran: Ran) -> dict[str, tuple[float, float]]:
    with Run(ran.path) as file:
        return {e.name: (e.value, e.standard_error) for e in file.record.estimates}


def asked_texts(ran: Ran) -> list[str]:
    return [event.prompt.text for event in ran.events if isinstance(event, PromptShown)]


def asked_about(ran: Ran, action: str) -> list[Prompt]:
    return [e.prompt for e in ran.events if isinstance(e, PromptShown) and e.prompt.action == action]


def test_the_plants_compliance_comes_out_on_both_sides_without_a_key(tmp_path: Path) -> None:
    with laboratory(simulated()) as lab:
        ran = run(StaticLoading(repeats=1, sample_rate_hz=1000), tmp_path, lab)
        assert not lab.control.history.high_voltage_on
        assert lab.control.plant.setup_state.shorted
    assert ran.status == RunStatus.COMPLETED
    assert len(ran.points) == 10
    for point in ran.points:
        assert point.quality == Quality.SIMULATED
        assert abs(point.deflection - COMPLIANCE * point.load) < 5 * point.deflection_errors + 1e-9
    found = estimates_of(ran)
    for name in ("compliance, MFC up", "compliance, aluminium up", "compliance, mean of both sides"):
        value, error = found[name]
        assert abs(value - COMPLIANCE) < 4 * error < 0.004 * COMPLIANCE
    assert abs(found["side_difference"][0]) < 4 * found["side_difference"][1]
    assert abs(found["nonlinearity, MFC up"][0]) < 4 * found["nonlinearity, MFC up"][1] < 0.01
    placed = {e.ask_id for e in ran.events if isinstance(e, PromptShown) and e.prompt.action.endswith("-weight")}
    assert len(placed) == 20
    assert {e.words for e in ran.events if isinstance(e, PromptAnswered) and e.ask_id in placed} == {
        "seen by the laser"
    }


@pytest.mark.deep
def test_a_side_that_is_stiffer_and_creep_and_wrong_weights_are_noticed(tmp_path: Path) -> None:
    truth = {"side_difference": 0.1, "weight_error": 0.01}
    protocol = StaticLoading(
        repeats=1, weight_class="own", weight_errors_kg=(2e-4, 5e-4, 1e-3, 2e-3, 5e-3), sample_rate_hz=1000
    )
    with laboratory(simulated(beyond=truth, seed=4)) as lab:
        ran = run(protocol, tmp_path, lab)
    found = estimates_of(ran)
    tactor = Tactor()
    up, down = (load_compliance(replace(tactor, k2=k * tactor.k2)) for k in (1.05, 0.95))
    difference, error = found["side_difference"]
    assert abs(difference - 2 * (up - down) / (up + down)) < 4 * error
    assert abs(difference) > 5e-3
    # The weights are wrong: the fit shows it, and its standard error is larger.
    mean, error = found["compliance, mean of both sides"]
    assert 1e-4 < error / mean < 0.02
    assert abs(mean - (up + down) / 2) < 4 * error


def test_order_is_random_by_seed_and_the_same_again() -> None:
    def masses(seed: int) -> list[float]:
        return [float(entry.key[1]) for entry in StaticLoading(seed=seed).plan(2.5)]

    assert masses(1) == masses(1) != masses(2)
    plan = StaticLoading().plan(2.5)
    assert len(plan) == 100
    rows = [tuple(e.key[1] for e in plan[i : i + 5]) for i in range(0, 100, 5)]
    assert {tuple(sorted(row)) for row in rows} == {(0.02, 0.05, 0.1, 0.2, 0.5)}
    assert len(set(rows)) > 10
    assert {e.key[0] for e in plan[:50]} == {1.0}


def test_the_rehearsal_tells_hands_and_no_volts(tmp_path: Path) -> None:
    with laboratory(simulated()) as lab:
        rehearsal = rehearse(StaticLoading(), lab.bench.amplifier)
    assert rehearsal.highest_specimen_v == rehearsal.lowest_specimen_v == 0
    assert rehearsal.prompts == 1 + 2 + 200
    assert 600 < rehearsal.duration_s < 2400


@pytest.mark.one_in(100)
@pytest.mark.parametrize(("wrong_kg", "says"), [(0.05, "too little"), (0.5, "too much")])
def test_a_wrong_weight_is_noticed_and_repeated(wrong_kg: float, says: str, tmp_path: Path) -> None:
    def swaps(who: Clumsy, prompt: Prompt) -> Prompt | str | None:
        if prompt.action == "remove-weight":
            return replace(prompt, values={})  # whatever lies there
        first = sum(p.values.get("mass_kg") == 0.2 and p.action == "place-weight" for p in who.asked) == 1
        wrong = prompt.action == "place-weight" and prompt.values["mass_kg"] == 0.2 and first
        return replace(prompt, values={"mass_kg": wrong_kg}) if wrong else None

    with laboratory(simulated()) as lab:
        operator = Clumsy(lab, swaps)
        ran = run(SHORT, tmp_path, lab, operator=operator)
    assert ran.status == RunStatus.COMPLETED
    assert operator.times("implausible-step") == 1
    question = next(text for text in asked_texts(ran) if "expected" in text)
    assert says in question
    assert "200 g weight" in question
    assert len(ran.points) == 2
    for point in ran.points:
        assert point.deflection == pytest.approx(COMPLIANCE * point.load, rel=5e-3)
    with Run(ran.path) as file:
        assert len(list(file.recordings())) == 9  # what went wrong is kept as well


@pytest.mark.deep
def test_a_bumped_sensor_is_noticed_and_the_weight_repeated_or_flagged(tmp_path: Path) -> None:
    for answer, recordings, usable in (("repeat", 9, True), ("keep", 6, False)):

        def bumps(who: Clumsy, prompt: Prompt, answer: str = answer) -> Prompt | str | None:
            if prompt.action == "remove-weight" and who.times("remove-weight") == 1:
                who.bench.perform_action("bump-sensor", {"by_m": 12e-6})
            return answer if prompt.action == "zero-moved" else None

        with laboratory(simulated()) as lab:
            ran = run(SHORT, tmp_path / answer, lab, operator=Clumsy(lab, bumps))
        assert ran.status == RunStatus.COMPLETED
        (asked,) = asked_about(ran, "zero-moved")
        assert "+12." in asked.text
        with Run(ran.path) as file:
            assert len(list(file.recordings())) == recordings
        assert Quality(ran.points[0].quality).usable is usable
        assert bool(ran.points[0].quality & Quality.UNSETTLED) is not usable


@pytest.mark.deep
def test_a_clamp_that_gives_shows_in_the_zero(tmp_path: Path) -> None:
    with laboratory(simulated(beyond={"clamp_gives_m_per_n": 5e-6})) as lab:
        ran = run(SHORT, tmp_path, lab)
    assert asked_about(ran, "zero-moved")
    assert ran.status == RunStatus.COMPLETED
    assert all(Quality(point.quality).usable for point in ran.points)  # it has given, and the repeat is good


def test_creep_after_a_heavy_weight_is_not_asked_about(tmp_path: Path) -> None:
    heavy = SHORT.model_copy(update={"weights_kg": (0.5,), "settle_s": 1.0})
    with laboratory(simulated(beyond={"creep_per_decade": 0.015})) as lab:
        ran = run(heavy, tmp_path, lab)
    assert ran.points[0].drift > 3e-6
    assert not asked_about(ran, "zero-moved")
    assert Quality(ran.points[0].quality).usable


def test_the_wrong_way_three_times_is_a_wrong_sign_in_the_bench_file(tmp_path: Path) -> None:
    config = simulated()
    sensor = config.sensor.model_copy(update={"gain_m_per_v": -config.sensor.gain_m_per_v})
    with laboratory(config.model_copy(update={"sensor": sensor})) as lab:
        ran = run(SHORT, tmp_path, lab)
    assert ran.status == RunStatus.FAILED
    assert ": the wrong way. Either something else moved, or" in ran.reason
    assert "correct gain_m_per_v in the bench file" in ran.reason


@pytest.mark.deep
def test_a_specimen_unlike_the_expected_is_kept_after_three_alike(tmp_path: Path) -> None:
    soft = replace(Tactor(), k2=2.5e-3)
    with laboratory(simulated(tactor={"k2": 2.5e-3})) as lab:
        ran = run(SHORT.model_copy(update={"weights_kg": (0.1,)}), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert sum("attempt 3" in text for text in asked_texts(ran)) == 1
    assert ran.points[0].deflection == pytest.approx(load_compliance(soft) * ran.points[0].load, rel=2e-3)


@pytest.mark.deep
def test_a_sensor_that_stands_still_is_no_deflection(tmp_path: Path) -> None:
    with laboratory(simulated()) as lab:
        lab.control.inject("sensor-stuck")
        ran = run(SHORT, tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    assert all(": too little. Is it the " in prompt.text for prompt in asked_about(ran, "implausible-step"))
    assert asked_about(ran, "implausible-step")
    assert all(point.quality & Quality.NO_RESPONSE for point in ran.points)
    assert estimates_of(ran) == {}


@pytest.mark.deep
def test_the_operator_may_have_the_weight_before_measured_again(tmp_path: Path) -> None:
    def regrets(who: Clumsy, prompt: Prompt) -> Prompt | str | None:
        return "previous again" if prompt.action == "place-weight" and who.times("place-weight") == 2 else None

    with laboratory(simulated()) as lab:
        operator = Clumsy(lab, regrets)
        ran = run(SHORT, tmp_path, lab, operator=operator)
    assert ran.status == RunStatus.COMPLETED
    choices = [p.choices for p in operator.asked if p.action == "place-weight"]
    assert choices[0] == ("done",)  # there is none before the first
    assert "previous again" in choices[1]
    assert len(ran.points) == 3
    assert ran.points[0].mass == ran.points[1].mass != ran.points[2].mass
    with Run(ran.path) as file:
        assert file.points()["mass"].tolist().count(ran.points[0].mass) >= 1


@pytest.mark.deep
def test_a_prompt_may_be_ignored_for_an_hour(tmp_path: Path) -> None:
    asked_s: list[float] = []

    class Asleep(Clumsy):
        def answer(self, ask_id: int) -> str | None:
            if asked_s and self.bench.now() < asked_s[0] + 3600:
                return None
            if asked_s and asked_s[0] > 0:
                asked_s[0] = -math.inf
                self.operator.show(ask_id, self.asked[-1])
            return super().answer(ask_id)

    def sleeps(who: Clumsy, prompt: Prompt) -> Prompt | str | None:
        if prompt.action == "place-weight" and not asked_s:
            asked_s.append(who.bench.now())
            return Prompt("sleep", "")
        return None

    with laboratory(simulated(plant_rate_hz=10e3)) as lab:
        lab.bench.block_s = 4.0
        operator = Asleep(lab, sleeps)
        ran = run(SHORT.model_copy(update={"sample_rate_hz": 500.0}), tmp_path, lab, operator=operator)
        assert lab.control.now() > 3600
    assert ran.status == RunStatus.COMPLETED
    assert len(ran.points) == 2
    assert all(p.deflection == pytest.approx(COMPLIANCE * p.load, rel=5e-3) for p in ran.points)


PROMPTS = ("disable-high-voltage", "turn-side", "place-weight", "remove-weight", "implausible-step", "zero-moved")


@pytest.mark.one_in(3)
@pytest.mark.parametrize("action", PROMPTS)
def test_stop_at_any_prompt_keeps_what_was_measured(action: str, tmp_path: Path) -> None:
    cancel = threading.Event()

    def stops(who: Clumsy, prompt: Prompt) -> Prompt | str | None:
        second = who.times(prompt.action) == 2
        if prompt.action == action and (second or not action.endswith("-weight")):
            cancel.set()
            return Prompt("nothing", "")
        if action == "implausible-step" and prompt.action == "place-weight" and second:
            return replace(prompt, values={"mass_kg": 1.0})
        if action == "zero-moved" and prompt.action == "remove-weight" and second:
            who.bench.perform_action("bump-sensor", {"by_m": 1e-4})
        return None

    with laboratory(simulated()) as lab:
        ran = run(SHORT, tmp_path, lab, operator=Clumsy(lab, stops), cancel=cancel)
        assert not lab.control.history.high_voltage_on
    assert ran.status == RunStatus.STOPPED
    assert_names(ran.reason, "operator", len(ran.points))
    first = 0 if action in ("disable-high-voltage", "turn-side") else 1
    assert len(ran.points) == first
    with Run(ran.path) as file:
        assert len(file.points()["deflection"]) == first
        assert file.trace.sample_count > 0 or first == 0


@pytest.mark.breaks_the_drive
def test_hands_never_wait_under_a_drive_that_is_not_at_rest(tmp_path: Path) -> None:
    def pulls(who: Clumsy, prompt: Prompt) -> Prompt | str | None:
        if prompt.action == "place-weight" and who.times("place-weight") == 2:
            who.bench.inject("drive-cable-off")
        return None

    with laboratory(simulated()) as lab:
        ran = run(SHORT, tmp_path, lab, operator=Clumsy(lab, pulls), safe=False)
    assert ran.status == RunStatus.FAILED
    assert "hands are on the specimen, and the card sees" in ran.reason
    assert len(ran.points) == 1


@pytest.mark.parametrize(
    ("parameters", "says"),
    [
        ({"weight_class": "own", "weight_errors_kg": (1e-6,)}, "1 uncertainties for 5 weights"),
        ({"weights_kg": (0.1, 0.1)}, "names a weight twice"),
        ({"weights_kg": ()}, "at least 1 item"),
        ({"weight_class": "Q1"}, "'F1', 'F2', 'M1'"),
        ({"plausible_factor": 1.0}, "greater than 1"),
    ],
)
def test_what_cannot_be_weighed_is_a_sentence(parameters: dict[str, Any], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        StaticLoading(**parameters)


def test_weights_of_a_class_err_as_oiml_r111_says() -> None:
    assert uncertainty_kg(0.5, "M1") == pytest.approx(25e-6 / math.sqrt(3))
    assert uncertainty_kg(0.02, "F1") == pytest.approx(0.25e-6 / math.sqrt(3))
    assert uncertainty_kg(0.1, "M1") < uncertainty_kg(0.15, "M1") < uncertainty_kg(0.2, "M1")


def made(loads: Any, moved: Any, errors: Any, load_errors: float = 0.0) -> list[Any]:
    return [
        SimpleNamespace(load=float(f), deflection=float(w), deflection_errors=float(e), load_errors=load_errors)
        for f, w, e in zip(loads, moved, errors, strict=True)
    ]


def test_the_lines_standard_error_is_what_repeating_the_world_shows() -> None:
    rng = np.random.default_rng(5)
    loads = np.repeat([0.2, 0.5, 1.0, 2.0, 5.0], 4)
    errors = 1e-7 * (1 + loads)
    lines, bends = [], []
    for _ in range(400):
        moved = 1.4e-4 * loads * (1 + 0.03 * loads / 5.0) + errors * rng.normal(size=loads.size)
        straight = 1.4e-4 * loads + errors * rng.normal(size=loads.size)
        lines.append(compliance(made(loads, straight, errors)))
        bends.append(nonlinearity(made(loads, moved, errors)))
    for results, truth in ((np.array(lines), 1.4e-4), (np.array(bends), 0.03)):
        pulls = (results[:, 0] - truth) / results[:, 1]
        assert abs(pulls.mean()) < 0.2
        assert 0.8 < pulls.std() < 1.1
    assert compliance(made([1.0], [1e-4], [1e-7])) is None
    assert nonlinearity(made([1.0, 1.0, 2.0], [1e-4, 1e-4, 2e-4], [1e-7] * 3)) is None


def weighed(creep: float, shift_m: float = 0.0) -> Any:
    """Return the point of a weight of 0.5 kg on a specimen of 140 um/N that creeps; its zero moves by `shift_m` meanwhile."""
    rate, rng, put_on, taken_off = 2000.0, np.random.default_rng(3), 3.0 - 0.7, 6.0 - 0.7
    recordings = []
    for i, start_s in enumerate((0.0, 3.0, 6.0)):
        t = start_s + np.arange(round(1.5 * rate)) / rate
        moved = 5e-7 * rng.standard_normal(t.size)
        for at, sign in ((put_on, 1), (taken_off, -1)):
            since = np.maximum(t - at, 1e-9)
            moved += np.where(t > at, sign * 6.86e-4 * (1 + creep * np.log10(since / 1.6e-3)), 0.0)
        moved += shift_m if i == 2 else 0.0
        drive_v = np.full(t.size, 2.5)
        recordings.append(
            Recording(i, (0, t.size), rate, Hold(2.5, 1.5), drive_v, moved, Quality.GOOD, start_s=start_s)
        )
    return StaticLoading().point((1.0, 0.5, 1.0), recordings, simulated=True)


def test_a_zero_that_creeps_back_is_no_scatter_and_one_that_jumps_is() -> None:
    crept, jumped = weighed(0.015), weighed(0.015, 2e-6)
    assert crept.drift > 2e-6, "it has not returned when it is read again"
    assert crept.deflection_errors < 5e-8
    assert jumped.deflection_errors == pytest.approx(2e-6 / np.sqrt(12), rel=0.2)
    assert weighed(0.0).deflection_errors == pytest.approx(crept.deflection_errors, rel=0.5)
