"""Bench file tables [levels] and [specimen]: abort levels, and the gap that limits the stroke."""

from typing import Annotated

from annotated_types import Interval, Unit

from app.config.config_table import ConfigTable
from drivers import LevelAction, LevelSettings

DEFAULTS = LevelSettings()


class SpecimenTable(ConfigTable):
    """The specimen as it is mounted."""

    gap_m: Annotated[
        float,
        Unit("m"),
        Interval(gt=0, le=0.1),
        "clear distance from the specimen at rest to the nearest obstacle; the paper's spacers leave 0.77 mm (Sec. II)",
    ] = DEFAULTS.gap_m


class LevelsTable(ConfigTable):
    """Abort levels, evaluated in every block. Actions: off, warning (points are flagged), ask (at rest), rest (the run ends)."""

    stroke: Annotated[LevelAction, "what happens where the displacement from rest exceeds stroke_m"] = DEFAULTS.stroke
    stroke_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.1), "largest displacement from rest; 0 is gap_m of [specimen]"
    ] = DEFAULTS.stroke_m
    rate: Annotated[LevelAction, "what happens where the displacement rate exceeds rate_m_per_s"] = DEFAULTS.rate
    rate_m_per_s: Annotated[
        float, Unit("m/s"), Interval(gt=0, le=1000), "largest displacement rate; 5 Vpp at resonance reach 0.6 m/s"
    ] = DEFAULTS.rate_m_per_s
    laser_lost: Annotated[LevelAction, "what happens where the sensor is out of range for longer than laser_lost_s"] = (
        DEFAULTS.laser_lost
    )
    laser_lost_s: Annotated[
        float, Unit("s"), Interval(ge=0.001, le=60), "longest time out of the sensor's range under a drive"
    ] = DEFAULTS.laser_lost_s
    drive: Annotated[LevelAction, "what happens where the drive read back is not the commanded one"] = DEFAULTS.drive
    drive_tolerance: Annotated[
        float, Unit("1"), Interval(ge=0.02, le=1), "largest deviation of the drive, relative to its amplitude"
    ] = DEFAULTS.drive_tolerance
    voltage: Annotated[LevelAction, "what happens where a voltage monitor exceeds voltage_v"] = DEFAULTS.voltage
    voltage_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=100_000), "largest magnitude at the specimen; the amplifier gives +1500 V"
    ] = DEFAULTS.voltage_v
    current: Annotated[LevelAction, "what happens where a current monitor exceeds current_a"] = DEFAULTS.current
    current_a: Annotated[float, Unit("A"), Interval(gt=0, le=100), "largest magnitude of the amplifier's current"] = (
        DEFAULTS.current_a
    )
    no_response: Annotated[LevelAction, "what happens after no_response_points points without response"] = (
        DEFAULTS.no_response
    )
    no_response_points: Annotated[int, Unit("1"), Interval(ge=1, le=1000), "points in succession without response"] = (
        DEFAULTS.no_response_points
    )

    def settings(self, specimen: SpecimenTable) -> LevelSettings:
        """Return the levels of a bench with this specimen."""
        return LevelSettings(gap_m=specimen.gap_m, **self.model_dump())
