"""Playing with the model: what stands at which slider, how it came there, and how it leaves as text or as a study. No Qt."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.explore.sliders import SLIDERS, Slider
from model.parameter_spec import quantities
from model.parameters import Membrane, Tactor
from model.specimen import Specimen, changed, variables

if TYPE_CHECKING:
    from model.studies.parameter_study import Study

OF_TACTOR = frozenset(q.name for q in quantities(Tactor))
FOLLOWING = ("k_s", "c_s", "contact_length")
"""What the membrane or the geometry gives, unless a person takes it in hand."""


@dataclass(frozen=True, slots=True)
class Setting:
    """Where every slider stands: `values` holds, SI, only what was moved; all else is the paper's Table I."""

    values: Mapping[str, float] = field(default_factory=dict)
    on_skin: bool = False
    peak_to_peak_v: float = 5.0
    """Of the drive, at the amplifier's input."""

    @property
    def specimen(self) -> Specimen:
        """The specimen; raises ParameterError where it is not physical."""
        known = {name: v for name, v in self.values.items() if self.on_skin or name in OF_TACTOR}
        return changed(Specimen(membrane=Membrane() if self.on_skin else None), known)

    def value(self, name: str) -> float:
        """Where a slider stands, or what follows for it; on a free tactor, what would be on the skin."""
        return self.values[name] if name in self.values else replace(self, on_skin=True).specimen.value(name)

    @property
    def everything(self) -> dict[str, float]:
        """Where every slider stands, as `value` tells it, at the cost of one."""
        specimen = replace(self, on_skin=True).specimen
        skin = specimen.skin
        follows = {"k_s": skin.k_s, "c_s": skin.c_s}
        return {n: self.values.get(n, follows[n] if n in follows else specimen.value(n)) for n in SLIDERS}

    def moved(self, name: str, value: float) -> "Setting":
        """With one slider elsewhere. A slider of the skin puts the tactor on it."""
        on_skin = self.on_skin or name not in OF_TACTOR
        return replace(self, values={**self.values, name: value}, on_skin=on_skin)

    def reset(self, name: str) -> "Setting":
        """With one slider back: at Table I, or following the others again."""
        return replace(self, values={n: v for n, v in self.values.items() if n != name})

    @property
    def record(self) -> dict[str, float]:
        """Every number of the specimen that `--set` takes, SI; what follows from others is left out."""
        names = [
            n for n in variables() if (self.on_skin or n in OF_TACTOR) and (n not in FOLLOWING or n in self.values)
        ]
        return {name: self.value(name) for name in names}

    def as_json(self) -> str:
        return json.dumps(self.record, indent=2)

    def as_toml(self) -> str:
        known = variables()
        return "".join(f"{n} = {v!r}  # {known[n].unit or '1'}, {known[n].words}\n" for n, v in self.record.items())


OF_SKIN = frozenset(SLIDERS) - OF_TACTOR
DRIVE = Slider("peak_to_peak_v", "drive, peak to peak", "V", 1.0, 0.1, 5.0)


@dataclass(frozen=True, slots=True)
class Kept:
    """A curve that stays while the sliders move on."""

    label: str
    setting: Setting


@dataclass(frozen=True, slots=True)
class Preset:
    """A start for the sliders, with the curves that belong to it."""

    title: str
    setting: Setting
    kept: tuple[Kept, ...] = ()
    variable: str = ""
    """What the kept curves differ in."""


TITLES = {
    "free": "Table I, free",
    "membrane": "Table I, on the membrane",
    "fig10": "Fig. 10: skin stiffness",
    "fig11": "Fig. 11: skin damping",
    "fig12": "Fig. 12: pre-stretch",
}
"""Where one may begin."""


def preset(name: str) -> Preset:
    """One of `TITLES`: Table I, or one of the paper's studies with its curves."""
    if name in ("free", "membrane"):
        return Preset(TITLES[name], Setting(on_skin=name == "membrane"))
    from model.studies.parameter_study import PRESETS  # loads the linear algebra, for which no window waits

    study = PRESETS[name]()
    on = study.specimen
    values = {"delta": on.delta} if on.delta else {}
    values |= {letter: v for letter in ("k_s", "c_s") if (v := getattr(on, letter)) is not None}
    base = Setting(values, on_skin=True)
    ((variable, varied),) = study.vary.items()
    kept = tuple(Kept(kept_label(variable, v), base.moved(variable, v)) for v in varied)
    return Preset(TITLES[name], kept[len(kept) // 2].setting, kept, variable)


def kept_label(name: str, value: float) -> str:
    """`E_m = 6.95 MPa`."""
    slider = SLIDERS[name]
    return f"{name} = {value * slider.factor:.4g} {slider.unit}"


def difference(old: Setting, new: Setting) -> str:
    """In what two settings differ, in words; for the label of a kept curve."""
    words = [kept_label(n, new.value(n)) for n in SLIDERS if old.values.get(n) != new.values.get(n)]
    if old.on_skin != new.on_skin:
        words.insert(0, "on the skin" if new.on_skin else "free")
    if old.peak_to_peak_v != new.peak_to_peak_v:
        words.append(f"{new.peak_to_peak_v:g} V")
    return ", ".join(words) or "Table I"


def study_of(setting: Setting, kept: Sequence[Kept], variable: str, frequency_hz: Sequence[float]) -> "Study":
    """A study of one variable: over the values in which the kept curves differ, else over its slider in nine steps.

    Raises:
        ParameterError: a value at which the specimen is not physical.
    """
    from model.studies.parameter_study import Study

    values = sorted({k.setting.value(variable) for k in kept})
    if len(values) < 2:
        slider = SLIDERS[variable]
        values = [slider.value(place) for place in np.linspace(0, 1, 9)]
        admitted = variables()[variable].admits(values)
        values = [v for v, good in zip(values, admitted, strict=True) if good]
    base: Any = setting if setting.on_skin or variable in OF_TACTOR else replace(setting, on_skin=True)
    specimen = base.reset(variable).specimen
    return Study(
        {variable: tuple(values)},
        tuple(float(f) for f in frequency_hz),
        specimen,
        measure="peak_to_peak",
        amplitude_v=setting.peak_to_peak_v / 2,
    )
