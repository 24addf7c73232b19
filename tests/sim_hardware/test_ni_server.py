"""The card behind NI's gRPC service, read by the real nidaqmx package."""

import contextlib
import threading
import time

import grpc
import nidaqmx
import numpy as np
import pytest
from nidaqmx.constants import AcquisitionType
from nidaqmx.errors import DaqError, DaqReadError, RpcError
from nidaqmx.stream_readers import AnalogMultiChannelReader, AnalogUnscaledReader
from nidaqmx.system import System

from drivers.clock import WallClock
from drivers.errors import AcquisitionError, InstrumentError, ScansLostError
from drivers.nidaq.analog_input import NiDigitizer
from sim_hardware.bench import SimulatedBench
from sim_hardware.nidaq.grpc_server import NiGrpcServer
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SensorParameters, SimulationParameters

SPEED = 10.0

LONG_BUFFER = 1_000_000
"""Scans, 50 bench seconds: NI's default, 5 of them, overflows where a busy computer holds the reader up for half a second."""


@pytest.fixture
def bench():
    truth = SimulationParameters(speed=SPEED, card=CardParameters(noise_v=0.0), sensor=SensorParameters(noise_m=0.0))
    bench = SimulatedBench(truth)
    for message in (
        "OUTP:LOAD INF;:VOLT 5;:VOLT:OFFS 2.5;:VOLT:RANG:AUTO OFF;:FREQ 100",
        "BURS:NCYC INF;:TRIG:SOUR BUS;:BURS:STAT ON;:OUTP ON;:*TRG",
    ):
        bench.message_port.handle(message)
    bench.enable_hv()
    return bench


@pytest.fixture
def server(bench):
    with NiGrpcServer(SimulatedNiDevice(bench.card, bench.clock, bench.faults)) as server:
        bench.add_fault_listener(server.update_from_faults)
        yield server


@pytest.fixture
def options(server):
    channel = grpc.insecure_channel(server.address, options=[("grpc.max_receive_message_length", -1)])
    yield nidaqmx.GrpcSessionOptions(channel, "")
    channel.close()


@pytest.fixture
def task(options):
    with nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0:1", min_val=-10, max_val=10)
        task.timing.cfg_samp_clk_timing(20e3, sample_mode=AcquisitionType.CONTINUOUS)
        yield task


def error_of(call) -> int:
    with pytest.raises(DaqError) as caught:
        call()
    return int(caught.value.error_code)


def test_the_card_introduces_itself(options):
    system = System.remote(options)
    assert system.devices.device_names == ["Dev1"]
    card = system.devices["Dev1"]
    assert card.product_type == "USB-6341"
    assert card.serial_num == 0x01A2B3C4
    assert len(card.ai_physical_chans) == 16
    assert card.ai_max_multi_chan_rate == 500e3
    assert card.is_simulated
    assert "/Dev1/ai/StartTrigger" in card.terminals
    assert str(system.driver_version).startswith("DriverVersion")


def test_raw_counts_are_gapless_and_continue_in_phase(bench, task):
    reader = AnalogUnscaledReader(task.in_stream)
    raw = np.zeros((2, 1000), np.int16)
    task.in_stream.input_buf_size = LONG_BUFFER
    task.start()
    blocks = []
    for _ in range(20):
        assert reader.read_int16(raw, 1000, 5.0) == 1000
        blocks.append(raw.copy())
    counts = np.concatenate(blocks, axis=1)
    c = task.ai_channels[0].ai_dev_scaling_coeff
    volts = np.polynomial.polynomial.polyval(counts[0].astype(float), c)
    t = np.arange(volts.size) / 20e3
    basis = np.c_[np.ones(t.size), np.sin(2 * np.pi * 100 * t), np.cos(2 * np.pi * 100 * t)]
    fit, *_ = np.linalg.lstsq(basis, volts, rcond=None)
    assert np.hypot(*fit[1:]) == pytest.approx(2.5, rel=1e-5)
    assert np.abs(volts - basis @ fit).max() < 4e-4  # one count: no scan lost, none twice


def test_volts_by_channel_and_by_scan(task):
    task.in_stream.input_buf_size = LONG_BUFFER
    assert np.shape(task.read(50)) == (2, 50)
    out = np.zeros((2, 200))
    AnalogMultiChannelReader(task.in_stream).read_many_sample(out, 200)
    assert out[0].min() >= 0.0
    assert out[0].max() <= 5.001
    assert np.abs(out[1]).max() < 5.0
    assert np.ptp(out[1]) > 1.0


def test_an_on_demand_reading_is_one_scan_of_now(options):
    with nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        first, second = task.read(), task.read()
    assert -0.01 < first < 5.01
    assert first != second


def test_a_finite_task_ends(options):
    with nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(5e3, sample_mode=AcquisitionType.FINITE, samps_per_chan=500)
        task.start()
        task.wait_until_done(5.0)
        assert task.is_task_done()
        assert len(task.read(nidaqmx.constants.READ_ALL_AVAILABLE)) == 500
        assert error_of(lambda: task.read(1)) == -200278


def test_rate_is_what_the_divider_makes(task):
    task.timing.cfg_samp_clk_timing(44_100.0)
    assert task.timing.samp_clk_rate == pytest.approx(100e6 / 2267)
    assert task.timing.samp_clk_max_rate == 250e3


def test_too_fast_is_refused_with_nis_numbers(task):
    task.timing.cfg_samp_clk_timing(250e3)
    assert task.timing.samp_clk_rate == 250e3
    task.timing.cfg_samp_clk_timing(300e3)
    assert error_of(lambda: task.timing.samp_clk_rate) == -200081
    assert error_of(task.start) == -200081
    assert error_of(lambda: task.timing.cfg_samp_clk_timing(600e3)) == -200077


def test_buffer_is_nis_default_or_what_was_asked(task):
    assert task.in_stream.input_buf_size == 100_000
    task.timing.cfg_samp_clk_timing(5e3, sample_mode=AcquisitionType.CONTINUOUS)
    assert task.in_stream.input_buf_size == 10_000
    task.timing.cfg_samp_clk_timing(5e3, sample_mode=AcquisitionType.CONTINUOUS, samps_per_chan=40_000)
    assert task.in_stream.input_buf_size == 40_000
    task.in_stream.input_buf_size = 5000
    assert task.in_stream.input_buf_size == 5000


def test_reading_too_late_is_a_genuine_overrun(task):
    task.in_stream.input_buf_size = 4000  # 0.2 bench seconds
    task.start()
    time.sleep(0.5 / SPEED)
    assert error_of(lambda: task.read(100)) == -200279
    assert error_of(lambda: task.read(100)) == -200279
    task.stop()
    task.in_stream.input_buf_size = LONG_BUFFER
    task.start()
    assert len(task.read(100)[0]) == 100


def test_a_short_patience_gets_what_was_there(task):
    task.in_stream.input_buf_size = LONG_BUFFER
    task.start()
    with pytest.raises(DaqReadError) as caught:
        task.read(900_000, timeout=0.01)
    assert caught.value.error_code == -200284
    assert 0 < caught.value.samps_per_chan_read < 900_000


def test_the_input_belongs_to_one_task(options, task):
    task.start()
    with nidaqmx.Task(grpc_options=options) as second:
        second.ai_channels.add_ai_voltage_chan("Dev1/ai2")
        second.timing.cfg_samp_clk_timing(1e3)
        assert error_of(second.start) == -50103
        task.stop()
        second.start()


@pytest.mark.parametrize(("name", "code"), [("Dev2/ai0", -200220), ("Dev1/ai16", -200170), ("Dev1/ao0", -200170)])
def test_what_the_card_has_not_cannot_be_had(options, name, code):
    with nidaqmx.Task(grpc_options=options) as task:
        assert error_of(lambda: task.ai_channels.add_ai_voltage_chan(name)) == code


def test_range_and_empty_tasks_are_refused(options):
    with nidaqmx.Task(grpc_options=options) as task:
        assert error_of(task.start) == -200478
        assert error_of(lambda: task.ai_channels.add_ai_voltage_chan("Dev1/ai0", min_val=-20, max_val=20)) == -200077
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        assert error_of(lambda: task.ai_channels.add_ai_voltage_chan("Dev1/ai0")) == -200489


def test_a_pulled_usb_cable_ends_a_waiting_read(bench, task):
    task.in_stream.input_buf_size = LONG_BUFFER
    task.start()
    task.read(10)
    bench.inject("card-unplugged")
    assert error_of(lambda: task.read(100)) == -88705
    task.stop()
    assert error_of(task.start) == -201003
    bench.clear()
    task.start()
    task.read(10)


@contextlib.contextmanager
def connection(server):
    """A channel of its own: after a failure gRPC waits longer and longer before it tries an old one again."""
    channel = grpc.insecure_channel(server.address)
    yield nidaqmx.GrpcSessionOptions(channel, "")
    channel.close()


def test_a_server_that_dies_and_comes_back_on_the_same_port(bench, server):
    port = server.port
    with connection(server) as options:
        task = nidaqmx.Task(grpc_options=options)
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(5e3, sample_mode=AcquisitionType.CONTINUOUS)
        task.start()
        bench.inject("grpc-gone")
        for call in (lambda: task.read(1000), lambda: nidaqmx.Task(grpc_options=options), task.close):
            with pytest.raises(RpcError):
                call()
    bench.clear()
    assert server.port == port
    with connection(server) as options, nidaqmx.Task(grpc_options=options) as task:
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.start()  # the old server's reservation died with it


def test_the_real_driver_reads_blocks(bench, server):
    card = NiDigitizer("Dev1", ("ai0", "ai1"), WallClock(SPEED), server=server.address)
    assert str(card.identity) == "NI USB-6341 #1A2B3C4"
    with card.stream(5e3, 250) as stream:
        blocks = [stream.read() for _ in range(4)]
        assert [b.start for b in blocks] == [0, 250, 500, 750]
        assert stream.scales[0] == bench.card.scale
        bench.inject("card-overrun")
        with pytest.raises(ScansLostError, match="200279"):
            stream.read()
        bench.clear()
        lost = blocks[-1].stop
        stream.restart()
        first, second = stream.read(), stream.read()
        assert first.start >= lost
        assert second.start == first.stop  # the numbers continue where the time is
    bench.inject("card-unplugged")
    with pytest.raises(AcquisitionError, match=r"\bUSB\b.*201003|\bUSB\b.*88705"):
        card.stream(5e3, 250)
    card.close()
    bench.clear()
    bench.inject("grpc-gone")
    with pytest.raises(InstrumentError):
        NiDigitizer("Dev1", ("ai0",), WallClock(SPEED), server=server.address)


def test_closing_ends_a_read_that_would_wait_for_ever(bench):
    server = NiGrpcServer(SimulatedNiDevice(bench.card, bench.clock, bench.faults))
    closer = threading.Timer(0.2, server.close)
    with connection(server) as options:
        task = nidaqmx.Task(grpc_options=options)
        task.ai_channels.add_ai_voltage_chan("Dev1/ai0")
        task.timing.cfg_samp_clk_timing(1.0, sample_mode=AcquisitionType.CONTINUOUS)
        closer.start()
        # It would take a quarter of an hour. On a busy computer the server may be gone before the read has reached it.
        with pytest.raises((RpcError, DaqError)):
            task.read(1000, timeout=1000.0)
        closer.join()
        with pytest.raises((RpcError, DaqError)):
            task.close()
