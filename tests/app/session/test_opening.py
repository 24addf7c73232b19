"""Opening of a bench: another instrument than expected, a source that an earlier program left live, what its watchdog is told."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import SimpleNamespace
from typing import Any

import pytest

from app.config import BenchConfig
from app.live.session_link import PromptMailbox
from app.session import bench_connection as module
from app.session.bench_connection import BenchConnection, connect, rest_without_card
from app.session.session import BenchOpened, InstrumentAwaited, Session, SessionEvent
from drivers import BenchError, Digitizer, HeartbeatClock, Identity, InstrumentError, NoWatchdog, UnsafeError
from drivers.watchdog.config import WatchdogConfig
from tests.helpers.simulated_bench import assert_safe_voltage, laboratory, simulated

CARD_ERROR = InstrumentError("the card is reserved")


@contextmanager
def left(volts: float) -> Iterator[BenchConnection]:
    """A bench whose source idles at `volts`, with high voltage on."""
    with laboratory() as lab:
        lab.bench.amplifier.initialize_at_rest()
        lab.control.enable_hv()
        lab.bench.amplifier._source.ramp_to(volts, 0.3)
        yield lab


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("resource", "allowed"),
    [
        ("TCPIP::192.0.2.7::5025::SOCKET", True),
        ("TCPIP::192.0.2.7::INSTR", True),
        ("USB0::1::2::3::INSTR", False),
        ("usb0::1::2::3::INSTR", False),
        ("ASRL/dev/ttyUSB0::INSTR", False),
        ("GPIB0::7::INSTR", False),
    ],
)
def test_only_a_network_carries_two_connections(resource: str, allowed: bool) -> None:
    assert module.allows_second_connection(resource) is allowed


def test_without_a_card_a_level_that_was_left_is_ramped_to_rest_and_rest_is_left_alone() -> None:
    for volts in (2.5, 1.2, 4.0):
        with left(volts) as lab:
            source, sent_s = lab.bench.amplifier._source, lab.bench.clock.now()
            if volts == 2.5:
                rest_without_card(simulated(), source, lab.bench.clock, CARD_ERROR)
                assert lab.bench.clock.now() - sent_s < 0.1
            else:
                with pytest.raises(UnsafeError, match=str(CARD_ERROR)):
                    rest_without_card(simulated(), source, lab.bench.clock, CARD_ERROR)
            assert lab.control.report().ends_at_rest
            assert_safe_voltage(lab.control.report())


def test_a_source_that_does_not_obey_and_no_card_are_both_in_the_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    with left(4.0) as lab:
        source = lab.bench.amplifier._source

        def refuse(*_: float) -> None:
            raise InstrumentError("it is locked")

        monkeypatch.setattr(source, "ramp_to", refuse)
        with pytest.raises(UnsafeError, match=rf"{CARD_ERROR}.*it is locked"):
            rest_without_card(simulated(), source, lab.bench.clock, CARD_ERROR)
        monkeypatch.undo()
        lab.bench.amplifier.force_rest()


@pytest.mark.parametrize("left_by", ["", "with the bench 'bench of Anna' since 9 o'clock"])
def test_a_silent_instrument_is_unsafe_if_an_earlier_program_may_have_left_it_live(left_by: str) -> None:
    with (
        pytest.raises(BenchError, match="silent") as failed,
        module._unsafe_if_left(SimpleNamespace(left_by=left_by)),  # type: ignore[arg-type]
    ):
        raise InstrumentError("silent")
    assert isinstance(failed.value, UnsafeError) == bool(left_by)
    assert left_by in str(failed.value)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("table", "expected", "seen", "is_other"),
    [
        ("generator", "MY1", "MY1", False),
        ("generator", "my1", "MY1", False),
        ("generator", "", "MY2", False),
        ("generator", "MY1", "MY2", True),
        ("generator", "MY1", "", True),  # one that reports none may be any
        ("card", "1A2B", "1A2B", False),
        ("card", "1A2B", "1A2C", True),
    ],
)
def test_another_instrument_than_the_one_of_the_bench_file_is_refused(
    table: str, expected: str, seen: str, is_other: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = BenchConfig.model_validate({**simulated().model_dump(), table: {"serial": expected}})
    name = "open_source" if table == "generator" else None

    def renamed(instrument: Any) -> Any:
        instrument.identity = Identity(instrument.identity.maker, instrument.identity.model, seen)
        return instrument

    if name is not None:
        open_source: Callable[..., Any] = module.open_source
        monkeypatch.setattr(module, name, lambda *given: renamed(open_source(*given)))
    else:
        from sim_hardware import SimulatedBench

        digitizer: Callable[..., Digitizer] = SimulatedBench.digitizer
        monkeypatch.setattr(SimulatedBench, "digitizer", lambda *a, **k: renamed(digitizer(*a, **k)))
    if not is_other:
        with connect(config) as lab:
            assert seen in lab.bench.configuration["identities"][table]
        return
    with pytest.raises(InstrumentError, match=rf"{expected}[^0-9A-Z].*{table}"), connect(config):
        pass


SOCKET, SERIAL = "TCPIP::192.0.2.7::5025::SOCKET", "ASRL/dev/ttyUSB0::INSTR"


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("speed", "resource", "single", "own", "silence_s", "connects"),
    [
        (1.0, SOCKET, False, True, 0.4, True),
        (5.0, SOCKET, False, True, 2.0, True),  # a silence counts in bench time
        (0.5, SOCKET, False, True, 0.4, True),
        (1.0, SERIAL, False, True, 0.4, False),
        (1.0, SOCKET, True, True, 0.4, False),
        (1.0, SOCKET, False, False, 0.4, False),
    ],
)
def test_the_watchdog_has_the_programs_locks_and_a_connection_of_its_own_where_the_instrument_takes_two(
    speed: float,
    resource: str,
    single: bool,
    own: bool,
    silence_s: float,
    connects: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    told: list[WatchdogConfig] = []
    monkeypatch.setattr("drivers.WatchdogClient", lambda charge: told.append(charge) or NoWatchdog())
    config = BenchConfig.model_validate({**simulated().model_dump(), "watchdog": {"own_connection": own}})
    source: Any = SimpleNamespace(identity=Identity("Keysight", "33511B", "MY1"), single_session=single)
    module._make_watchdog(config, resource, "", HeartbeatClock(speed), ("/locks/a", "/locks/b"), source)
    assert [(each.silence_s, each.own_connection, each.resource, each.locks) for each in told] == [
        (pytest.approx(silence_s), connects, resource, ("/locks/a", "/locks/b"))
    ]
    assert (told[0].map, told[0].limits) == (config.amplifier.amplifier_map, config.amplifier.drive_limits)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("kind", "external_power", "simulated_bench", "measured_s", "measures", "refused"),
    [
        ("labjack-output", False, False, 0.0, False, True),
        ("labjack-output", False, False, 0.4, False, False),
        ("labjack-output", False, False, 0.0, True, False),
        ("labjack-output", False, True, 0.0, False, False),
        ("labjack-output", True, False, 0.0, False, False),
        ("generator", False, False, 0.0, False, False),
    ],
)
def test_a_source_that_relies_on_its_interlock_gets_no_high_voltage_before_that_is_measured(
    kind: str,
    external_power: bool,
    simulated_bench: bool,
    measured_s: float,
    measures: bool,
    refused: bool,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Also where a reason was given to do without a commissioning."""
    state = SimpleNamespace(
        level_stop_s=0.0, stop_s=0.1, interlock_s=measured_s, holds_by_offset=False, byte_order="", refusal="", note="", stored={}
    )  # fmt: skip
    monkeypatch.setattr(module, "commissioning_state", lambda *_: state)
    source = SimpleNamespace(kind=kind, external_power=external_power)
    config: Any = SimpleNamespace(simulated=simulated_bench, source=source, interlock=SimpleNamespace(line=""))
    amplifier = SimpleNamespace(identity="T7", plays_to_the_end=False, byte_order=lambda _: "")
    bench: Any = SimpleNamespace(amplifier=amplifier, interlock=SimpleNamespace(), simulated=False, configuration={})
    module._gate(config, bench, "the laboratory knows why", measures)
    assert ("interlock" in bench.high_voltage_refusal) == refused


def test_the_instrument_that_is_waited_for_is_told_before_the_bench_is_open() -> None:
    told: list[SessionEvent] = []
    session = Session(lambda: connect(simulated()), (told.append,), PromptMailbox())
    session.start()
    assert session.close()
    assert [type(each) for each in told] == [InstrumentAwaited, BenchOpened]
