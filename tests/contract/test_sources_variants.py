"""Source contract of every generator driver on every variant of its simulated instrument: model, channels, drawn traits."""

from collections.abc import Iterator
from importlib import import_module

import pytest

from app.config.driver_registry import SOURCES, built_in_names, load_driver
from drivers import generator_families
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.registry import traits_of
from sim_hardware.testing.source_contract import (  # noqa: F401 - pytest collects them here, with this module's sources
    SourceUnderTest,
    test_close_leaves_the_output_at_rest,
    test_drive_from_another_level_is_rejected_and_output_stays_at_rest,
    test_failed_link_raises_link_error_and_reconnects,
    test_initialize_at_rest_from_power_up_state,
    test_levels_are_reached_and_left_in_small_steps,
    test_ramp_is_played,
    test_rest_check_is_harmless_with_high_voltage_on,
    test_sine_starts_and_ends_at_rest_by_itself,
    test_small_and_large_drives_in_sequence_cause_no_jump,
    test_stop_ramps_a_sine_down_from_any_phase,
    test_unsupported_drive_is_rejected_and_output_stays_at_rest,
)
from tests.helpers.simulated_bench import simulated

MODELS = (
    "33511B",
    "33522B",
    "33622A",
    "EDU33211A",
    "EDU33212A",
    "FG33532A",
    "G5100A",
    "33210A",
    "33220A",
    "33250A",
    "DG1032Z",
    "DG811",
    "DG832",
    "DG952",
    "DG2072",
    "DG4162",
    "SDG1032X",
    "SDG2122X",
    "SDG6022X",
    "AFG3021C",
    "AFG3102",
    "AFG31022",
    "AFG31101",
    "AFG1022",
)


def variants(model: str) -> list[str]:
    """Return choices of traits: each with the kindest of all others, and the rudest of all together."""
    each = [f"{t.name}={option}" for t in traits_of(model) for option in t.options]
    rudest = " ".join(f"{t.name}={t.options[-1]}" for t in traits_of(model))
    return [*each, *([rudest] if len(traits_of(model)) > 1 else [])]


CASES = [(model, traits) for model in MODELS for traits in variants(model)]


@pytest.fixture(params=CASES, ids=lambda case: f"{case[0]} {case[1]}")
def device_under_test(request: pytest.FixtureRequest) -> Iterator[SourceUnderTest]:
    model, traits = request.param
    kindest = " ".join(f"{t.name}={t.options[0]}" for t in traits_of(model) if f"{t.name}=" not in traits)
    config = simulated(generator={"model": model, "traits": f"{kindest} {traits}"})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    name = next(n for n in built_in_names(SOURCES) if load_driver(SOURCES, n).supports_model(model))  # type: ignore[attr-defined]
    source = load_driver(SOURCES, name)(bench.link(), bench.clock)
    yield source, bench, bench.clock
    source.close()


def test_every_option_of_every_trait_is_among_the_variants() -> None:
    chosen = {pair for _, traits in CASES for pair in traits.split()}
    modules = {import_module(f"sim_hardware.generators.{family.module}") for family in generator_families().values()}
    assert {f"{t.name}={option}" for module in modules for t in module.TRAITS for option in t.options} <= chosen
