"""Setup state of a simulated bench: weights, sides, clamping and membrane, changed by the operator."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from model import GRAVITY, Skin, skin
from sim_hardware.plant.parameters import SimulationParameters

SPECIMEN_ACTIONS: Mapping[str, tuple[str, ...]] = {
    "place-weight": ("mass_kg",),
    "remove-weight": (),
    "turn-side": ("side",),
    "short-electrodes": (),
    "connect-electrodes": (),
    "fix-mass": ("mass_kg",),
    "stretch-membrane": ("elongation_m",),
    "remove-membrane": (),
    "tidy-up": (),
}
"""Actions on the specimen, and their numbers. Weights are loose; a mass is fixed in the cylinder.

`tidy-up` is never a prompt: the start of another run restores the set-up with which the bench was opened, or as it was mounted last:
with `mass_kg`, and the numbers of its mountings so far, `mass_mountings`, `plate_mountings` and `laser_mountings`; `cycles` is the number of its cycles so far.

`moving` of `fix-mass`: `mass_kg` is the effective mass, not the mass in the cylinder; `mounted`: it is the specimen's own, which is glued. `turn-side` removes all weights; it may
have `offset_kg`, the weight to lie on the other side, and `shorted`.
"""

SENSOR_ACTIONS: Mapping[str, tuple[str, ...]] = {
    "zero-sensor": (),
    "bump-sensor": ("by_m",),
    "limit-sensor": ("at_m",),
    "place-reference": ("reference_m",),
    "hang-membrane": ("reference_m",),
    "place-tactor": (),
}
"""Actions on the sensor and under it. A bump and an output that saturates are accidents, not answers to a prompt."""

SET_CHAMBER = "set-chamber"
OPERATOR_ACTIONS = {**SPECIMEN_ACTIONS, **SENSOR_ACTIONS, SET_CHAMBER: ("temperature_c",)}


@dataclass(frozen=True, slots=True)
class SetupState:
    """The setup of the bench.

    Attributes:
        fixed_kg: mass in the cylinder.
        skin: skin under the tactor; None: free.
        side: +1 with the MFC up, -1 with the aluminium up. The sensor does not move: a weight pushes the tactor in the same
            direction on both sides, a voltage bends it in opposite directions.
        shorted: whether the electrodes are shorted and disconnected from the amplifier.
        weights_kg: nominal masses on the centre, in the order of placing.
        mass_mountings, plate_mountings: how often each was mounted anew.
        earlier_cycles: cycles of the specimen beside those of this session.
    """

    fixed_kg: float = 0.0
    skin: Skin | None = None
    side: int = 1
    shorted: bool = False
    weights_kg: tuple[float, ...] = ()
    mass_mountings: int = 0
    plate_mountings: int = 0
    earlier_cycles: float = 0.0

    @property
    def mass_kg(self) -> float:
        """All mass that moves with the centre."""
        return self.fixed_kg + sum(self.weights_kg)


def initial_state(parameters: SimulationParameters) -> SetupState:
    """Return the setup before any action."""
    return SetupState(parameters.tactor.m_add, parameters.skin)


def check_action(action: str, values: Mapping[str, float]) -> None:
    """Raise ValueError for an unknown action, or a missing number."""
    if action not in OPERATOR_ACTIONS:
        raise ValueError(f"there is no action {action!r}: choose from {', '.join(OPERATOR_ACTIONS)}")
    if missing := [name for name in OPERATOR_ACTIONS[action] if name not in values]:
        raise ValueError(f"{action}: {', '.join(missing)} is missing")


def apply_action(
    state: SetupState, action: str, values: Mapping[str, float], parameters: SimulationParameters
) -> SetupState:
    """Return the setup after one of the actions of `SPECIMEN_ACTIONS`.

    Raises:
        ValueError: a number is missing or invalid, or there is no weight to take off.
    """
    match action:
        case "place-weight":
            return replace(state, weights_kg=(*state.weights_kg, _require_positive(action, values, "mass_kg")))
        case "remove-weight":
            return replace(state, weights_kg=_remove_weight(state.weights_kg, values.get("mass_kg")))
        case "turn-side":
            side = values["side"]
            if side not in (1, -1):
                raise ValueError(f"turn-side: side is {side:g}; it is +1 (MFC up) or -1 (aluminium up)")
            weights_kg = (_require_positive(action, values, "offset_kg"),) if values.get("offset_kg") else ()
            shorted = bool(values.get("shorted", state.shorted))
            return replace(state, side=int(side), weights_kg=weights_kg, shorted=shorted)
        case "short-electrodes" | "connect-electrodes":
            return replace(state, shorted=action == "short-electrodes")
        case "fix-mass":
            return _with_mass(state, values, parameters, state.mass_mountings + 1)
        case "stretch-membrane":
            elongation_m = _require_not_negative(action, values, "elongation_m") * (1 - parameters.beyond.membrane_slip)
            return replace(
                state, skin=skin(parameters.membrane, elongation_m / parameters.membrane.L_m, tactor=parameters.tactor)
            )
        case "tidy-up":
            glued, clamped = (int(values.get(f"{part}_mountings", 0)) for part in ("mass", "plate"))
            cycles = float(values.get("cycles", 0.0))
            state = replace(initial_state(parameters), plate_mountings=clamped, earlier_cycles=cycles)
            own = {"mass_kg": parameters.tactor.m_add, "moving": 1.0} if "mass_kg" not in values else {}
            return _with_mass(state, {**values, **own, "mounted": 1.0}, parameters, glued) if glued else state
    return replace(state, skin=None)


def _with_mass(
    state: SetupState, values: Mapping[str, float], parameters: SimulationParameters, number: int
) -> SetupState:
    """Return the setup with a mass in the cylinder; the specimen's own mass differs between mountings, an added one does not."""
    share = 1.0 if values.get("moving") else parameters.beyond.mass_share
    fixed_kg = share * _require_not_negative("fix-mass", values, "mass_kg")
    if not values.get("mounted"):
        return replace(state, fixed_kg=fixed_kg)
    fixed_kg += parameters.mounting.difference("mass", number, parameters.seed)
    return replace(state, fixed_kg=max(fixed_kg, 0.0), mass_mountings=number)


MISLABELLED_KG, MISLABELLED_ACTUAL_KG = 0.05, 0.061
"""Label and mass of the weight of the fault `weight-mislabelled`."""

LEFT_ON_ELONGATION_M = 2.54e-3
"""Elongation of the membrane of the fault `membrane-left-on`."""


def labelled_mass_kg(label_kg: float) -> float:
    """Return the mass of a weight with this label under the fault `weight-mislabelled`."""
    return MISLABELLED_ACTUAL_KG if abs(label_kg - MISLABELLED_KG) < 1e-9 else label_kg


def weight_force_n(state: SetupState, parameters: SimulationParameters, mislabelled: bool = False) -> float:
    """Return the true masses of the weights: each has its own constant error; one of them may have a wrong label."""

    def actual_kg(mass_kg: float) -> float:
        if mislabelled and labelled_mass_kg(mass_kg) != mass_kg:
            return labelled_mass_kg(mass_kg)
        return parameters.beyond.actual_mass_kg(mass_kg, parameters.seed)

    return GRAVITY * sum(map(actual_kg, state.weights_kg))


def with_membrane_left_on(state: SetupState, before: SetupState, parameters: SimulationParameters) -> SetupState:
    """Return the setup with the previous membrane, or with one of `LEFT_ON_ELONGATION_M`."""
    left = before.skin or skin(
        parameters.membrane, LEFT_ON_ELONGATION_M / parameters.membrane.L_m, tactor=parameters.tactor
    )
    return state if state.skin is not None else replace(state, skin=left)


def _remove_weight(weights_kg: tuple[float, ...], mass_kg: float | None) -> tuple[float, ...]:
    """Return the setup without this weight, or without the last placed one."""
    if not weights_kg:
        raise ValueError("remove-weight: no weight lies on the tactor")
    if mass_kg is None:
        return weights_kg[:-1]
    for place in reversed(range(len(weights_kg))):
        if abs(weights_kg[place] - mass_kg) <= 1e-9:
            return weights_kg[:place] + weights_kg[place + 1 :]
    raise ValueError(f"remove-weight: no weight of {1e3 * mass_kg:g} g lies on the tactor")


def _require_positive(action: str, values: Mapping[str, float], name: str) -> float:
    if not values[name] > 0:
        raise ValueError(f"{action}: {name} must be positive, not {values[name]:g}")
    return float(values[name])


def _require_not_negative(action: str, values: Mapping[str, float], name: str) -> float:
    if not values[name] >= 0:
        raise ValueError(f"{action}: {name} must not be negative, not {values[name]:g}")
    return float(values[name])
