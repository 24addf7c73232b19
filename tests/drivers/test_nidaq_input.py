"""Analogue input of the card: an open input shows what was converted before it, and must not look like rest."""

import math
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from nidaqmx.constants import ChannelType
from nidaqmx.errors import DaqError, RpcError
from nidaqmx.task import InStream

from drivers.bench.rest import drive_voltage, verify_rest
from drivers.clock import Clock
from drivers.errors import AcquisitionError, ScansLostError
from drivers.nidaq.analog_input import BUFFER_S, NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from drivers.nidaq.errors import translate_errors
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.input_task import NiInputTask
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SensorParameters, SimulationParameters
from tests.helpers.simulated_bench import installed
from tests.wires.ni_library import NiLibrary


@contextmanager
def at_rest(clock: Clock | None = None, **card) -> Iterator[SimulatedBench]:
    """A bench at rest whose laser's output is where rest is at the drive's channel."""
    parameters = SimulationParameters(source="ao0", sensor=SensorParameters(zero_v=2.5), card=CardParameters(**card))
    bench = SimulatedBench(parameters, clock or VirtualClock())
    with installed(NiLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))):
        source = NiAnalogOutput("Dev1", "ao0", bench.clock)
        source.initialize_at_rest(2.5, 0.0, 5.0)
        yield bench
        source.close()


@pytest.mark.parametrize("rate_hz", [5000.0, 100e3])
def test_an_open_drive_channel_does_not_look_like_rest(rate_hz: float) -> None:
    with at_rest(drive_open=True) as bench:
        with NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(rate_hz, 500) as stream:

            def read() -> tuple[int, np.ndarray]:
                block = stream.read()
                return block.start, drive_voltage(block, stream.scales)

            rest = verify_rest(read, bench.clock, stream.start_time_s, stream.rate_hz, 2.5, 0.5)
        assert not rest.confirmed
        assert rest.measured_v == pytest.approx(0.0, abs=0.01)


def test_a_rate_without_time_for_the_ground_is_acquired_without_it() -> None:
    with at_rest() as bench:
        with NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(250e3, 1000) as stream:
            block = stream.read()
        assert block.raw.shape == (2, 1000)
        assert drive_voltage(block, stream.scales).mean() == pytest.approx(2.5, abs=1e-3)


@pytest.mark.parametrize("convert_s", [12e-6, 0.0])
def test_channels_and_their_skew_count_from_the_scan(convert_s: float) -> None:
    """A card with a converter for each channel has no ghosts, needs no ground and has no skew."""
    with (
        at_rest(convert_s=convert_s) as bench,
        NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 100) as stream,
    ):
        assert stream.read().raw.shape == (2, 100)
        skews = [scale.skew_s for scale in stream.scales]
    assert math.isclose(skews[1] - skews[0], convert_s)
    assert skews[0] == 0.0


class FastClock(VirtualClock):
    """Bench time at 20 times real speed."""

    speed = 20.0


@pytest.mark.parametrize("clock", [VirtualClock(), FastClock()])
def test_a_program_may_be_busy_for_as_long_at_raised_speed(clock: VirtualClock) -> None:
    speed = getattr(clock, "speed", 1.0)
    with (
        at_rest(clock=clock) as bench,
        NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(1000.0, 100) as stream,
    ):
        bench.clock.sleep(BUFFER_S * speed - 1.0)
        assert stream.read().start == 0
        bench.clock.sleep(2.0)
        with pytest.raises(ScansLostError):
            stream.read()


@pytest.mark.parametrize("counting_s", [(0.0,), (0.7, 0.6, 0.0)])
def test_a_late_reply_to_the_start_does_not_date_the_scans_late(
    counting_s: tuple[float, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Samples dated later than they were taken would pass for fresh when rest is measured after a command."""
    with at_rest() as bench:
        replies, starting, counting = [1.2, *counting_s], NiInputTask.start, NiInputTask.acquired

        def start(task: NiInputTask) -> None:
            starting(task)
            bench.clock.sleep(replies.pop(0))

        def acquired(task: NiInputTask) -> int:
            scans = counting(task)
            bench.clock.sleep(replies.pop(0) if replies else 0.0)
            return scans

        with monkeypatch.context() as busy:
            busy.setattr(NiInputTask, "start", start)
            busy.setattr(NiInputTask, "acquired", acquired)
            begin_s = bench.clock.now()
            stream = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(1000.0, 100)
        with stream:
            assert begin_s <= stream.start_time_s < begin_s + 0.01


@pytest.mark.parametrize(
    "error", [RpcError(4, "Deadline Exceeded"), DaqError("not counted", -200983)], ids=["server", "driver"]
)
def test_a_block_whose_position_is_not_answered_is_counted_here(
    error: Exception, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(_stream: object) -> int:
        raise error

    with at_rest() as bench, NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 100) as stream:
        first = stream.read()
        monkeypatch.setattr(InStream, "curr_read_pos", property(fail))
        assert stream.read().start == first.stop


def test_a_value_of_the_driver_that_is_in_no_list_is_an_error_of_the_card() -> None:
    with pytest.raises(AcquisitionError, match="9761"), translate_errors("NI Dev1"):
        ChannelType(9761)


def test_the_newest_volts_are_those_of_the_thread_that_reads_the_card() -> None:
    """Two threads that read one task would get each other's blocks."""
    with (
        at_rest() as bench,
        NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock).stream(5000.0, 100) as stream,
    ):
        starts: list[int] = []
        assert stream.newest_drive_volts(1.0) is not None
        over = threading.Event()

        def read_on() -> None:
            while not over.is_set():
                starts.append(stream.read().start)

        reader = threading.Thread(target=read_on)
        reader.start()
        volts = [stream.newest_drive_volts(60.0) for _ in range(5)]
        over.set()
        reader.join()
        assert all(each is not None and each.mean() == pytest.approx(2.5, abs=1e-3) for each in volts)
        assert starts == list(range(0, 100 * len(starts), 100))
