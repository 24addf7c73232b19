"""Registry of simulated function generators: the instrument, traits and deviations of a model, by the name of its family."""

import re
from collections.abc import Callable
from importlib import import_module
from types import ModuleType

from drivers import GeneratorFamily, generator_families
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.traits import Trait, draw_options
from sim_hardware.plant import GeneratorParameters
from sim_hardware.wires import ScpiInstrument


def make_generator(
    parameters: GeneratorParameters, generator: SimulatedGenerator, now: Callable[[], float], seed: int = 0
) -> ScpiInstrument:
    """Return the simulated generator of the parameters; unspecified traits are drawn from the seed."""
    family, maker = _family_of(parameters.model)
    identity = f"{maker},{parameters.model},{parameters.serial},{parameters.firmware}"
    traits = draw_traits(parameters.model, seed, parameters.traits)
    generator.deviate(traits)
    unit = InstrumentUnit(identity, traits, seed, parameters.high_z_by_hand)
    instrument: ScpiInstrument = _module_of(family).SIMULATED[family.driver](generator, now, unit)
    return instrument


def traits_of(model: str) -> tuple[Trait, ...]:
    """Return the traits of a model."""
    return _of_model(_module_of(_family_of(model)[0]).TRAITS, model)


def deviations_of(model: str) -> tuple[Trait, ...]:
    """Return the possible deviations of a model."""
    return _of_model(_module_of(_family_of(model)[0]).DEVIATIONS, model)


def draw_traits(model: str, seed: int, chosen: str = "") -> dict[str, str]:
    """Return the option of each trait of a model: chosen (`silence=long stale=often`), otherwise drawn from the seed.

    Raises:
        ValueError: an unknown trait or option is chosen.
    """
    return draw_options("generator.traits", model, f"{model} {seed}", traits_of(model), deviations_of(model), chosen)


def _family_of(model: str) -> tuple[GeneratorFamily, str]:
    """Return the family of a model, and its maker."""
    for family in generator_families().values():
        for beginning, maker in family.makers.items():
            if model.upper().startswith(beginning):
                return family, maker
    raise ValueError(f"no function generator {model!r} can be simulated")


def _module_of(family: GeneratorFamily) -> ModuleType:
    return import_module(f"sim_hardware.generators.{family.module}")


def _of_model(traits: tuple[Trait, ...], model: str) -> tuple[Trait, ...]:
    return tuple(trait for trait in traits if re.match(trait.models, model.upper()))
