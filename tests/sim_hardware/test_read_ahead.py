"""Read-ahead of the simulated card: the same counts as block by block, whatever changes, and the past that stays closed."""

from collections.abc import Callable

import numpy as np
import pytest

from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq import in_process_digitizer
from sim_hardware.plant import PeriodicSegment, SimulationParameters, plant
from sim_hardware.plant.parameters import Nonidealities

RATE_HZ, BLOCK_SCANS = 5000.0, 250
PARAMETERS = {
    "ideal": SimulationParameters(seed=5),
    "realistic": SimulationParameters(seed=5, beyond=Nonidealities(creep_per_decade=0.01, hysteresis_width=0.05)),
}


def sine(bench: SimulatedBench, frequency_hz: float) -> None:
    with bench.history.at_instant(bench.clock) as t:
        bench.history.append(t, PeriodicSegment(t, frequency_hz, 1.5, 2.5, 0.0, 2.5, 70.0))


CHANGES: tuple[tuple[int, Callable[[SimulatedBench], object]], ...] = (
    (3, lambda bench: sine(bench, 150.0)),
    (14, lambda bench: sine(bench, 90.0)),
    (15, lambda bench: bench.perform_action("bump-sensor", {"by_m": 1e-4})),
    (33, lambda bench: bench.inject("sensor-out-of-range")),
    (35, lambda bench: bench.clear("sensor-out-of-range")),
    (38, lambda bench: bench.inject("amplifier-limited")),
    (44, lambda bench: bench.disable_hv()),
    (50, lambda bench: bench.perform_action("fix-mass", {"mass_kg": 0.003})),
    (61, lambda bench: bench.enable_hv()),
    (62, lambda bench: sine(bench, 120.0)),
)
"""After so many blocks something changes."""


def record(parameters: SimulationParameters) -> tuple[np.ndarray, SimulatedBench]:
    """Counts of two acquisitions with a pause between them, during both of which the bench changes."""
    bench = SimulatedBench(parameters, VirtualClock())
    bench.enable_hv()
    changes, blocks = dict(CHANGES), []
    for stretch in (range(29), range(29, 90)):
        stream = bench.digitizer().stream(RATE_HZ, BLOCK_SCANS)
        for number in stretch:
            blocks.append(stream.read().raw)
            if number in changes:
                changes[number](bench)
        stream.close()
        bench.clock.sleep(0.3)
    return np.concatenate(blocks, axis=1).astype(int), bench


@pytest.mark.parametrize("name", PARAMETERS)
def test_reading_ahead_gives_the_counts_of_block_by_block(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    ahead, _ = record(PARAMETERS[name])
    monkeypatch.setattr(in_process_digitizer, "AHEAD_S", 0.0)
    slow, _ = record(PARAMETERS[name])
    assert np.array_equal(ahead[0], slow[0])
    assert np.abs(ahead[1] - slow[1]).max() <= 1
    assert np.mean(ahead[1] != slow[1]) < 1e-3
    assert np.ptp(ahead[0]) > 5000
    assert np.ptp(ahead[1]) > 5000


def test_what_was_delivered_cannot_be_changed_and_what_was_computed_ahead_can() -> None:
    bench = SimulatedBench(PARAMETERS["ideal"], VirtualClock())
    stream = bench.digitizer().stream(RATE_HZ, BLOCK_SCANS)
    for _ in range(12):
        stream.read()
    now = bench.clock.now()
    ahead_s = bench.plant.available_until(now)
    with pytest.raises(ValueError, match="the past cannot be changed"):
        bench.history.switch_high_voltage(ahead_s - 0.02, hv=True)
    bench.history.switch_high_voltage(now, hv=True)
    sine(bench, 100.0)
    assert np.ptp(stream.read().raw[1].astype(int)) > 5000


def test_a_held_level_creeps_as_if_it_were_simulated_step_by_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def creeping() -> np.ndarray:
        bench = SimulatedBench(PARAMETERS["realistic"], VirtualClock())
        bench.perform_action("place-weight", {"mass_kg": 0.2})
        bench.clock.sleep(5.0)
        bench.perform_action("remove-weight", {})
        bench.clock.sleep(5.0)
        bench.enable_hv()
        with bench.history.at_instant(bench.clock) as t:
            bench.history.append(t, PeriodicSegment(t, 50.0, 2.5, 2.5, 0.0, 4.0, 20.25))
        bench.clock.sleep(4.0)
        return np.concatenate([bench.plant.displacement(np.arange(k, k + 1, 2e-4)) for k in range(13)])

    held = creeping()
    monkeypatch.setattr(plant, "CREEP_TOLERANCE_M", -1.0)
    simulated = creeping()
    assert np.abs(held - simulated).max() < 2e-9
    assert not np.array_equal(held, simulated)
    assert np.ptp(simulated) > 5e-4
