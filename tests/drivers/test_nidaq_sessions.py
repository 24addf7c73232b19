"""Sessions at a gRPC device server: those of a dead program are cleared, those of a running one are not."""

import threading
from collections.abc import Iterator
from types import SimpleNamespace

import grpc
import nidaqmx
import pytest
from nidaqmx.constants import AcquisitionType

from drivers.clock import WallClock
from drivers.drive_shapes import Ramp, Sine
from drivers.errors import AcquisitionError, CardInUseError
from drivers.nidaq import analog_input
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.service.served_bench import ServedBench

TERMINALS = ("ai0", "ai1")


@pytest.fixture
def server(monkeypatch: pytest.MonkeyPatch) -> Iterator[ServedBench]:
    monkeypatch.setattr("drivers.nidaq.analog_input.ABANDONED_AFTER_S", 0.3)
    truth = SimulationParameters.from_record({"source": "ao0", "amplifier": {"enabled": True}})
    with ServedBench(SimulatedBench(truth, WallClock(1.0))) as served:
        yield served


def digitizer(server: ServedBench) -> NiDigitizer:
    """As one program opens it."""
    return NiDigitizer("Dev1", TERMINALS, server.bench.clock, server=server.card.address)


def output(server: ServedBench) -> NiAnalogOutput:
    return NiAnalogOutput("Dev1", "ao0", server.bench.clock, server=server.card.address)


def test_the_acquisition_that_a_dead_program_left_is_cleared_and_the_card_is_had(server: ServedBench) -> None:
    dead = digitizer(server)
    dead.stream(2000.0, 100).read()
    dead.close()  # its connection is gone, its session is not
    with digitizer(server).stream(2000.0, 100) as stream:
        assert stream.read().raw.shape == (2, 100)


def test_the_acquisition_of_a_program_that_runs_is_left_alone(server: ServedBench) -> None:
    over = threading.Event()
    with digitizer(server).stream(2000.0, 100) as stream:

        def read() -> None:
            while not over.is_set():
                stream.read()

        reader = threading.Thread(target=read)
        reader.start()
        try:
            with pytest.raises(CardInUseError, match="another program, which reads it"):
                digitizer(server).stream(2000.0, 100)
        finally:
            over.set()
            reader.join()
        assert stream.read().raw.shape == (2, 100)


def test_a_program_that_reads_is_noticed_by_one_that_was_stopped_meanwhile(monkeypatch: pytest.MonkeyPatch) -> None:
    """Else its acquisition would be cleared by a program that the computer held up."""
    positions, times_s = iter((100, 200)), iter((0.0, 2 * analog_input.ABANDONED_AFTER_S))

    class Input:
        curr_read_pos = property(lambda _: next(positions))

    monkeypatch.setattr(analog_input, "time", SimpleNamespace(monotonic=lambda: next(times_s), sleep=lambda _: None))
    assert analog_input._is_being_read(SimpleNamespace(in_stream=Input()))


def test_a_reservation_without_a_name_is_told_with_what_it_may_be(server: ServedBench) -> None:
    channel = grpc.insecure_channel(server.card.address)
    with nidaqmx.Task(grpc_options=nidaqmx.GrpcSessionOptions(channel, "")) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(1000.0, sample_mode=AcquisitionType.CONTINUOUS)
        task.start()
        with pytest.raises(AcquisitionError, match="reserved at the gRPC device server by another client") as refused:
            digitizer(server).stream(2000.0, 100)
        assert not isinstance(refused.value, CardInUseError)
    with digitizer(server).stream(2000.0, 100) as stream:
        stream.read()
    channel.close()


def test_a_session_whose_server_was_away_when_it_ended_does_not_lock_its_own_program_out(server: ServedBench) -> None:
    card = digitizer(server)
    stream = card.stream(2000.0, 100)
    task, stream._task = stream._task, None  # the call that clears it is lost
    card._connection._open_roles.clear()
    with card.stream(2000.0, 100) as again:
        again.read()
    assert task is not None


@pytest.mark.deep
def test_a_drive_that_a_dead_program_left_on_the_cards_output_is_known_and_ramped_down(server: ServedBench) -> None:
    rest = (2.5, 0.0, 5.0)
    first = output(server)
    first.initialize_at_rest(*rest)
    first.start_drive(Ramp(2.5, 1.2, 0.2))
    digitizer(server).stream(2000.0, 100).read()
    first._connection._rpc.close()
    second = output(server)
    assert not second.is_at_rest(*rest)
    assert second.is_left_live(*rest)
    assert second.idle_level_v() == pytest.approx(1.2, abs=0.02)
    second.ramp_to(2.5, 0.3)
    assert second.is_at_rest(*rest)
    second.start_drive(Sine(100.0, 1.0, 2.5, 10))
    second.stop()
    second.close()
    assert server.bench.report().largest_jump_v <= 0.05
