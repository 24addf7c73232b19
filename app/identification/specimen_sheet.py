"""Specimen sheet: measured dimensions and masses of one specimen, with uncertainty, instrument and date.

Values missing in the sheet are the paper's Table I with the uncertainties of ruler, caliper and scale. Both enter a fit as
free parameters with priors.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from math import hypot
from pathlib import Path

from app.common import pluralize
from app.identification.table_one import TABLE_ONE
from model import Membrane, Tactor, parameter_specs, shown_unit
from model.identification import (
    FitOptions,
    MembraneSagObservation,
    ObservationSet,
    assumed_parameters,
    parameter_spec,
    usual_effects,
)

PAPER_VALUES: Mapping[str, float] = asdict(Tactor()) | asdict(Membrane())
MEMBRANE_NAMES = frozenset(q.name for q in parameter_specs(Membrane))
GROUPS: dict[str, tuple[str, ...]] = {
    "plate": ("L", "L1", "L2", "b_Al", "h_Al", "E_Al"),
    "masses": ("rho1", "rho2"),
    "clamp": (),
    "membrane": ("L_m", "b_m", "h_m"),
}
"""Tables of a sheet with the values that Table I has; any other parameter of a fit may be added to each."""
DIMENSIONS = tuple(name for names in GROUPS.values() for name in names)


@dataclass(frozen=True, slots=True)
class Weighing:
    """A linear density as it was measured: a weighed mass over a length, SI, with standard uncertainties."""

    mass: float
    mass_uncertainty: float
    length: float
    length_uncertainty: float

    @property
    def density(self) -> tuple[float, float]:
        """Linear density and its standard uncertainty."""
        value = self.mass / self.length
        relative = hypot(self.mass_uncertainty / self.mass, self.length_uncertainty / self.length)
        return value, value * relative


@dataclass(frozen=True, slots=True)
class SheetEntry:
    """One value of a sheet, SI, with its standard uncertainty."""

    name: str
    value: float
    uncertainty: float
    instrument: str = ""
    date: str = ""
    """ISO 8601; empty if not stated."""
    measured: bool = True
    """False where it is Table I's, since the sheet has no value."""
    weighed: Weighing | None = None
    """Source of a linear density, if a mass and a length are stated."""


@dataclass(frozen=True)
class SpecimenSheet:
    """The sheet of one specimen; without a file (`path` None) all values are from Table I."""

    specimen: str = ""
    entries: Mapping[str, SheetEntry] = field(default_factory=dict)
    serial: str = ""
    batch: str = ""
    photograph: str = ""
    notes: str = ""
    descriptions: Mapping[str, str] = field(default_factory=dict)
    """Texts on plate, masses, clamp and membrane, by group."""
    mountings: Mapping[str, float] = field(default_factory=dict)
    """Repeatability of mountings by part, as a standard deviation, SI; for others the usual one is assumed."""
    path: Path | None = None
    simulated: bool = False
    """Whether it describes the specimen of a simulated bench."""

    @cached_property
    def values(self) -> dict[str, SheetEntry]:
        """Every prior value of a fit: the sheet's, and Table I's where the sheet has none."""
        return {name: table_one_entry(name) for name in DIMENSIONS} | dict(self.entries)

    @property
    def missing(self) -> tuple[str, ...]:
        """Dimensions that the sheet does not have."""
        return tuple(name for name in DIMENSIONS if name not in self.entries)

    @property
    def description(self) -> str:
        """Return the origin of the dimensions, as text."""
        table = "the paper's Table I with the uncertainties of ruler, caliper and scale"
        if self.path is None:
            return f"no specimen sheet: dimensions are from {table}"
        simulated = ", SIMULATED" if self.simulated else ""
        measured = f"specimen sheet {self.path.name}{simulated}: {pluralize(len(self.entries), 'measured value')}"
        return f"{measured}; {', '.join(self.missing)} from {table}" if self.missing else measured

    @property
    def tactor(self) -> Tactor:
        """Table I's tactor with the values of the sheet."""
        return Tactor(**self._values_of(Tactor))

    @property
    def membrane(self) -> Membrane:
        """Table I's membrane with the values of the sheet."""
        return Membrane(**self._values_of(Membrane))

    def _values_of(self, kind: type) -> dict[str, float]:
        return {q.name: self.entries[q.name].value for q in parameter_specs(kind) if q.name in self.entries}

    def fit_options(self, options: FitOptions, observations: ObservationSet, plain: bool = False) -> FitOptions:
        """Return the options with the sheet's values, free within their uncertainties where a run depends on them.

        Usual nonidealities outside the sheet are free within their usual sizes, unless the fit is `plain`; parameters determined by
        neither sheet nor runs are free around Table I. Values that the options fix, tie, free or give a prior are unchanged.
        """
        usual = assumed_parameters(observations) | ({} if plain else usual_effects(observations))
        names = self._names_for(observations)
        own = {*options.fixed, *options.tied, *options.priors, *options.also, *(options.free or ())}
        stated = {e.name: (e.value, e.uncertainty) for e in self.values.values() if e.name in names}
        priors = {name: prior for name, prior in {**stated, **usual, **stated}.items() if name not in own}
        free = None if options.free is None else (*options.free, *(name for name in priors if name not in options.free))
        return replace(
            options,
            tactor=replace(options.tactor, **self._values_of(Tactor)),
            membrane=replace(options.membrane, **self._values_of(Membrane)),
            free=free,
            priors={**priors, **options.priors},
        )

    def _names_for(self, observations: ObservationSet) -> frozenset[str]:
        """Return the values that these runs depend on."""
        sag_only = all(isinstance(run, MembraneSagObservation) for run in observations.runs)
        on_membrane = any(
            getattr(run, "elongation_m", None) is not None
            or (isinstance(run, MembraneSagObservation) and run.geometry is None)
            for run in observations.runs
        )
        return frozenset(name for name in self.values if (on_membrane if name in MEMBRANE_NAMES else not sag_only))


def table_one_entry(name: str) -> SheetEntry:
    """Return Table I's value of a dimension, with the uncertainty of its instrument."""
    source = TABLE_ONE[name]
    return SheetEntry(name, PAPER_VALUES[name], float(source.uncertainty or 0.0), source.description, "", False)


def sheet_unit(name: str) -> tuple[float, str]:
    """Return factor and bench unit of a parameter, in which a sheet states it."""
    return shown_unit(parameter_spec(name).unit, name)
