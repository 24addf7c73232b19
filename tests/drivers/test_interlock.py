"""The heartbeat of an interlock: when it beats, when it ends, and when a bench is not armed."""

import itertools
from collections.abc import Callable, Iterator

import pytest

from drivers.bench import interlock as module
from drivers.bench.interlock import FRESH_S, STATE_TIMEOUT_S, Interlock
from drivers.clock import WallClock
from drivers.errors import AcquisitionError, BenchError, CardInUseError, InstrumentError
from drivers.nidaq.digital_lines import NiDigitalLines
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import InterlockParameters, SimulationParameters
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import installed
from tests.helpers.waiting import wait_until
from tests.wires.ni_library import NiLibrary

MONOSTABLE_S, BLOCK_S = 0.5, 0.05


class Lines:
    """Lines with a monostable and a relay; `trouble` is the error of a call, `stuck` the relay's state if it does not move."""

    def __init__(self, now: Callable[[], float], wired: bool = True) -> None:
        self._now, self._wired = now, wired
        self.edges_s: list[float] = []
        self.level = self.closed_before = False
        self.stuck: bool | None = None
        self.trouble: InstrumentError | None = None
        self.is_released = False

    def write(self, high: bool) -> None:
        if self.trouble:
            raise self.trouble
        if high and not self.level:
            self.edges_s.append(self._now())
        self.level = high

    def is_closed(self) -> bool | None:
        if not self._wired:
            return None
        own = bool(self.edges_s) and self._now() - self.edges_s[-1] < MONOSTABLE_S
        return own if self.stuck is None else self.stuck

    def close(self) -> None:
        self.is_released = True


class Scene:
    """An interlock whose card is read every BLOCK_S of a time that stands still otherwise."""

    def __init__(self, wired: bool = True) -> None:
        self.time_s = 100.0
        self.lines = Lines(lambda: self.time_s, wired)
        self.interlock = Interlock(self.lines, MONOSTABLE_S)

    def read_block(self, age_s: float = 0.0, overdue_s: float = -1.0) -> None:
        self.time_s += BLOCK_S
        self.interlock.beat(age_s, overdue_s)

    def read(self, seconds: float, **facts: float) -> None:
        for _ in range(round(seconds / BLOCK_S)):
            self.read_block(**facts)


@pytest.fixture(params=[True, False], ids=["with the relay's state", "without"])
def scene(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Scene:
    made = Scene(request.param)
    monkeypatch.setattr(module.time, "monotonic", lambda: made.time_s)
    return made


def test_without_an_interlock_nothing_is_asked_and_nothing_is_said() -> None:
    none = Interlock()
    none.begin(pytest.fail)
    none.beat(0.0, 0.0)
    none.raise_for_status()
    none.close()
    assert not none.statement


def test_the_line_is_toggled_from_begin_to_end_only_and_often_enough(scene: Scene) -> None:
    scene.read(1.0)
    assert not scene.lines.edges_s
    scene.interlock.begin(scene.read_block)
    begun_s = scene.time_s
    scene.read(3.0)
    scene.interlock.raise_for_status()
    edges = [t for t in scene.lines.edges_s if t > begun_s]
    assert max(b - a for a, b in itertools.pairwise(edges)) < MONOSTABLE_S / 2
    scene.interlock.end()
    count = len(scene.lines.edges_s)
    scene.read(3.0)
    assert len(scene.lines.edges_s) == count
    scene.interlock.raise_for_status()  # a heartbeat that was ended is no fault
    scene.interlock.begin(scene.read_block)
    assert len(scene.lines.edges_s) > count
    scene.interlock.close()
    assert scene.lines.is_released
    count = len(scene.lines.edges_s)
    scene.read(0.3)
    assert len(scene.lines.edges_s) == count, "a released line is not written"


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    "facts", [{"age_s": FRESH_S + 0.01}, {"overdue_s": 0.01}], ids=["old block", "run thread overdue"]
)
def test_the_heartbeat_ends_without_fresh_blocks_and_without_a_run_thread_and_does_not_return(
    scene: Scene, facts: dict[str, float]
) -> None:
    scene.interlock.begin(scene.read_block)
    scene.read(0.3, **{key: value - 0.02 for key, value in facts.items()})  # just inside the limit
    count, last_s = len(scene.lines.edges_s), scene.lines.edges_s[-1]
    assert scene.time_s - last_s <= 2 * BLOCK_S + 1e-9
    scene.read(MONOSTABLE_S - 2 * BLOCK_S, **facts)
    scene.interlock.raise_for_status()
    scene.read(0.3, **facts)
    scene.read(1.0)  # the blocks are fresh again, and the thread runs: too late
    assert len(scene.lines.edges_s) == count
    with pytest.raises(BenchError, match="switched"):
        scene.interlock.raise_for_status()
    scene.interlock.end()
    scene.interlock.begin(scene.read_block)  # the next run
    scene.interlock.raise_for_status()


def test_a_pause_of_the_reading_ends_it(scene: Scene) -> None:
    scene.interlock.begin(scene.read_block)
    scene.time_s += MONOSTABLE_S - 2 * BLOCK_S - 0.01
    scene.read(0.3)
    scene.interlock.raise_for_status()
    scene.time_s += MONOSTABLE_S + 0.01
    count = len(scene.lines.edges_s)
    scene.read(0.3)
    assert len(scene.lines.edges_s) == count
    with pytest.raises(BenchError, match=r"0\.[5-9]"):
        scene.interlock.raise_for_status()


def test_the_monostable_counts_from_a_rising_edge(scene: Scene) -> None:
    scene.interlock.begin(scene.read_block)
    scene.read(0.3)
    while scene.lines.level:  # until the line has fallen: its last edge is a block older
        scene.read_block()
    scene.time_s += MONOSTABLE_S - 2 * BLOCK_S + 0.01
    scene.read_block()
    with pytest.raises(BenchError, match=r"0\.51 s"):
        scene.interlock.raise_for_status()


def test_an_interlock_that_has_dropped_is_no_failure_after_its_heartbeat_was_ended(scene: Scene) -> None:
    scene.interlock.begin(scene.read_block)
    scene.time_s += 2 * MONOSTABLE_S
    scene.read_block()
    with pytest.raises(BenchError):
        scene.interlock.raise_for_status()
    scene.interlock.end()
    scene.interlock.raise_for_status()


def test_a_line_that_cannot_be_written_is_reported(scene: Scene) -> None:
    scene.interlock.begin(scene.read_block)
    scene.lines.trouble = AcquisitionError("the card is not connected")
    scene.read(0.3)
    with pytest.raises(BenchError, match="connected"):
        scene.interlock.raise_for_status()
    scene.lines.trouble, count = None, len(scene.lines.edges_s)
    scene.read(1.0)
    assert len(scene.lines.edges_s) == count  # it can be written again: too late
    scene.interlock.end()
    scene.lines.trouble = AcquisitionError("the card is not connected")
    with pytest.raises(BenchError, match="connected"):
        scene.interlock.begin(scene.read_block)


@pytest.mark.parametrize(("stuck", "words"), [(True, "stuck"), (False, "supply")])
def test_a_relay_that_does_not_move_keeps_the_bench_from_being_armed(
    monkeypatch: pytest.MonkeyPatch, stuck: bool, words: str
) -> None:
    scene = Scene()
    monkeypatch.setattr(module.time, "monotonic", lambda: scene.time_s)
    scene.lines.stuck, begun_s = stuck, scene.time_s
    with pytest.raises(BenchError, match=words):
        scene.interlock.begin(scene.read_block)
    assert scene.time_s - begun_s < MONOSTABLE_S + STATE_TIMEOUT_S + 2 * BLOCK_S + MONOSTABLE_S
    count = len(scene.lines.edges_s)
    assert (count == 0) == stuck
    scene.read(1.0)
    assert len(scene.lines.edges_s) == count  # no heartbeat after a refusal


def test_a_relay_that_is_still_closed_from_the_last_run_is_waited_for(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()
    monkeypatch.setattr(module.time, "monotonic", lambda: scene.time_s)
    scene.interlock.begin(scene.read_block)
    scene.interlock.end()
    ended_s = scene.lines.edges_s[-1]
    scene.interlock.begin(scene.read_block)
    assert next(t for t in scene.lines.edges_s if t > ended_s) - ended_s >= MONOSTABLE_S


def test_a_relay_that_opens_under_the_heartbeat_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = Scene()
    monkeypatch.setattr(module.time, "monotonic", lambda: scene.time_s)
    scene.interlock.begin(scene.read_block)
    scene.lines.stuck = False
    scene.read(0.1)
    with pytest.raises(BenchError, match="opened"):
        scene.interlock.raise_for_status()


SHORT = InterlockParameters("port0/line0", "port0/line1", monostable_s=0.2, release_s=0.05)


class StandingClock(WallClock):
    """A clock on which a simulated interlock works, and which goes on in `sleep` alone."""

    time_s = 100.0

    def now(self) -> float:
        return self.time_s

    def sleep(self, seconds: float) -> None:
        self.time_s += seconds


@pytest.fixture
def served() -> Iterator[ServedBench]:
    truth = {"interlock": {"line": SHORT.line, "state_line": SHORT.state_line, "monostable_s": 0.2, "release_s": 0.05}}
    with ServedBench(SimulatedBench(SimulationParameters.from_record(truth), StandingClock())) as served:
        served.bench.enable_hv()
        yield served


def lines_of(served: ServedBench) -> NiDigitalLines:
    return NiDigitalLines("Dev1", SHORT.line, SHORT.state_line, server=served.card.address)


def is_live(served: ServedBench) -> bool:
    """Whether the simulated specimen has the amplifier's volts."""
    served.bench.report()
    return served.bench.history.high_voltage_on


@pytest.mark.parametrize("kept", [True, False], ids=["kept high", "kept low"])
def test_high_voltage_is_there_after_an_edge_and_gone_when_the_line_keeps_its_level(
    served: ServedBench, kept: bool
) -> None:
    lines = lines_of(served)
    assert (is_live(served), lines.is_closed()) == (False, False)  # the operator's switch alone does nothing
    lines.write(True)
    assert (is_live(served), lines.is_closed()) == (True, True)
    begun_s = served.bench.now()
    served.bench.clock.sleep(0.1)
    lines.write(kept)  # no rising edge
    assert is_live(served)
    served.bench.clock.sleep(0.16)
    assert (is_live(served), lines.is_closed()) == (False, False)
    off_s = served.bench.history.entries()[-1].start_s
    assert off_s - begun_s <= 0.25
    lines.close()


def test_an_operator_who_switches_off_needs_no_monostable(served: ServedBench) -> None:
    lines = lines_of(served)
    lines.write(True)
    served.bench.disable_hv()
    assert not is_live(served)
    lines.close()


@pytest.mark.parametrize("fault", ["interlock-relay-stuck", "interlock-never-drops"])
def test_with_a_faulty_interlock_high_voltage_stays_and_its_state_shows_it(served: ServedBench, fault: str) -> None:
    lines, bench = lines_of(served), served.bench
    lines.write(True)
    bench.inject(fault)
    bench.clock.sleep(0.5)
    assert (is_live(served), lines.is_closed()) == (True, True)
    bench.clear(fault)
    assert lines.is_closed() is False
    bench.clock.sleep(0.06)
    assert not is_live(served)
    lines.close()


def test_a_heartbeat_that_does_not_arrive_gives_no_high_voltage(served: ServedBench) -> None:
    lines = lines_of(served)
    served.bench.inject("interlock-line-off")
    for high in (True, False, True):
        lines.write(high)
    assert (is_live(served), lines.is_closed()) == (False, False)
    lines.close()


def test_the_lines_of_a_dead_program_are_had_by_the_next_one(served: ServedBench) -> None:
    dead = lines_of(served)
    dead.write(True)
    dead._connection.close()  # its connection is gone, its session is not
    following = lines_of(served)
    following.write(False)
    following.write(True)
    assert is_live(served)
    following.close()


def test_a_card_without_its_cable_and_a_line_that_does_not_exist_are_refused_in_words(served: ServedBench) -> None:
    lines = lines_of(served)
    lines.write(True)
    served.bench.inject("card-unplugged")
    with pytest.raises(InstrumentError, match="cable"):
        lines.write(False)
    served.bench.clock.sleep(0.26)
    assert not is_live(served)
    served.bench.clear("card-unplugged")
    lines.write(False)
    lines.write(True)  # with a task of its own again
    assert is_live(served)
    lines.close()
    wrong = NiDigitalLines("Dev1", "port3/line9", server=served.card.address)
    with pytest.raises(InstrumentError, match="channel"):
        wrong.write(True)
    wrong.close()


@pytest.mark.deep
def test_the_lines_are_had_again_after_their_server_was_started_again(served: ServedBench) -> None:
    lines = lines_of(served)
    lines.write(True)
    served.bench.inject("grpc-gone")  # its tasks are gone with it
    with pytest.raises(InstrumentError, match="server"):
        lines.write(False)
    served.bench.clear("grpc-gone")

    def is_written() -> bool:
        try:
            lines.write(False)
        except InstrumentError:
            return False
        return True

    assert wait_until(is_written)
    lines.write(True)
    assert is_live(served)
    lines.close()


def test_the_local_driver_writes_and_reads_the_same_lines(served: ServedBench) -> None:
    with installed(NiLibrary(served.card.device)):
        lines = NiDigitalLines("Dev1", SHORT.line, SHORT.state_line)
        lines.write(True)
        assert (is_live(served), lines.is_closed()) == (True, True)
        other = NiDigitalLines("Dev1", SHORT.line)
        with pytest.raises(CardInUseError):
            other.write(True)
        other.close()
        lines.close()
