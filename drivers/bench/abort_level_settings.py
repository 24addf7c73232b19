"""Abort levels of a bench: limits of its channels while it is live, and the action beyond each."""

from dataclasses import dataclass, fields
from enum import StrEnum


class LevelAction(StrEnum):
    """Action beyond an abort level. The texts are stored in run files and bench files; they never change."""

    OFF = "off"
    WARNING = "warning"
    """A report; the points of the entry are flagged, and the run continues."""
    ASK = "ask"
    """The source returns to rest, and the operator decides."""
    REST = "rest"
    """The run ends at rest."""


@dataclass(frozen=True, slots=True)
class LevelSettings:
    """Abort levels and their actions, as in the tables [levels] and [specimen] of a bench file.

    Attributes:
        gap_m: clear distance from the specimen at rest to the nearest obstacle.
        stroke_m: largest displacement from rest; 0 is `gap_m`.
        rate_m_per_s: largest displacement rate.
        laser_lost_s: longest time for which the sensor may be out of range under a drive.
        drive_tolerance: largest deviation of the recorded drive, relative to its amplitude or its distance from rest.
        voltage_v, current_a: largest magnitudes at the amplifier's monitors.
        no_response_points: consecutive points without response.
    """

    gap_m: float = 0.77e-3
    stroke: LevelAction = LevelAction.ASK
    stroke_m: float = 0.0
    rate: LevelAction = LevelAction.ASK
    rate_m_per_s: float = 2.0
    laser_lost: LevelAction = LevelAction.ASK
    laser_lost_s: float = 0.05
    drive: LevelAction = LevelAction.REST
    drive_tolerance: float = 0.1
    voltage: LevelAction = LevelAction.ASK
    voltage_v: float = 1650.0
    current: LevelAction = LevelAction.ASK
    current_a: float = 0.022
    no_response: LevelAction = LevelAction.ASK
    no_response_points: int = 3

    @property
    def asking(self) -> tuple[str, ...]:
        """Names of the levels with the action "ask"."""
        return tuple(each.name for each in fields(self) if getattr(self, each.name) is LevelAction.ASK)

    @property
    def stroke_limit_m(self) -> float:
        """The largest displacement from rest."""
        return self.stroke_m or self.gap_m
