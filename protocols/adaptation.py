"""Adaptation of a protocol to the source of the bench: other parameters where it cannot play the drives as they are."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from drivers import HvAmplifier
from protocols.base import Protocol


@dataclass(frozen=True, slots=True)
class AdaptedProtocol:
    """A protocol that the source can play, or the one that was requested if nothing helps.

    Attributes:
        protocol: the protocol to run.
        requested: the requested values of the parameters that were changed; empty if none was.
        message: what was changed and why; empty if nothing was.
    """

    protocol: Protocol
    requested: Mapping[str, Any] = field(default_factory=dict)
    message: str = ""


def adapt_to_source(protocol: Protocol, amplifier: HvAmplifier) -> AdaptedProtocol:
    """Return the protocol with the parameters that the source can play, nearest to the requested ones. Sends nothing."""
    rest_v = amplifier.map.rest_v
    adapted = protocol.adapted(rest_v, amplifier.reason_unsupported)
    asked, played = protocol.model_dump(mode="json"), adapted.model_dump(mode="json")
    changed = {name: value for name, value in asked.items() if played[name] != value}
    if not changed:
        return AdaptedProtocol(protocol)
    reasons = (amplifier.reason_unsupported(drive) for entry in protocol.plan(rest_v) for drive in entry.drives)
    reason = next((why for why in reasons if why), "").partition(";")[0]
    values = ", ".join(f"{name} {_text(played[name])} instead of {_text(value)}" for name, value in changed.items())
    return AdaptedProtocol(adapted, changed, f"{protocol.title} is adapted to the source: {values} ({reason})")


def _text(value: Any) -> str:
    if isinstance(value, list):
        return ", ".join(map(_text, value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)
