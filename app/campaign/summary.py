"""Campaign summary for display: items with status, estimates and rehearsal; parameters from all valid runs."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError
from app.campaign.queue import rehearse_campaign
from app.campaign.specimen_mass import with_specimen_mass
from app.campaign.status import ItemState, ItemStatus
from app.identification import IdentificationResult, ObservationError, SheetError, amplifier_of, identify, verdict_line
from app.session import real_duration_s
from drivers import BenchError
from model import AmplifierMap, ParameterError, Tactor
from model.identification import FitOptions, IdentificationError
from protocols import Rehearsal
from protocols.base import EstimatedQuantity, Outcome, Prompt
from protocols.runfile import RunReadError

if TYPE_CHECKING:
    from drivers import Bench


@dataclass(frozen=True, slots=True)
class ItemSummary:
    """One item."""

    state: ItemState
    needs_operator: bool
    """Whether the operator must touch something."""
    accepted_estimates: tuple[EstimatedQuantity, ...] = ()
    """Accepted estimates of its dependencies."""
    rehearsal: Rehearsal | None = None
    """Rehearsal, in bench time; None if nothing is left to do, or without a bench."""
    time_scale: float = 1.0
    """Real seconds per second of bench time, which a simulated bench may pass faster."""
    prepare: tuple[Prompt, ...] = ()
    """Set-up prompts, for this specimen."""

    @property
    def name(self) -> str:
        return self.state.item.name

    @property
    def duration_s(self) -> float | None:
        """Real time that the measurement takes; None if nothing is left to do, or without a bench."""
        return None if self.rehearsal is None else self.time_scale * self.rehearsal.duration_s

    @property
    def is_doubtful(self) -> bool:
        """Whether the run that counts has a doubtful verdict."""
        counting = "" if self.state.run is None else self.state.run.name
        return any(run.name == counting and run.outcome is Outcome.DOUBTFUL for run in self.state.results)

    @property
    def status_text(self) -> str:
        """Status as text."""
        if self.state.candidate is not None:
            return "new result, to be accepted"
        if self.state.status is ItemStatus.DONE:
            result = "doubtful" if self.is_doubtful else "done"
            return f"{result}, accepted" if self.state.accepted else f"{result}, to be accepted"
        return str(self.state.status)


@dataclass(frozen=True, slots=True)
class CampaignSummary:
    """A campaign at one moment."""

    path: Path
    specimen: str
    simulated: bool
    items: tuple[ItemSummary, ...]
    next_item: ItemSummary | None
    """Next item that can be measured."""
    next_hands_free: ItemSummary | None
    """Next item that can be measured without the operator."""
    refusal: str = ""
    """Why the bench cannot measure the rest; empty if it can, or without a bench."""
    time_scale: float = 1.0
    """Real seconds per second of bench time."""

    def item(self, name: str) -> ItemSummary | None:
        return next((row for row in self.items if row.name == name), None)

    @property
    def awaiting_acceptance(self) -> ItemSummary | None:
        """First item whose result is to be accepted."""
        return next((row for row in self.items if row.state.awaits_acceptance), None)

    @property
    def acceptable(self) -> dict[str, str]:
        """Names of the items whose results await acceptance, by the names of the run files."""
        states = ((row.name, row.state) for row in self.items)
        return {s.reviewed_run.name: name for name, s in states if s.awaits_acceptance and s.reviewed_run is not None}

    @property
    def done_count(self) -> int:
        return sum(row.state.status is ItemStatus.DONE for row in self.items)

    @property
    def total_count(self) -> int:
        """Number of items that are not skipped."""
        return sum(row.state.status is not ItemStatus.SKIPPED for row in self.items)

    @property
    def remaining(self) -> tuple[Rehearsal, ...]:
        """Rehearsals of the remaining items."""
        return tuple(row.rehearsal for row in self.items if row.rehearsal is not None)

    def remaining_s(self, excluding: str = "") -> float:
        """Return the real time still needed, without one item."""
        return sum(row.duration_s for row in self.items if row.duration_s is not None and row.name != excluding)


@dataclass(frozen=True, slots=True)
class CampaignEstimates:
    """Parameters of the specimen from all valid runs of a campaign."""

    estimates: tuple[EstimatedQuantity, ...]
    verdict: str = ""
    """Whether the model is adequate for these runs, as text."""
    problem: str = ""
    """Why there are no estimates, or not more."""


def summarize_campaign(campaign: Campaign, bench: Bench | None) -> CampaignSummary:
    """Summarize a campaign. Reads run files.

    Raises:
        CampaignError: an item's protocol is unknown, or rejects its settings.
    """
    lines = campaign.item_states()
    rehearsals: Mapping[str, Rehearsal] = {}
    refusal = ""
    if bench is not None:
        try:
            rehearsed = rehearse_campaign(campaign, bench, states=lines)
            rehearsals = {item.name: one for item, one in rehearsed.items}
            refusal = next((f"{item.name}: {reason}" for item, reason in rehearsed.refusals), "")
        except (BenchError, CampaignError) as error:
            refusal = str(error)
    time_scale = real_duration_s(1.0, bench)
    rows = tuple(
        ItemSummary(
            line,
            campaign.needs_operator(line.item),
            tuple(campaign.accepted_estimates(line.item).values()),
            rehearsals.get(line.item.name),
            time_scale,
            with_specimen_mass(line.item.prepare, campaign.path.parent, campaign.specimen),
        )
        for line in lines
    )
    ready = [row for row in rows if row.state.is_ready]
    return CampaignSummary(
        path=campaign.path,
        specimen=campaign.specimen,
        simulated=campaign.simulated,
        items=rows,
        next_item=ready[0] if ready else None,
        next_hands_free=next((row for row in ready if not row.needs_operator), None),
        refusal=refusal,
        time_scale=time_scale,
    )


def estimate_campaign(campaign: Campaign, amplifier: AmplifierMap) -> CampaignEstimates:
    """Fit the valid runs jointly: the same estimates, with total uncertainties, as by `identify`."""
    identification = identify_campaign_runs(campaign, amplifier)
    if isinstance(identification, str):
        return CampaignEstimates((), problem=identification)
    return CampaignEstimates(
        identification.identified, verdict_line(identification), "; ".join(identification.unidentified)
    )


def identify_campaign_runs(campaign: Campaign, amplifier: AmplifierMap | None = None) -> IdentificationResult | str:
    """Identify parameters from the valid runs by the joint fit; return a message if none can be identified.

    A later run that cannot be used does not invalidate earlier ones.
    """
    runs, why = campaign.valid_runs(), "no run of this campaign counts yet"
    for last in range(len(runs), 0, -1):
        try:
            identification = identify(runs[:last], options=FitOptions(amplifier=amplifier or amplifier_of(runs[:1])))
        except (RunReadError, ObservationError, IdentificationError, ParameterError, SheetError) as error:
            why = str(error)
        else:
            return identification if last == len(runs) else replace(identification, notes=(*identification.notes, why))
    return why


def identified_tactor(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Tactor:
    """Return the specimen with identified parameters, and the paper's Table I for the rest."""
    identification = identify_campaign_runs(campaign, amplifier)
    return Tactor() if isinstance(identification, str) else identification.tactor
