"""Bench file: loading and validation of a bench's instruments, wiring and calibrations.

Unknown keys are rejected; all errors are listed at once with their lines and remedies.
"""

import secrets
from importlib import resources
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from app.common import truncate_text
from app.config.bench_tables import (
    AmplifierTable,
    BackupTable,
    CardTable,
    ChannelTable,
    EnvironmentTable,
    GeneratorTable,
    InterlockTable,
    LevelsTable,
    MeterTable,
    SensorTable,
    SourceTable,
    SpecimenTable,
    SupplyTable,
    WatchdogTable,
    check_channels,
)
from app.config.driver_registry import SIMULATED_CARDS
from app.config.validation import ConfigTable, read_toml
from protocols.base import read_toml_text
from sim_hardware.plant import SimulationParameters

SIMULATED_BENCHES = {"sim": "realistic.toml", "ideal": "ideal.toml", "realistic": "realistic.toml"}
"""Files in `sim_hardware` of the simulated benches that come with the program, by name; `realistic` is an earlier name of `sim`."""

MAX_SPEED = 20.0
"""Largest speed of the simulated bench on its real connections, in multiples of real time."""


class ConfigError(Exception):
    """A bench file is invalid; the message lists every error with line and remedy."""


class BenchConfig(ConfigTable):
    """One bench file."""

    name: Annotated[str, "name of this bench"] = "bench"
    source: SourceTable = Field(default_factory=SourceTable)
    generator: GeneratorTable = Field(default_factory=GeneratorTable)
    supply: SupplyTable = Field(default_factory=SupplyTable)
    amplifier: AmplifierTable = Field(default_factory=AmplifierTable)
    card: CardTable = Field(default_factory=CardTable)
    sensor: SensorTable = Field(default_factory=SensorTable)
    channels: Annotated[list[ChannelTable], "further inputs of the card: [[channels]]"] = Field(default_factory=list)
    meters: Annotated[dict[str, MeterTable], "serial sensors by a name of your own: [meters.laser]"] = Field(
        default_factory=dict
    )
    environment: EnvironmentTable = Field(default_factory=EnvironmentTable)
    watchdog: WatchdogTable = Field(default_factory=WatchdogTable)
    interlock: InterlockTable = Field(default_factory=InterlockTable)
    backup: BackupTable = Field(default_factory=BackupTable)
    specimen: SpecimenTable = Field(default_factory=SpecimenTable)
    levels: LevelsTable = Field(default_factory=LevelsTable)
    simulation: Annotated[dict[str, Any] | None, "the truth of a simulated bench; a real bench has no such table"] = (
        None
    )

    @property
    def simulated(self) -> bool:
        return self.simulation is not None

    def same_bench(self, other: "BenchConfig") -> bool:
        """Whether two benches have the same values; noise that is drawn at each loading does not count."""

        def fixed(config: BenchConfig) -> BenchConfig:
            drawn = {"noise_seed"} if (config.simulation or {}).get("fresh_noise") else set()
            kept = {key: value for key, value in (config.simulation or {}).items() if key not in drawn}
            return config.model_copy(update={"simulation": kept if config.simulated else None})

        return fixed(self) == fixed(other)

    @property
    def simulation_parameters(self) -> SimulationParameters:
        """The true parameters of the simulated bench."""
        at_the_cable = {"generator": "generator", "dc-supply": "supply"}
        wired = {
            "source": at_the_cable.get(self.source.kind, self.source.output),
            "interlock": self.interlock.model_dump(),
        }
        record = {**wired, **(self.simulation or {})}
        if (product := SIMULATED_CARDS.get(self.card.driver)) and isinstance(record.get("card", {}), dict):
            record["card"] = {"product": product, **record.get("card", {})}
        return SimulationParameters.from_record(record)

    @property
    def source_connection(self) -> GeneratorTable | SupplyTable:
        """The table with the connection of the source."""
        return self.supply if self.source.kind == "dc-supply" else self.generator

    @property
    def source_address(self) -> str:
        """VISA resource string of the source, or address of a LabJack."""
        return self.source.device if self.source.kind == "labjack-output" else self.source_connection.resource

    @model_validator(mode="after")
    def _check_source_kind(self) -> "BenchConfig":
        check_channels(self.channels, (self.card.drive_channel, self.card.displacement_channel))
        if self.card.driver in SIMULATED_CARDS:
            self._check_card_without_ni()
        if self.source.kind == "labjack-output":
            self._check_labjack_output()
        if self.simulated:
            simulation = self.simulation_parameters  # raises ValueError if the table is malformed
            if simulation.generator.traits:
                from sim_hardware.generators import draw_traits

                draw_traits(simulation.generator.model, simulation.seed, simulation.generator.traits)
            if simulation.card.traits:
                from sim_hardware.nidaq import draw_card_traits

                draw_card_traits(simulation.seed, simulation.card.traits)
            if simulation.supply.traits:
                from sim_hardware.supplies import draw_supply_traits

                draw_supply_traits(simulation.supply.model, simulation.supply.traits)
            speed = simulation.speed
            if not 1 <= speed <= MAX_SPEED:
                raise ValueError(f"simulation.speed must be from 1 to {MAX_SPEED:g}, not {speed:g}")
            return self
        if self.source.kind != "card-output" and not self.source_address:
            table = "supply" if self.source.kind == "dc-supply" else "generator"
            raise ValueError(
                f"{table}.resource is missing; give the VISA resource of the {table}, "
                "or a [simulation] table for a simulated bench"
            )
        if silent := [name for name, meter in self.meters.items() if not meter.port]:
            raise ValueError(f"meters.{silent[0]}.port is missing; give the name of its serial port, e.g. COM3")
        if silent := [name for name, meter in self.meters.items() if meter.on_two_ports and not meter.command_port]:
            raise ValueError(f"meters.{silent[0]}.command_port is missing; give it, e.g. socket://192.0.2.5:23")
        return self

    def _check_card_without_ni(self) -> None:
        if self.source.kind == "card-output":
            raise ValueError(
                "source.kind card-output needs an NI card: the outputs of a LabJack give 0 V, which is -500 V on the specimen, when its "
                "power or its USB cable is off; connect a function generator, or a second LabJack as source.kind labjack-output"
            )
        if self.interlock.line:
            raise ValueError(
                f"interlock.line {self.interlock.line} is a digital line of an NI card; leave it empty with a LabJack, or use an NI card"
            )

    def _check_labjack_output(self) -> None:
        """Refuse a LabJack as the source unless rest is guaranteed without the computer's power, or high voltage is taken away."""
        if not (self.source.external_power or self.interlock.line):
            raise ValueError(
                f"source.kind labjack-output: without power {self.source.output} gives 0 V, which is -500 V on the specimen; give the LabJack a "
                "power supply of its own and say source.external_power = true, or wire the interlock, which needs an NI card"
            )
        if not self.simulated and not self.source.device:
            raise ValueError(
                "source.device is missing; give the IP address of the LabJack that plays the drives, e.g. 192.0.2.10"
            )
        if self.card.driver == "labjack-t7" and self.source.device == self.card.device:
            raise ValueError(
                f"source.device {self.source.device} is also card.device, and a LabJack has one stream: it plays or it measures; use a "
                "second LabJack, or another card"
            )


def load_bench(name: str) -> BenchConfig:
    """Load the bench of a file, or one of `SIMULATED_BENCHES` by its name.

    Raises:
        ConfigError: the file is missing or wrong.
    """
    return read_bench(bench_text(name), "the simulated bench" if name in SIMULATED_BENCHES else name)


def bench_text(name: str) -> str:
    """Return the text of a bench file, or of one of `SIMULATED_BENCHES`.

    Raises:
        ConfigError: the file cannot be read.
    """
    if name in SIMULATED_BENCHES:
        return resources.files("sim_hardware").joinpath(SIMULATED_BENCHES[name]).read_text(encoding="utf-8")
    return read_toml_text(
        Path(name),
        f"bench file {truncate_text(name)!r}",
        "bench file",
        lambda message: ConfigError(f"{message}; give a bench file or 'sim'"),
    )


def read_bench(text: str, where: str) -> BenchConfig:
    """Return the bench of a text; `where` names it in messages.

    Raises:
        ConfigError: the text is wrong.
    """
    return _with_fresh_noise(read_toml(BenchConfig, text, where, ConfigError))


def _with_fresh_noise(config: BenchConfig) -> BenchConfig:
    """Return the bench with a drawn seed of its noise, for a simulated bench with fresh noise and no seed."""
    simulation = config.simulation or {}
    if not simulation.get("fresh_noise") or simulation.keys() & {"seed", "noise_seed"}:
        return config
    return config.model_copy(update={"simulation": {**simulation, "noise_seed": secrets.randbits(31)}})
