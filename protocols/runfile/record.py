"""Run record: all facts of a run except points, series, events and samples.

A new fact of a run is a field here: the writer's `create_file` stores it, `Run` reads it, and lists, reports, exports and the public
interface have it from `record`.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache
from typing import Any, Self

from drivers import LaserSensor
from model import AmplifierMap, current_parameter
from protocols.base import (
    UNNAMED,
    EstimatedQuantity,
    ReferenceModel,
    RunConditions,
    RunStatus,
    SpecimenMounted,
    Verdict,
    parse_json_object,
    to_jsonable,
    visible_text,
    visible_values,
)

NO_SENSOR = LaserSensor("", 0.0)
LISTED_CONFIGURATION = ("name", "identities")
"""Tables of the configuration in the JSON form."""
DECODED_RECORDS = 2048


@dataclass(frozen=True, slots=True)
class LargestPoint:
    """The usable point with the largest max - min; `median_drive_v` is the median drive amplitude of all usable points."""

    frequency_hz: float
    peak_to_peak_m: float
    error_m: float
    median_drive_v: float


@dataclass(frozen=True, slots=True, kw_only=True)
class RunRecord:
    """Facts of a run: identity, people and conditions, instruments, verdict, estimates, key figures.

    Its JSON form, for lists and the sidecar, has only the bench's name and the identities of the configuration, only failed checks,
    and no reference model and software.
    """

    protocol: str = ""
    title: str = ""
    """Protocol and specimen."""
    specimen: str = UNNAMED
    start_time: str = ""
    """Start time, ISO 8601, UTC."""
    simulated: bool = False
    parameters: Mapping[str, Any] = field(default_factory=dict)
    """The protocol's parameters by name, SI."""
    requested: Mapping[str, Any] = field(default_factory=dict)
    """Requested values of parameters adapted to the source; empty without adaptation."""
    imported: Mapping[str, Any] = field(default_factory=dict)
    """Source files, hashes and columns of an imported run; empty for a measured one."""
    continues: str = ""
    """File of the continued run, relative to its folder; empty without one."""
    conditions: RunConditions = field(default_factory=RunConditions)
    """Operator, and state of the air; empty in runs of earlier versions."""
    mountings: tuple[SpecimenMounted, ...] = ()
    """The last mounting of each part before the first entry; a part without one was mounted at an unknown time."""
    configuration: Mapping[str, Any] = field(default_factory=dict)
    """The bench file's tables at the time of the run."""
    sensor: LaserSensor = NO_SENSOR
    """The displacement sensor with its calibration."""
    reference: Mapping[str, Any] = field(default_factory=dict)
    """Model of the free specimen for the verdict's comparison; empty in runs of earlier versions and imports."""
    software: Mapping[str, str] = field(default_factory=dict)
    """Versions of the software that computed the results, by name."""
    axes: tuple[str, str] = ("", "")
    """Plotted columns of the points: x and y."""
    default_plot: str = ""
    """Name of the series that a NeXus viewer shows first; empty for the points."""
    status: RunStatus = RunStatus.RUNNING
    crashed: bool = False
    """Whether the status is `running` but the writing process has ended (known on the same computer, or after repair)."""
    reason: str = ""
    """Kind and reason of the end; empty before it."""
    verdict: Verdict = field(default_factory=Verdict)
    """Verdict; not judged for a run of an earlier version, an import, or before the end."""
    estimates: tuple[EstimatedQuantity, ...] = ()
    """Estimates, the most important first."""
    series: tuple[str, ...] = ()
    """Names of its series, without repeats."""
    point_count: int = 0
    entry_count: int = 0
    """Number of entries of the plan with a point."""
    duration_s: float = 0.0
    """Duration of the samples."""
    largest: LargestPoint | None = None
    """Largest response; None for points without max - min."""
    caution: str = ""
    """Reason for ignoring data stored after the end of the run; empty without such a reason."""

    @property
    def state(self) -> str:
        """The status as text, including `crashed`; `imported` for an imported run."""
        if self.imported and self.status is RunStatus.COMPLETED:
            return "imported"
        return "crashed" if self.crashed else str(self.status)

    @property
    def bench_name(self) -> str:
        """Name of the bench; empty in an imported run."""
        return str(self.configuration.get("name", ""))

    @property
    def reference_model(self) -> ReferenceModel | None:
        """Model of the free specimen for the verdict's comparison.

        Raises:
            KeyError, TypeError, ValueError: the stored model is damaged.
        """
        return ReferenceModel.from_record(self.reference) if self.reference else None

    @property
    def sensor_text(self) -> str:
        """Name and serial number of the displacement sensor."""
        return " ".join(filter(None, (self.sensor.name, self.sensor.serial and f"#{self.sensor.serial}")))

    @property
    def identities(self) -> dict[str, Any]:
        """Identities of the instruments with serial numbers, by role; empty in an imported run."""
        return dict(self.configuration.get("identities", {}))

    @property
    def amplifier_map(self) -> AmplifierMap:
        """The amplifier's static map at the time of the run."""
        table = self.configuration.get("amplifier", {})
        return AmplifierMap(**{f.name: float(table[f.name]) for f in fields(AmplifierMap) if f.name in table})

    def for_lists(self) -> Self:
        """Return the record without fields that lists do not use."""
        kept = {name: self.configuration[name] for name in LISTED_CONFIGURATION if name in self.configuration}
        verdict = replace(self.verdict, checks=self.verdict.failed_checks)
        return replace(self, configuration=kept, reference={}, software={}, verdict=verdict)

    def to_json(self) -> str:
        """Return the JSON form for lists; non-finite values are null, and defaults are left out."""
        listed = self.for_lists()
        plain = {
            name: to_jsonable(value)
            for name, default in _DEFAULTS.items()
            if (value := getattr(listed, name)) is not default and value != default
        }
        return json.dumps(plain, ensure_ascii=False, allow_nan=False)

    @classmethod
    def from_json(cls, text: str) -> Self:
        """Return the record of a JSON form; see `from_plain`."""
        return cls.from_plain(parse_json_object(text), text)

    @classmethod
    def from_plain(cls, plain: dict[str, Any], text: str) -> Self:
        """Return the record of a parsed JSON form with the text `text`.

        Raises:
            ArithmeticError, AttributeError, LookupError, TypeError, ValueError: it is no record of this version.
        """
        is_visible = "\\" not in text and text.isprintable()
        if not is_visible:
            plain = visible_values(plain)
        for name, kind in _PLAIN.items():
            if name in plain and not isinstance(plain[name], kind):
                raise TypeError(f"{name} has another type")
            if kind is str and name in plain and not is_visible:
                plain[name] = visible_text(plain[name])
        return cls(**plain | {name: read(plain[name]) for name, read in _COMPOSED.items() if name in plain})


@lru_cache(DECODED_RECORDS)
def decode_record(text: str) -> RunRecord:
    """Return the record of a JSON form written by this program."""
    return RunRecord.from_json(text)


def current_parameters(stored: Mapping[str, Any]) -> dict[str, Any]:
    """Return all parameters of a run under their present names."""
    return {current_parameter(name, stored): value for name, value in stored.items()}


def _numbers(plain: Mapping[str, Any], *texts: str) -> dict[str, Any]:
    """Return the fields of a class of numbers, null as NaN, and texts."""
    return {
        name: value if name in texts else float("nan") if value is None else float(value)
        for name, value in plain.items()
    }


_DEFAULTS = {f.name: getattr(RunRecord(), f.name) for f in fields(RunRecord)}
_PLAIN: Mapping[str, Any] = {
    name: type(default) for name, default in _DEFAULTS.items() if type(default) in (str, bool, int, dict)
} | {"duration_s": (int, float)}
"""Types of the fields stored without conversion."""
_COMPOSED: Mapping[str, Any] = {
    "parameters": current_parameters,
    "conditions": lambda plain: RunConditions(**plain),
    "mountings": lambda plain: tuple(map(SpecimenMounted.from_record, plain)),
    "sensor": lambda plain: LaserSensor(
        **_numbers(plain | {"curve": 0}, "name", "quantity", "serial", "calibrated", "expires")
        | {"curve": tuple((float(m), float(v)) for m, v in plain.get("curve", ()))}
    ),
    "axes": lambda plain: (str(plain[0]), str(plain[1])),
    "status": RunStatus,
    "verdict": Verdict.from_record,
    "estimates": lambda plain: tuple(EstimatedQuantity(**_numbers(each, "name", "unit", "source")) for each in plain),
    "series": lambda plain: tuple(map(str, plain)),
    "largest": lambda plain: LargestPoint(**_numbers(plain)),
}
"""Readers of the other fields."""
