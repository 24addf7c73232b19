"""Bench file tables [levels] and [specimen]: abort levels, and the gap that limits the stroke."""

from typing import Annotated, Literal

from annotated_types import Interval, Unit

from app.config.config_table import ConfigTable
from drivers import LevelAction, LevelSettings

Action = Literal["off", "warning", "ask", "rest"]


class SpecimenTable(ConfigTable):
    """The specimen as it is mounted."""

    gap_m: Annotated[
        float,
        Unit("m"),
        Interval(gt=0, le=0.1),
        "clear distance from the specimen at rest to the nearest obstacle; the paper's spacers leave 0.77 mm (Sec. II)",
    ] = 0.77e-3


class LevelsTable(ConfigTable):
    """Abort levels, evaluated in every block. Actions: off, warning (points are flagged), ask (at rest), rest (the run ends)."""

    stroke: Annotated[Action, "what happens where the displacement from rest exceeds stroke_m"] = "ask"
    stroke_m: Annotated[
        float, Unit("m"), Interval(ge=0, le=0.1), "largest displacement from rest; 0 is gap_m of [specimen]"
    ] = 0.0
    rate: Annotated[Action, "what happens where the displacement rate exceeds rate_m_per_s"] = "ask"
    rate_m_per_s: Annotated[
        float, Unit("m/s"), Interval(gt=0, le=1000), "largest displacement rate; 5 Vpp at resonance reach 0.6 m/s"
    ] = 2.0
    laser_lost: Annotated[Action, "what happens where the sensor is out of range for longer than laser_lost_s"] = "ask"
    laser_lost_s: Annotated[
        float, Unit("s"), Interval(ge=0.001, le=60), "longest time out of the sensor's range under a drive"
    ] = 0.05
    drive: Annotated[Action, "what happens where the drive read back is not the commanded one"] = "rest"
    drive_tolerance: Annotated[
        float, Unit("1"), Interval(ge=0.02, le=1), "largest deviation of the drive, relative to its amplitude"
    ] = 0.1
    voltage: Annotated[Action, "what happens where a voltage monitor exceeds voltage_v"] = "ask"
    voltage_v: Annotated[
        float, Unit("V"), Interval(gt=0, le=100_000), "largest magnitude at the specimen; the amplifier gives +1500 V"
    ] = 1650.0
    current: Annotated[Action, "what happens where a current monitor exceeds current_a"] = "ask"
    current_a: Annotated[float, Unit("A"), Interval(gt=0, le=100), "largest magnitude of the amplifier's current"] = (
        0.022
    )
    no_response: Annotated[Action, "what happens after no_response_points points without response"] = "ask"
    no_response_points: Annotated[int, Unit("1"), Interval(ge=1, le=1000), "points in succession without response"] = 3

    def settings(self, specimen: SpecimenTable) -> LevelSettings:
        """Return the levels of a bench with this specimen."""
        values = self.model_dump()
        actions = {name: LevelAction(value) for name, value in values.items() if isinstance(value, str)}
        return LevelSettings(gap_m=specimen.gap_m, **{**values, **actions})
