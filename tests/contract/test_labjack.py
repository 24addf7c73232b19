"""LabJack T7 as a digitizer: losses, silence, confusion, calibration, settings of others, and refusals."""

import re
import time
from collections.abc import Iterator
from contextlib import closing, contextmanager, suppress

import numpy as np
import pytest

from app.config.bench_file import ConfigError, read_bench
from app.config.discovery import find_devices
from drivers.clock import Clock, WallClock
from drivers.deadlines import Deadline
from drivers.errors import AcquisitionError, BenchError, CardInUseError, ScansLostError
from drivers.labjack.digitizer import T7Digitizer
from drivers.labjack.t7_registers import ENABLE, T7Registers
from drivers.labjack.t7_stream import T7Stream
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.labjack.t7_server import SimulatedT7
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.plant.segments import ConstantSegment
from tests.helpers.waiting import PATIENCE_S

RATE_HZ, BLOCK = 5000.0, 250
SPEED = 5.0


@contextmanager
def served(clock: Clock | None = None, **card: object) -> Iterator[tuple[SimulatedBench, SimulatedT7]]:
    parameters = SimulationParameters.from_record({"card": {"product": "T7", **card}, "sensor": {"zero_v": 1.0}})
    bench = SimulatedBench(parameters, clock or WallClock(SPEED))
    with SimulatedT7(bench.card, bench.clock, bench.faults) as device:
        yield bench, device


@contextmanager
def connected(**card: object) -> Iterator[tuple[T7Digitizer, SimulatedBench, SimulatedT7]]:
    with served(**card) as (bench, device), closing(opened(bench, device)) as digitizer:
        yield digitizer, bench, device


def opened(bench: SimulatedBench, device: SimulatedT7, channels: tuple[str, ...] = ("AIN0", "AIN1"), **options: object):
    return T7Digitizer("192.0.2.9", channels, bench.clock, server=device.address, **options)


def read_on(stream: T7Stream) -> None:
    """Read until it fails: blocks that are on their way come first, however late the reader is."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        stream.read()


def read_until_lost(stream: T7Stream) -> str:
    with pytest.raises(ScansLostError) as told:
        read_on(stream)
    return str(told.value)


def test_volts_follow_the_calibration_of_the_device_and_not_the_nominal_one() -> None:
    with connected() as (digitizer, bench, _), digitizer.stream(RATE_HZ, BLOCK) as stream:
        block = stream.read()
        volts = [scale.to_volts(raw).mean() for scale, raw in zip(stream.scales, block.raw, strict=True)]
    assert volts == pytest.approx([0.0, 1.0], abs=2e-4)
    (offset, slope), (true_offset, true_slope) = stream.scales[0].coefficients, bench.parameters.card.coefficients
    assert (offset, slope) == pytest.approx((true_offset, true_slope), rel=1e-6)
    nominal_v = (32768 - 33523) * 0.00031580578
    assert abs(offset - nominal_v) > 5e-3  # the test would see the nominal centre


@pytest.mark.parametrize("rate_hz", [RATE_HZ, 50e3])
def test_an_open_input_shows_ground_where_the_rate_allows_a_ground_channel(rate_hz: float) -> None:
    with connected(drive_open=True) as (digitizer, _, _), digitizer.stream(rate_hz, 500) as stream:
        drive, _ = stream.read().raw
    seen_v = stream.scales[0].to_volts(drive).mean()
    assert seen_v == pytest.approx(0.0 if rate_hz == RATE_HZ else 0.98, abs=0.03)


def test_scans_lost_in_the_full_buffer_are_counted_and_the_numbers_go_on_with_the_time() -> None:
    with connected() as (digitizer, bench, device), digitizer.stream(RATE_HZ, BLOCK) as stream:
        stream.read()
        bench.inject("card-overrun")
        told = read_until_lost(stream)
        bench.clear("card-overrun")
        stream.restart()
        block, now_s = stream.read(), bench.clock.now()
        assert re.search(r"lost \d+ scans", told), told
        assert block.start > BLOCK
        acquired_s = stream.start_time_s + block.stop / stream.rate_hz
        assert acquired_s <= now_s + 0.01
        assert device.registers.values[4990] == 1


def test_a_late_reader_fills_the_buffer_and_is_told_how_many_scans_were_lost() -> None:
    with connected() as (digitizer, bench, _), digitizer.stream(50e3, 2000) as stream:
        stream.read()
        bench.clock.sleep(6.0)  # 1.2 MB: more than both ends of the connection and the device store
        told = read_until_lost(stream)
        stream.restart()
        start = stream.read().start
    if counted := re.search(r"lost (\d+) scans after scan (\d+)", told):
        assert start >= sum(map(int, counted.groups()))
    else:
        assert "65535" in told
        assert start > 65535


def test_a_stream_that_ends_by_itself_while_it_is_stopped_is_begun_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    with connected() as (digitizer, _, _), digitizer.stream(RATE_HZ, BLOCK) as stream:
        first = stream.read()
        read, seen = T7Registers.read_integer, list[int]()

        def ends_behind_the_answer(registers: T7Registers, address: int) -> int:
            value = read(registers, address)
            if address == ENABLE and not seen:
                seen.append(value)
                registers.write_integers(ENABLE, 0)
            return value

        monkeypatch.setattr(T7Registers, "read_integer", ends_behind_the_answer)
        stream.restart()
        assert seen == [1]
        assert stream.read().start >= first.stop


def test_a_dummy_scan_is_never_delivered_as_volts(monkeypatch: pytest.MonkeyPatch) -> None:
    with connected() as (digitizer, _, _), digitizer.stream(RATE_HZ, BLOCK) as stream:
        packet = T7Stream._read_packet
        monkeypatch.setattr(T7Stream, "_read_packet", lambda self: packet(self)[:-6] + b"\xff" * 6)
        assert re.search(r"after scan \d", read_until_lost(stream))


@pytest.mark.parametrize("place", [1, 2])
def test_an_input_at_its_upper_end_beside_another_that_is_not_is_a_reading(
    place: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only a scan whose every input has this value is a dummy."""
    with connected() as (digitizer, _, _), digitizer.stream(RATE_HZ, BLOCK) as stream:
        packet, at = T7Stream._read_packet, -2 * (3 - place)
        monkeypatch.setattr(
            T7Stream,
            "_read_packet",
            lambda self: (data := packet(self))[:at] + b"\xff\xff" + data[len(data) + at + 2 :],
        )
        raw = stream.read().raw
    assert [row.max() == 32767 for row in raw] == [place == 1, place == 2]


def test_a_packet_with_a_wrong_number_ends_the_acquisition() -> None:
    with connected() as (digitizer, _, device):
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            stream.read()
            device.wrong_transaction = True
            with pytest.raises(AcquisitionError, match=r"packet \d+ \(function 76\)"):
                read_on(stream)
        device.wrong_transaction = False
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            assert stream.read().start == 0


def test_a_reply_to_another_request_is_refused() -> None:
    with served() as (bench, device):
        device.wrong_transaction = True
        with pytest.raises(AcquisitionError, match=r"request 2 .* 1;"):
            opened(bench, device)


def test_a_dropped_stream_connection_is_told_and_a_new_acquisition_works() -> None:
    with connected() as (digitizer, _, device):
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            stream.read()
            device.stream_peer_gone = True
            with pytest.raises(AcquisitionError, match=r"at 127\.0\.0\.1"):
                read_on(stream)
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            assert stream.read().start == 0


def test_a_silent_device_is_given_up_after_the_deadline(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Deadline.CARD_SERVER, "seconds", 1.0)
    monkeypatch.setattr(Deadline.CARD_BLOCK, "seconds", 1.0)
    with served() as (bench, device):
        digitizer = T7Digitizer("192.0.2.9", ("AIN0", "AIN1"), bench.clock, server=device.address)
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            stream.read()
            device.silent = True
            with pytest.raises(AcquisitionError, match=r"at 127\.0\.0\.1"):
                read_on(stream)
        digitizer.close()


def test_a_stream_of_an_ended_program_is_stopped_and_that_of_another_program_is_not() -> None:
    with served() as (bench, device):
        left = opened(bench, device)
        stream = left.stream(RATE_HZ, BLOCK)
        left._registers.close()  # as at the death of a program, which stops nothing
        assert device.registers.values[4990] == 1
        heir = opened(bench, device)
        with heir.stream(RATE_HZ, BLOCK) as own:
            assert own.read().start == 0
            device.registers.values[46100] = 0  # another program's
            third = opened(bench, device)
            with pytest.raises(CardInUseError):
                third.stream(RATE_HZ, BLOCK)
        for each in (stream, left, heir, third):
            with suppress(AcquisitionError):
                each.close()


def test_a_device_whose_watchdog_is_on_is_refused() -> None:
    with connected() as (digitizer, _, device):
        device.registers.values[61600] = 1
        with pytest.raises(AcquisitionError, match="WATCHDOG_ENABLE_DEFAULT = 0"):
            digitizer.stream(RATE_HZ, BLOCK)


def test_settings_of_others_are_set_right() -> None:
    with connected() as (digitizer, _, device):
        device.registers.values |= {40000: 0.0, 41000: 1, 4010: 8, 4014: 2, 4020: 10, 4024: 2000, 4008: 100.0}
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            stream.read()
            values = device.registers.values
            assert [values[k] for k in (40000, 41000, 4010, 4014, 4020, 4024, 4008)] == [10, 199, 1, 0, 0, 0, 0]


@pytest.mark.parametrize(
    ("channels", "options", "told"),
    [
        (("AIN0", "AIN1"), {"range_v": 5.0}, "10 V, not 5 V"),
        (("AIN0", "AIN1"), {"terminal": "NRSE"}, "NRSE"),
        (("AIN0", "AIN1"), {"terminal": "DIFF"}, "AIN1 is"),
        (("AIN0", "AIN14"), {}, "'AIN14'"),
    ],
)
def test_impossible_settings_are_refused_in_a_sentence(
    channels: tuple[str, ...], options: dict[str, object], told: str
) -> None:
    with served() as (bench, device), pytest.raises(AcquisitionError, match=told):
        opened(bench, device, channels, **options)


def test_differential_inputs_have_the_next_terminal_as_their_negative_one() -> None:
    with served() as (bench, device):
        digitizer = opened(bench, device, ("AIN0", "AIN2"), terminal="DIFF")
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            stream.read()
        assert [device.registers.values[41000 + n] for n in (0, 2, 15)] == [1, 3, 199]
        digitizer.close()


def test_a_rate_beyond_the_device_names_its_limit_before_anything_is_set() -> None:
    with connected() as (digitizer, _, device):
        with pytest.raises(AcquisitionError, match="50000"):
            digitizer.stream(60e3, 1000)
        assert device.registers.values[4002] == 0


@pytest.mark.parametrize("address", ["", "192.0.2.9:502", "192.0.2.9:502:x"])
def test_a_wrong_address_is_a_sentence(address: str) -> None:
    with pytest.raises(BenchError, match=r"card\.device"):
        T7Digitizer(address, ("AIN0", "AIN1"), WallClock())


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('[source]\nkind = "card-output"\n', "0 V, which is -500 V"),
        ('[interlock]\nline = "port0/line0"\n', "port0/line0"),
        ('[source]\nkind = "labjack-output"\ndevice = "192.0.2.10"\n', "DAC0 .*external_power"),
        ('[source]\nkind = "labjack-output"\nexternal_power = true\n', r"source\.device"),
        (
            '[source]\nkind = "labjack-output"\nexternal_power = true\ndevice = "192.0.2.9"\n',
            r"192\.0\.2\.9 ",
        ),
        ('[source]\nkind = "labjack-output"\nexternal_power = true\nchannel = "ao0"\n', "DAC0 or DAC1, not 'ao0'"),
    ],
)
def test_a_labjack_is_refused_as_source_without_a_guarantee_of_rest_and_for_the_interlock(text: str, told: str) -> None:
    bench = '[card]\ndriver = "labjack-t7"\ndevice = "192.0.2.9"\n[generator]\nresource = "ASRL1"\n'
    with pytest.raises(ConfigError, match=told):
        read_bench(bench + text, "bench file")


def test_a_labjack_at_a_given_address_is_found() -> None:
    with served() as (_, device):
        found, _ = find_devices([device.address])
    (card,) = [each for each in found if each.driver == "labjack-t7"]
    assert (card.role, card.where, card.serial) == ("card", device.address, "470012345")


def test_the_time_of_a_scan_is_that_of_the_bench() -> None:
    with served(VirtualClock()) as (bench, device):
        digitizer = opened(bench, device)
        with digitizer.stream(RATE_HZ, BLOCK) as stream:
            bench.clock.sleep(0.03)
            with bench.history.at_instant(bench.clock) as edge_s:
                bench.history.append(edge_s, ConstantSegment(3.0))
            bench.clock.sleep(0.2)
            volts = np.concatenate([stream.scales[0].to_volts(stream.read().raw[0]) for _ in range(2)])
            first_s = stream.start_time_s + int(np.argmax(volts > 1.5)) / stream.rate_hz
        digitizer.close()
    assert volts.max() == pytest.approx(3.0, abs=0.01)
    assert 0 <= first_s - edge_s <= 1 / RATE_HZ + 1e-6
