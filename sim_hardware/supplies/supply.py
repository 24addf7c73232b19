"""Simulated output of a DC supply: rises quickly, falls slowly; off is not 2.5 V."""

import math
import re
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from model import Array
from sim_hardware.generators import SegmentFactory, Trait, draw_options
from sim_hardware.plant import RelayGlitchSegment, Segment, SupplyParameters

SUPPLY_DEVIATIONS = (
    Trait(
        "level",
        ("nominal", "low"),
        "volts of the loaded output: 6 % below the setting, which its voltmeter shows nevertheless",
    ),
    Trait(
        "step", ("between", "overshoots", "drops"), "output at a change of the level: 0.3 V too high, or 0 V, for 5 ms"
    ),
    Trait(
        "series",
        ("as-replied", "stays"),
        "outputs that stay in series although the instrument replies that they are not",
        "E3631[123]|SPD",
    ),
    Trait(
        "fall", ("as-measured", "slow"), "a falling output that is above what its voltmeter shows: time constant of 2 s"
    ),
)
"""Deviations, never drawn: `supply.traits` chooses them, to try a commissioning."""

GLITCH_S, OVERSHOOT_V, LOW_RATIO, SLOW_FALL_TAU_S = 5e-3, 0.3, 0.94, 2.0


def supply_deviations_of(model: str) -> tuple[Trait, ...]:
    """Return the possible deviations of a model."""
    return tuple(t for t in SUPPLY_DEVIATIONS if re.match(t.models, model.upper()))


def draw_supply_traits(model: str, chosen: str = "") -> dict[str, str]:
    """Return the chosen deviations of a supply, e.g. `level=low step=drops`.

    Raises:
        ValueError: an unknown deviation or option is chosen.
    """
    return draw_options("supply.traits", model, model, (), supply_deviations_of(model), chosen)


RISE_TAU_S = 1e-3
INRUSH_A = 0.2
"""Current of a step into the capacitance of cable and output."""


@dataclass(frozen=True, slots=True)
class ExponentialSegment:
    """Exponential from `start_v` at `origin_s` to `stop_v`: a supply's output, quick up and slow down."""

    origin_s: float
    start_v: float
    stop_v: float
    tau_s: float

    @property
    def constant_from_s(self) -> float:
        away = abs(self.start_v - self.stop_v)
        return self.origin_s + self.tau_s * math.log(max(away / 1e-4, 1.0))  # a tenth of a millivolt counts as constant

    @property
    def breakpoints_s(self) -> tuple[float, ...]:
        return ()

    def volts(self, t: Array) -> Array:
        since = np.maximum(np.asarray(t, float) - self.origin_s, 0.0)
        return self.stop_v + (self.start_v - self.stop_v) * np.exp(-since / self.tau_s)


class SimulatedSupply:
    """One output.

    Args:
        emit: function that outputs the segment of the given factory.
        now: function that returns bench time.
        parameters: level when off, fall time, over-voltage protection.
    """

    def __init__(
        self, emit: Callable[[SegmentFactory], None], now: Callable[[], float], parameters: SupplyParameters
    ) -> None:
        self._emit, self._now, self._parameters = emit, now, parameters
        self._deviations = draw_supply_traits(parameters.model, parameters.traits)
        self._segment: Segment = ExponentialSegment(0.0, 0.0, 0.0, RISE_TAU_S)
        self._shown: Segment = self._segment
        """Reading of its voltmeter."""
        self.level_v = 0.0
        self.current_limit_a = 1.0
        self.output_on = False
        self.ovp_v = parameters.ovp_v
        self.ovp_enabled = parameters.ovp
        self.ovp_tripped = self.ocp_tripped = False
        self.ocp_enabled = parameters.ocp
        self.tracking = parameters.tracking
        self._powered = True
        self.update_output()

    def update_output(self) -> None:
        """Move the output from its present level to the set level."""

        def make(t: float) -> Segment:
            start = float(self._following(self._segment).volts(np.array([t]))[0])
            if self.output_on and self.ovp_enabled and self.level_v > self.ovp_v:
                self.output_on, self.ovp_tripped = False, True
            if self.output_on and self.ocp_enabled and self.level_v > start and self.current_limit_a < INRUSH_A:
                self.output_on, self.ocp_tripped = False, True  # DP800 guide p. 2-57, E3632A guide p. 88
            level_v = 2 * self.level_v if self.tracking else self.level_v  # in series, the outputs add
            target = level_v if self.output_on and self._powered else self._parameters.off_v
            shown_v = float(self._shown.volts(np.array([t]))[0])
            self._shown = ExponentialSegment(
                t, shown_v, target, RISE_TAU_S if target > shown_v else self._parameters.fall_tau_s
            )
            self._segment = self._deviating(t, start, target) if self._deviations else self._shown
            return self._segment

        self._emit(make)

    def _deviating(self, t: float, start_v: float, target_v: float) -> Segment:
        """Return the output with the deviation hidden from its voltmeter."""
        target_v *= LOW_RATIO if self._deviations.get("level") == "low" else 1.0
        target_v *= 2.0 if self._deviations.get("series") == "stays" else 1.0
        slow = self._deviations.get("fall") == "slow"
        fall_tau_s = SLOW_FALL_TAU_S if slow else self._parameters.fall_tau_s
        tau_s = RISE_TAU_S if target_v > start_v else fall_tau_s
        segment = ExponentialSegment(t, start_v, target_v, tau_s)
        match self._deviations.get("step"):
            case "overshoots":
                return RelayGlitchSegment(t + GLITCH_S, target_v + OVERSHOOT_V, segment)
            case "drops":
                return RelayGlitchSegment(t + GLITCH_S, 0.0, segment)
        return segment

    @staticmethod
    def _following(segment: Segment) -> Segment:
        """Return the output without its transient, the begin of the next one."""
        return segment.following if isinstance(segment, RelayGlitchSegment) else segment

    def measured_v(self) -> float:
        """Return the reading of its own voltmeter."""
        return round(float(self._shown.volts(np.array([self._now()]))[0]), 4)

    def reset(self) -> None:
        """Factory state: off."""
        self.output_on, self.level_v, self.ovp_tripped, self.ocp_tripped = False, 0.0, False, False
        self.ocp_enabled = self.tracking = False
        self.ovp_enabled, self.ovp_v = self._parameters.ovp, self._parameters.ovp_v
        self.update_output()

    def set_power(self, on: bool) -> None:
        """The mains plug. Power comes back with the factory state."""
        self._powered = on
        self.reset()
