"""Simulated benches whose card has the amplifier's current monitor, for runs of a protocol that needs it."""

from typing import Any

from app.config.bench_file import BenchConfig
from protocols.registry import PROTOCOLS
from tests.helpers.simulated_bench import simulated

MONITORS = (
    {"name": "amplifier_voltage", "channel": "ai2", "unit": "V", "gain": 1000.0, "kind": "voltage-monitor"},
    {
        "name": "amplifier_current",
        "channel": "ai3",
        "unit": "A",
        "gain": 0.01,
        "kind": "current-monitor",
        "gain_relative_uncertainty": 0.005,
        "delay_s": 1.3e-5,
        "delay_uncertainty_s": 2e-6,
    },
)


def with_inputs(config: BenchConfig, *tables: Any) -> BenchConfig:
    """Return a bench file with further inputs, by default voltage and current monitor."""
    return BenchConfig.model_validate({**config.model_dump(), "channels": list(tables or MONITORS)})


def bench_for(name: str, config: BenchConfig) -> BenchConfig:
    """Return a bench file with the further inputs that a protocol needs."""
    return with_inputs(config) if PROTOCOLS[name].input_kinds else config


def electrical_bench(**truth: Any) -> BenchConfig:
    """Return the simulated bench with both monitors; 13 µs are the delay of the current monitor and of its bandwidth."""
    return with_inputs(simulated(**truth))
