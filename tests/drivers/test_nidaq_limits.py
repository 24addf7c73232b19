"""Small NI cards: their limits are asked before anything is set, and outputs without a sample clock are refused."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from drivers.clock import WallClock
from drivers.drive_shapes import Sine
from drivers.errors import AcquisitionError, BenchError
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import SimulationParameters
from sim_hardware.service.served_bench import ServedBench


@contextmanager
def served(product: str, **card: Any) -> Iterator[tuple[ServedBench, str]]:
    parameters = SimulationParameters.from_record({"source": "ao0", "card": {"product": product, **card}})
    with ServedBench(SimulatedBench(parameters, WallClock(5.0))) as bench:
        yield bench, bench.card.address


@pytest.mark.parametrize(
    ("product", "rate_hz", "told"),
    [
        ("USB-6001", 20e3, "20000 samples/s .* to 10000 Hz"),
        ("USB-6008", 10e3, "10000 samples/s .* to 5000 Hz"),
        ("USB-6211", 200e3, "250000 samples/s .* to 125000 Hz"),
        ("NI 9215", 150e3, "100000 samples/s .* to 100000 Hz"),
    ],
)
def test_a_rate_beyond_a_small_card_names_its_limit_before_a_channel_is_made(
    product: str, rate_hz: float, told: str
) -> None:
    with served(product) as (bench, address):
        card = NiDigitizer("Dev1", ("ai0", "ai1"), bench.bench.clock, server=address)
        with pytest.raises(AcquisitionError, match=told):
            card.stream(rate_hz, 1000)
        assert "CreateAIVoltageChan" not in bench.card.calls
        slower_hz = float(told.rsplit(maxsplit=2)[-2])
        with card.stream(slower_hz, 100) as stream:
            assert stream.read().raw.shape == (2, 100)
        card.close()


def test_a_range_beyond_a_card_names_its_own() -> None:
    with served("USB-6211", range_v=5.0) as (bench, address):
        card = NiDigitizer("Dev1", ("ai0", "ai1"), bench.bench.clock, server=address)
        with pytest.raises(AcquisitionError, match=r"5 V .* 10 V; give card.range_v = 5"):
            card.stream(1000.0, 100)
        card.close()


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("product", "told"),
    [
        ("USB-6008", "set by software"),
        ("USB-6001", "5000 samples/s, .* 10000 samples/s"),
        ("NI 9215", "no analogue output"),
    ],
)
def test_an_output_that_cannot_play_a_drive_is_refused_and_keeps_its_level(product: str, told: str) -> None:
    with served(product) as (bench, address):
        with pytest.raises(BenchError, match=f"{told}.*generator"):
            NiAnalogOutput("Dev1", "ao0", bench.bench.clock, server=address)
        assert not {name for name in bench.card.calls if name.startswith(("CreateAO", "Write"))}


def test_a_drive_that_is_too_fast_for_the_output_is_refused_before_it_is_sent() -> None:
    with served("USB-6211") as (bench, address):
        source = NiAnalogOutput("Dev1", "ao0", bench.bench.clock, server=address)
        assert not source.reason_unsupported(Sine(200.0, 2.0, 2.5, 100))
        assert "500000" in source.reason_unsupported(Sine(4000.0, 0.1, 2.5, 100))
        source.close()
