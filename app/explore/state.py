"""Slider settings of the Explore page: values, presets, kept curves, export as text or parameter study."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np

from app.explore.sliders import SLIDERS, SliderSpec
from model import NONIDEAL_NAMES, Membrane, Specimen, Tactor, parameter_specs, replace_variables, variable_specs

if TYPE_CHECKING:
    from model.studies import Study

TACTOR_PARAMETERS = frozenset((*(q.name for q in parameter_specs(Tactor)), *NONIDEAL_NAMES))
"""Parameters that a free tactor has."""
DERIVED_PARAMETERS = ("k_s", "c_s", "contact_length")
"""Parameters that follow from the membrane or the geometry unless they are set."""


@dataclass(frozen=True, slots=True)
class ExploreSetting:
    """The values of all sliders: `values` holds the moved ones, SI; the others are the paper's Table I."""

    values: Mapping[str, float] = field(default_factory=dict)
    on_skin: bool = False
    peak_to_peak_v: float = 5.0
    """Drive at the amplifier's input."""

    @property
    def specimen(self) -> Specimen:
        """The specimen; raises ParameterError if it is not physical."""
        used = {name: v for name, v in self.values.items() if self.on_skin or name in TACTOR_PARAMETERS}
        return replace_variables(Specimen(membrane=Membrane() if self.on_skin else None), used)

    def value(self, name: str) -> float:
        """Return the value of a slider, set or derived; for a free tactor the value it would have on the skin."""
        return self.values[name] if name in self.values else replace(self, on_skin=True).specimen.value(name)

    @property
    def all_values(self) -> dict[str, float]:
        """The `value` of every slider, computed together."""
        specimen = replace(self, on_skin=True).specimen
        skin = specimen.skin
        follows = {"k_s": skin.k_s, "c_s": skin.c_s}
        return {n: self.values.get(n, follows[n] if n in follows else specimen.value(n)) for n in SLIDERS}

    def with_value(self, name: str, value: float) -> "ExploreSetting":
        """Return the setting with another value of a slider. A slider of the skin puts the tactor on the skin."""
        if name == DRIVE_SLIDER.name:
            return replace(self, peak_to_peak_v=value)
        on_skin = self.on_skin or name not in TACTOR_PARAMETERS
        return replace(self, values={**self.values, name: value}, on_skin=on_skin)

    def with_default(self, name: str) -> "ExploreSetting":
        """Return the setting with a slider at its default: Table I, or derived from the others."""
        if name == DRIVE_SLIDER.name:
            return ExploreSetting(self.values, self.on_skin)
        return replace(self, values={n: v for n, v in self.values.items() if n != name})

    @property
    def specimen_values(self) -> dict[str, float]:
        """Every parameter of the specimen that `--set` accepts, SI, without derived ones."""
        names = [
            n
            for n in variable_specs()
            if (self.on_skin or n in TACTOR_PARAMETERS) and (n not in DERIVED_PARAMETERS or n in self.values)
        ]
        return {name: self.value(name) for name in names}

    def as_json(self) -> str:
        return json.dumps(self.specimen_values, indent=2)

    def as_toml(self) -> str:
        specs = variable_specs()
        return "".join(
            f"{n} = {v!r}  # {specs[n].unit or '1'}, {specs[n].description}\n" for n, v in self.specimen_values.items()
        )


SKIN_PARAMETERS = frozenset(SLIDERS) - TACTOR_PARAMETERS
DRIVE_SLIDER = SliderSpec("peak_to_peak_v", 0.1, 5.0)


@dataclass(frozen=True, slots=True)
class KeptCurve:
    """A setting whose curve is kept for comparison."""

    label: str
    setting: ExploreSetting


@dataclass(frozen=True, slots=True)
class ExplorePreset:
    """A start setting with kept curves."""

    setting: ExploreSetting
    kept_curves: tuple[KeptCurve, ...] = ()
    variable: str = ""
    """The parameter in which the kept curves differ."""


PRESET_TITLES = {
    "free": "Table I, free",
    "membrane": "Table I, on the membrane",
    "fig10": "Fig. 10: skin stiffness",
    "fig11": "Fig. 11: skin damping",
    "fig12": "Fig. 12: pre-stretch",
}
"""Titles by name."""


def make_preset(name: str) -> ExplorePreset:
    """Return one of `PRESET_TITLES`: Table I, or one of the paper's studies with its curves."""
    if name in ("free", "membrane"):
        return ExplorePreset(ExploreSetting(on_skin=name == "membrane"))
    from model.studies import STUDY_PRESETS  # lazily: loads scipy

    study = STUDY_PRESETS[name]()
    on = study.specimen
    values = {"delta": on.delta} if on.delta else {}
    values |= {letter: v for letter in ("k_s", "c_s") if (v := getattr(on, letter)) is not None}
    base = ExploreSetting(values, on_skin=True)
    ((variable, varied),) = study.vary.items()
    kept = tuple(KeptCurve(value_label(variable, v), base.with_value(variable, v)) for v in varied)
    return ExplorePreset(kept[len(kept) // 2].setting, kept, variable)


def value_label(name: str, value: float) -> str:
    """Return `E_m = 6.95 MPa`."""
    slider = SLIDERS[name]
    return f"{name} = {value * slider.factor:.4g} {slider.unit}"


def describe_difference(old: ExploreSetting, new: ExploreSetting) -> str:
    """Return how two settings differ, as the label of a kept curve."""
    differences = [value_label(n, new.value(n)) for n in SLIDERS if old.values.get(n) != new.values.get(n)]
    if old.on_skin != new.on_skin:
        differences.insert(0, "on the skin" if new.on_skin else "free")
    if old.peak_to_peak_v != new.peak_to_peak_v:
        differences.append(f"{new.peak_to_peak_v:g} V")
    return ", ".join(differences) or "Table I"


def make_study(
    setting: ExploreSetting, kept_curves: Sequence[KeptCurve], variable: str, frequency_hz: Sequence[float]
) -> "Study":
    """Return a study of one variable: over the values of the kept curves if they differ, else over its slider in nine steps.

    Raises:
        ParameterError: a value at which the specimen is not physical.
    """
    from model.studies import Study

    values = sorted({k.setting.value(variable) for k in kept_curves})
    if len(values) < 2:
        slider = SLIDERS[variable]
        values = [slider.value_at(place) for place in np.linspace(0, 1, 9)]
        admitted = variable_specs()[variable].is_valid(values)
        values = [v for v, good in zip(values, admitted, strict=True) if good]
    base = setting if setting.on_skin or variable in TACTOR_PARAMETERS else replace(setting, on_skin=True)
    specimen = base.with_default(variable).specimen
    return Study(
        {variable: tuple(values)},
        tuple(float(f) for f in frequency_hz),
        specimen,
        measure="peak_to_peak",
        amplitude_v=setting.peak_to_peak_v / 2,
    )
