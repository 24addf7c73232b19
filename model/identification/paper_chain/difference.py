"""Difference between the paper's chain and the joint fit, with the effects that the chain leaves out."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from model.identification.fit_result import JointFit
from model.identification.forward_model import ForwardModel, with_predictions
from model.identification.nonidealities import NONIDEALITIES
from model.identification.observations import ObservationSet
from model.identification.paper_chain.chain import PaperChainError, PaperChainOptions, identify_by_paper_chain

MIN_PART = 0.1
"""Of a difference: smaller parts of it are not named."""
REST = "dimensions and noise"


@dataclass(frozen=True, slots=True)
class ChainDifference:
    """How far the paper's chain is from the joint fit in one parameter.

    Attributes:
        name: of the parameter.
        chain, joint, joint_error: value of each, and total standard uncertainty of the joint fit, SI.
        parts: share of the joint value by which each effect moves the chain, the largest first.
    """

    name: str
    chain: float
    joint: float
    joint_error: float
    parts: tuple[tuple[str, float], ...]

    @property
    def share(self) -> float:
        """Difference over the value of the joint fit."""
        return self.chain / self.joint - 1

    @property
    def sigmas(self) -> float:
        """Difference over the total standard uncertainty of the joint fit."""
        return self.share * abs(self.joint) / self.joint_error if self.joint_error > 0 else float("nan")

    @property
    def reasons(self) -> str:
        """The effects that make it, as text: `creep -9.1 %, hysteresis -3.0 %`."""
        named = [p for p in self.parts if abs(p[1]) >= MIN_PART * abs(self.share)]
        return ", ".join(f"{name} {100 * part:+.2g} %" for name, part in named)


def chain_differences(
    chain: Mapping[str, float], observations: ObservationSet, options: PaperChainOptions, fit: JointFit
) -> tuple[ChainDifference, ...]:
    """Return how far the paper's chain is from a joint fit in each parameter that both have, and by which effects.

    What an effect does is the change of the chain, on runs without noise as the joint fit predicts them, when the effect is not there.

    Args:
        chain: values of the chain, by name.
        observations: runs of the chain.
        options: of the chain.
        fit: joint fit of the same runs, and of others that the chain leaves out.
    """
    known = fit.values
    errors = {e.name: e.standard_error for e in fit.estimates()}

    def without(**held: float | None) -> Mapping[str, float]:
        forward = ForwardModel(observations, (), {**known, **held}, {}, options.amplifier, fit.options.n)
        return identify_by_paper_chain(with_predictions(observations, forward, np.zeros(0)), options, False).values

    moved: dict[str, Mapping[str, float]] = {}
    with suppress(PaperChainError):
        whole = without()
        effects = [
            name for name, spec in NONIDEALITIES.items() if known.get(name) != spec.default and name in fit.names
        ]
        moved = {name: without(**{name: NONIDEALITIES[name].default}) for name in effects}
    found = []
    for name in (n for n in chain if n in errors and known[n]):
        joint = float(known[name] or 0.0)
        parts = {effect: (whole[name] - values[name]) / joint for effect, values in moved.items() if name in values}
        parts[REST] = chain[name] / joint - 1 - sum(parts.values())
        ordered = tuple(sorted(parts.items(), key=lambda p: -abs(p[1])))
        found.append(ChainDifference(name, chain[name], joint, errors[name], ordered))
    return tuple(found)
