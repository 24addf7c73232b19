"""Values of many specimens: figures of their runs and parameters of their calibrations, with total uncertainty."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from datetime import datetime
from functools import cache
from pathlib import Path

import numpy as np

from app.archive import Catalogue, RunSummary
from app.identification import FORMAT, SUFFIX
from drivers import open_regular
from model import Array, current_name, quantity_label, shown_unit
from model.response import ABDOMEN_THRESHOLD, THRESHOLD_M, PerceptionThreshold
from protocols.base import MAX_TOML_BYTES, RunFigure, parse_toml, read_json_file, visible_text, visible_values
from protocols.runfile import SHEET_SUFFIX

CALIBRATION = "calibration"
"""In place of a protocol, for parameters of an accepted calibration."""
GROUPS = ("batch", "bench", "sensor", "operator", "month", "protocol")
NO_BATCH = "no batch"


class FleetError(Exception):
    """There is nothing to compare; the message names the missing data."""


@dataclass(frozen=True, slots=True)
class FleetValue:
    """One figure of one run, or a parameter of a calibration, SI; uncertainties are standard uncertainties."""

    name: str
    value: float
    statistical: float
    total: float
    unit: str
    condition: str
    specimen: str
    batch: str
    start_time: str
    protocol: str
    bench: str
    sensor: str
    operator: str
    path: str
    simulated: bool

    @property
    def time_s(self) -> float:
        """Seconds since 1970; NaN if the time is damaged."""
        try:
            return datetime.fromisoformat(self.start_time).timestamp()
        except (ValueError, OverflowError, OSError):
            return float("nan")

    @property
    def month(self) -> str:
        return self.start_time[:7]


@dataclass(frozen=True)
class Fleet:
    """Values of the specimens of a folder, oldest first.

    Attributes:
        left_out: values of the other kind, simulated or real, which are never mixed.
    """

    values: tuple[FleetValue, ...]
    left_out: int = 0
    simulated: bool = False

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the quantities, those with the most specimens first."""
        pairs = {(value.name, value.specimen) for value in self.values}
        return tuple(name for name, _ in Counter(name for name, _ in sorted(pairs)).most_common())

    def of(self, name: str) -> "FleetSelection":
        """Return the values of a quantity, by its identifier or its name for people, in its most frequent protocol and condition.

        Of two equally frequent kinds, the newer one is returned.

        Raises:
            FleetError: there are none.
        """
        if name not in self.names:
            name = next((each for each in self.names if quantity_label(each) == name), current_name(name))
        values = [value for value in self.values if value.name == name]
        if not values:
            names = ", ".join(self.names) or "none"
            raise FleetError(f"no run or calibration has '{visible_text(name)}'; there are: {names}")
        kinds = Counter((value.protocol, value.condition, value.unit) for value in reversed(values))
        kind = kinds.most_common(1)[0][0]
        chosen = tuple(v for v in values if (v.protocol, v.condition, v.unit) == kind)
        return FleetSelection(name, *kind, values=chosen, left_out=len(values) - len(chosen))

    def filtered(
        self,
        specimens: Sequence[str] = (),
        batch: str = "",
        bench: str = "",
        protocol: str = "",
        since: str = "",
    ) -> "Fleet":
        """Return the fleet of some values; empty arguments select all."""
        kept = tuple(
            v
            for v in self.values
            if (not specimens or v.specimen in specimens)
            and (not batch or v.batch == batch)
            and (not bench or v.bench == bench)
            and (not protocol or v.protocol == protocol)
            and (not since or v.start_time >= since)
        )
        return Fleet(kept, self.left_out, self.simulated)


@dataclass(frozen=True)
class FleetSelection:
    """Values of one quantity that can be compared: of one protocol and condition, oldest first."""

    name: str
    protocol: str
    condition: str
    unit: str
    values: tuple[FleetValue, ...]
    left_out: int = 0

    @property
    def label(self) -> str:
        """Name of the quantity for people."""
        return quantity_label(self.name)

    @property
    def display_unit(self) -> str:
        """Unit in which tables show the values; empty for the unit of the values themselves."""
        unit = shown_unit(self.unit, self.name)[1]
        return unit if unit != self.unit else ""

    @property
    def newest(self) -> tuple[FleetValue, ...]:
        """The newest value of each specimen, by name of the specimen."""
        newest = {value.specimen: value for value in self.values}
        return tuple(newest[name] for name in sorted(newest))

    @property
    def about(self) -> str:
        """Origin of the values, as text."""
        source = (
            "accepted calibrations" if self.protocol == CALIBRATION else f"runs of {self.protocol.replace('-', ' ')}"
        )
        return f"{source}{f' at {self.condition}' if self.condition else ''}"


def arrays(values: Sequence[FleetValue]) -> tuple[Array, Array]:
    """Return values and total uncertainties, each (N,)."""
    return np.array([v.value for v in values], float), np.array([v.total for v in values], float)


def read_fleet(
    folder: Path,
    catalogue: Catalogue,
    simulated: bool | None = None,
    threshold: PerceptionThreshold = ABDOMEN_THRESHOLD,
) -> Fleet:
    """Return the fleet of a folder by its catalogue, which is up to date after a scan, and its calibration files.

    Args:
        folder: of the runs; calibrations and sheets are in it, or in folders below that have runs.
        catalogue: of the folder.
        simulated: whether simulated runs are meant; None: real ones, and simulated ones if there are no others.
        threshold: of perception, for the margins.

    Raises:
        FleetError: no run has a result.
        OSError: the index cannot be read.
    """
    entries = [entry for entry in catalogue.figure_entries() if entry.has_result]
    folders = sorted({str(Path(entry.path).parent) for entry in entries} | {"."})
    batches = _read_batches(folder, folders)
    values = [*_run_values(entries, batches, threshold), *_calibration_values(folder, folders, batches)]
    values.sort(key=lambda v: (v.start_time, v.path))
    if simulated is None:
        simulated = not any(not v.simulated for v in values)
    kept = tuple(v for v in values if v.simulated == simulated)
    if not kept:
        kind = "simulated" if simulated else "real"
        raise FleetError(
            f"no {kind} run in {folder} has a result; 'tactor-bench runs {folder}' lists the existing ones"
            + ("" if simulated else ", and --simulated shows the simulated ones")
        )
    return Fleet(kept, len(values) - len(kept), simulated)


def _run_values(
    entries: Iterable[RunSummary], batches: Mapping[str, str], threshold: PerceptionThreshold
) -> Iterator[FleetValue]:
    @cache
    def scale(frequency_hz: float) -> float:
        return THRESHOLD_M / float(threshold.amplitude_at(frequency_hz))

    for entry in entries:
        for each in entry.figures:
            hz = each.frequency_hz
            figure = _over(each, threshold.marked_label, scale(hz)) if hz else each
            yield FleetValue(
                figure.name,
                figure.value,
                figure.statistical,
                figure.total,
                figure.unit,
                figure.condition,
                entry.specimen,
                batches.get(entry.specimen, NO_BATCH),
                entry.start_time,
                entry.protocol,
                entry.bench,
                entry.sensor,
                entry.operator,
                entry.path,
                bool(entry.simulated),
            )


def _over(margin: RunFigure, threshold: str, scale: float) -> RunFigure:
    """Return a margin over the abdomen's threshold as one over another, which its condition names."""
    return margin._replace(
        value=scale * margin.value,
        statistical=scale * margin.statistical,
        total=scale * margin.total,
        condition=f"{margin.condition}, over {threshold}",
    )


def _calibration_values(folder: Path, folders: Iterable[str], batches: Mapping[str, str]) -> Iterator[FleetValue]:
    """Yield the parameters of all accepted versions; files that cannot be read are left to `tactor-bench calibration`."""
    for path in (path for place in folders for path in (folder / place).glob(f"*{SUFFIX}")):
        with suppress(OSError, ValueError, KeyError, TypeError, AttributeError):
            record = visible_values(read_json_file(path))
            if record["format"] != FORMAT:
                continue
            yield from [
                FleetValue(
                    estimate["name"],
                    float(estimate["value"]),
                    float(version.get("statistical", {}).get(estimate["name"], estimate["standard_error"])),
                    float(estimate["standard_error"]),
                    estimate["unit"],
                    "",
                    version["specimen"],
                    batches.get(version["specimen"], NO_BATCH),
                    version["accepted_at"],
                    CALIBRATION,
                    "",
                    "",
                    version["accepted_by"],
                    path.name,
                    bool(version["simulated"]),
                )
                for version in record["versions"]
                for estimate in version["estimates"]
                if estimate["name"] not in version.get("known", {})
            ]


def _read_batches(folder: Path, folders: Iterable[str]) -> dict[str, str]:
    """Return the batches that specimen sheets state, by specimen; sheets that cannot be read are left to `specimen check`."""
    batches = {}
    for path in (path for place in folders for path in (folder / place).glob(f"*{SHEET_SUFFIX}")):
        with suppress(OSError, ValueError):
            with open_regular(path, "r", encoding="utf-8") as file:
                sheet = parse_toml(file.read(MAX_TOML_BYTES))
            if isinstance(batch := sheet.get("batch"), str) and batch.strip():
                batches[visible_text(str(sheet.get("specimen", "")))] = visible_text(batch.strip())
    return batches
