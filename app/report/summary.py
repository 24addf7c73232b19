"""All that is known of a specimen from its runs, before it is put into words."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.report.figures_of_merit import Felt, Merit, Quick, felt, merits_of, quick
from app.report.runs import Taken, Told
from app.report.specimen import Specimen, specimen_of
from model.identification.observations import Campaign, FrequencyResponse


@dataclass(frozen=True, slots=True)
class Known:
    """A specimen, what was observed of it, and what it is good for."""

    specimen: Specimen
    campaign: Campaign | None
    felt: tuple[Felt, ...]
    """Free, then on the membrane, at every elongation that was measured."""
    quick: Quick | None
    merits: Mapping[str, Merit]


def known_of(name: str, runs: tuple[Taken, ...], told: Told) -> Known:
    """Identify a specimen from its runs, then its margin and latency; `told` hears how far it is."""
    told("identifying", 0, 1)
    found, campaign = specimen_of(name, runs, lambda evaluations, _: told("identifying", min(evaluations, 40), 41))
    if campaign is None or found.found is None:
        return Known(found, campaign, (), None, merits_of(found, campaign, None, None, None))
    told("margins and latency", 0, 1)
    on = sorted({r.elongation_m for r in campaign.of(FrequencyResponse) if r.elongation_m is not None})
    free = felt(found, None) if found.tells_free else None
    pressed = [felt(found, elongation) for elongation in on if found.tells_on(elongation)]
    soon = quick(found) if found.tells_free else None
    merits = merits_of(found, campaign, free, pressed[-1] if pressed else None, soon)
    return Known(found, campaign, tuple(f for f in (free, *pressed) if f is not None), soon, merits)
