"""The paper's identification as values: the choices it leaves open, and what its steps found."""

from dataclasses import dataclass, field
from typing import Literal

from model.amplifier import AmplifierMap
from model.parameters import Membrane, Tactor
from model.quantity import ParameterError

Damping = Literal["counted", "neglected"]


class ChainError(ValueError):
    """A step cannot be done with these runs; the message names step, run and remedy."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step: its name, the runs it used, what came out (SI, by name), and what it did in words."""

    name: str
    runs: tuple[str, ...]
    values: dict[str, float]
    words: str


@dataclass(frozen=True, slots=True)
class Validation:
    """How well a curve's shape is predicted: Pearson's r of measured and predicted amplitudes, its p value, points."""

    label: str
    r: float
    p: float
    points: int


@dataclass(frozen=True, slots=True)
class Chain:
    """What the chain found."""

    steps: tuple[Step, ...]
    tactor: Tactor
    membrane: Membrane
    c_s: dict[float, float]
    """Elongation (m) -> c_s, kg/(m s)."""
    r_squared: float | None
    """Of the line c_s_delta delta + c_s(0), intercept fixed; None without a line."""
    validation: tuple[Validation, ...]

    @property
    def values(self) -> dict[str, float]:
        """Everything that came out, by the names of `model.identification.names`."""
        return {name: value for step in self.steps for name, value in step.values.items()}


@dataclass(frozen=True)
class ChainMethod:
    """The choices the paper leaves open.

    Attributes:
        tactor, membrane: values of everything that is not identified.
        contact_length: as in `model.skin.skin`.
        static_weight: weight of static loading in step 1, 1 minus it that of mass resonance. Each of the two distances is the
            sum of squares over the sum of squares of the measured values; the paper does not give its weights, and with these
            neither unit nor number of points decides. One half by default.
        damping: "counted" compares measured peaks with the damped model's peaks, like with like, and goes round the steps
            until c0 no longer changes k2. "neglected" is the paper's word, C = 0: it takes every peak for an undamped
            frequency, 5 % off at a damping ratio of 0.21.
        amplitude: "fundamental" of the sine fit, or half of "peak_to_peak" as the paper did. A run that has only one gives that.
        amplifier, n: the amplifier's map, and the number of shape functions.
    """

    tactor: Tactor = field(default_factory=Tactor)
    membrane: Membrane = field(default_factory=Membrane)
    contact_length: float | None = None
    static_weight: float = 0.5
    damping: Damping = "counted"
    amplitude: Literal["fundamental", "peak_to_peak"] = "fundamental"
    amplifier: AmplifierMap = field(default_factory=AmplifierMap)
    n: int = 7

    def __post_init__(self) -> None:
        if not 0 <= self.static_weight <= 1:
            raise ParameterError(f"static_weight is {self.static_weight:g}: it must lie between 0 and 1")
        if self.damping not in ("counted", "neglected") or self.amplitude not in ("fundamental", "peak_to_peak"):
            raise ParameterError(
                "damping is counted or neglected, amplitude fundamental or peak_to_peak: choose of these"
            )
