"""Prompts of a simulated bench that a person answers, and the simulated bench's time in the person's."""

from collections.abc import Iterator

import pytest

from app.config.bench_file import BenchConfig, load_bench
from app.live.session_link import PromptMailbox
from app.session.bench_connection import BenchConnection, connect
from app.session.simulation import AnsweredBy, PractisingOperator, SimulationSettings, format_bench_duration, practise
from protocols.base import Prompt
from sim_hardware.operator import SimulatedOperator

PLACE = Prompt("place-weight", "Place 50 g on the cylinder.", {"mass_kg": 0.05}, ("done", "repeat the last"))


@pytest.fixture
def config() -> BenchConfig:
    return load_bench("ideal")


@pytest.fixture
def connection(config: BenchConfig) -> Iterator[BenchConnection]:
    with connect(config, None) as opened:
        yield opened


def operator_of(connection: BenchConnection, settings: SimulationSettings) -> tuple[PractisingOperator, PromptMailbox]:
    assert isinstance(connection.operator, SimulatedOperator)
    mailbox = PromptMailbox()
    return PractisingOperator(mailbox, connection.operator, settings), mailbox


def displacement_m(connection: BenchConnection) -> float:
    assert connection.control is not None
    reading = connection.control.laser_reading_m()
    assert reading is not None
    return reading


def test_what_a_person_confirms_is_done_on_the_simulated_bench_and_not_before(connection: BenchConnection) -> None:
    operator, mailbox = operator_of(connection, SimulationSettings(20.0, AnsweredBy.USER))
    clock = connection.bench.clock
    before = displacement_m(connection)
    operator.show(1, PLACE)
    clock.sleep(30.0)
    assert operator.answer(1) is None
    assert displacement_m(connection) == pytest.approx(before, abs=2e-6)
    assert mailbox.reply(1, "done")
    while operator.answer(1) is None:
        clock.sleep(0.1)
    clock.sleep(1.0)
    assert abs(displacement_m(connection) - before) > 50e-6


def test_another_answer_does_nothing_to_the_bench(connection: BenchConnection) -> None:
    operator, mailbox = operator_of(connection, SimulationSettings(20.0, AnsweredBy.USER))
    before = displacement_m(connection)
    operator.show(1, PLACE)
    assert mailbox.reply(1, "repeat the last")
    assert operator.answer(1) == "repeat the last"
    connection.bench.clock.sleep(5.0)
    assert displacement_m(connection) == pytest.approx(before, abs=2e-6)


@pytest.mark.parametrize(
    ("speed", "answered_by", "in_campaign", "asked"),
    [
        (1.0, AnsweredBy.USER, False, True),
        (20.0, AnsweredBy.USER_IN_CAMPAIGN, True, True),
        (20.0, AnsweredBy.USER_IN_CAMPAIGN, False, False),
        (20.0, AnsweredBy.SIMULATION, True, False),
        (None, AnsweredBy.USER, True, False),
    ],
)
@pytest.mark.one_in(1)
def test_the_virtual_clock_never_waits_for_a_person(
    connection: BenchConnection, speed: float | None, answered_by: AnsweredBy, in_campaign: bool, asked: bool
) -> None:
    operator, mailbox = operator_of(connection, SimulationSettings(speed, answered_by, in_campaign))
    operator.show(1, Prompt("disable-high-voltage", "High voltage off."))
    assert (mailbox.pending_id == 1) is asked
    assert (operator.answer(1) is None) is asked


def test_a_connection_keeps_its_controls(config: BenchConfig) -> None:
    mailbox, settings = PromptMailbox(), SimulationSettings(None)
    with practise(lambda: connect(config, None), mailbox, settings)() as opened:
        assert isinstance(opened.operator, PractisingOperator)
        assert opened.control is not None
        opened.operator.clear_specimen()


def test_durations_are_the_persons(connection: BenchConnection) -> None:
    bench = connection.bench
    assert format_bench_duration(600.0, None) == "10 min 00 s"
    assert format_bench_duration(600.0, bench) == "10 min 00 s of bench time"
    bench.configuration = {**bench.configuration, "speed": 20.0}
    assert format_bench_duration(600.0, bench) == "30 s at 20 times real speed"
    bench.configuration = {**bench.configuration, "speed": 1.0}
    assert format_bench_duration(600.0, bench) == "10 min 00 s"
