"""A campaign as it is shown: every item with what it found, needs and will ask, and what comes next. No Qt, no terminal.

What the runs of a campaign say together about the specimen, by the paper's chain; and what is believed of it meanwhile.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError
from app.campaign.queue import rehearse_campaign
from app.campaign.status import ItemState, ItemStatus, NextAction
from app.identification.identify import IdentificationResult, identify
from app.identification.observations import ObservationError, amplifier_of
from drivers.errors import BenchError
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import FitOptions
from model.identification.paper_chain import PaperChainError
from model.parameter_spec import ParameterError
from model.parameters import Tactor
from protocols.base.records import EstimatedQuantity
from protocols.rehearsal import Rehearsal
from protocols.runfile.reader import RunReadError

if TYPE_CHECKING:
    from drivers.bench.bench import Bench


@dataclass(frozen=True, slots=True)
class ItemSummary:
    """One item."""

    state: ItemState
    needs_operator: bool
    """Whether a person must touch something for it."""
    accepted_estimates: tuple[EstimatedQuantity, ...] = ()
    """Accepted by now of what it rests on."""
    rehearsal: Rehearsal | None = None
    """What it will ask of the bench; None where nothing is left to do, or there is no bench."""

    @property
    def name(self) -> str:
        return self.state.item.name

    @property
    def awaits_acceptance(self) -> bool:
        """Done, and nobody has accepted yet what it found."""
        return self.state.status is ItemStatus.DONE and not self.state.accepted

    @property
    def status_text(self) -> str:
        """How it stands, in words."""
        if self.state.status is ItemStatus.DONE:
            return "done, accepted" if self.state.accepted else "done, to be accepted"
        return str(self.state.status)


@dataclass(frozen=True, slots=True)
class CampaignSummary:
    """A campaign at one moment."""

    path: Path
    specimen: str
    simulated: bool
    items: tuple[ItemSummary, ...]
    next_item: ItemSummary | None
    """What can be done now."""
    next_hands_free: ItemSummary | None
    """What can be done now without hands."""
    refusal: str = ""
    """Why the bench cannot do what is left; empty where it can, or where there is no bench."""
    can_undo: bool = False
    can_redo: bool = False

    def item(self, name: str) -> ItemSummary | None:
        return next((row for row in self.items if row.name == name), None)

    @property
    def awaiting_acceptance(self) -> ItemSummary | None:
        """The first item whose result waits to be accepted."""
        return next((row for row in self.items if row.awaits_acceptance), None)

    @property
    def done_count(self) -> int:
        return sum(row.state.status is ItemStatus.DONE for row in self.items)

    @property
    def total_count(self) -> int:
        """How many items are not left out."""
        return sum(row.state.status is not ItemStatus.SKIPPED for row in self.items)

    @property
    def remaining(self) -> tuple[Rehearsal, ...]:
        """What is still to be done, where the bench was asked."""
        return tuple(row.rehearsal for row in self.items if row.rehearsal is not None)

    def remaining_s(self, excluding: str = "") -> float:
        """Bench time that is still needed, without one item."""
        return sum(
            row.rehearsal.duration_s for row in self.items if row.rehearsal is not None and row.name != excluding
        )


@dataclass(frozen=True, slots=True)
class CampaignEstimates:
    """What the runs of a campaign tell together about the specimen."""

    estimates: tuple[EstimatedQuantity, ...]
    tactor: Tactor
    problem: str = ""
    """Why they tell nothing, or not more."""


def summarize_campaign(campaign: Campaign, bench: Bench | None) -> CampaignSummary:
    """The campaign now. Reads run files.

    Raises:
        CampaignError: an item's protocol is not known, or refuses its settings.
    """
    lines = campaign.item_states()
    told: Mapping[str, Rehearsal] = {}
    refusal = ""
    if bench is not None:
        try:
            left = [line for line in lines if line.next_action is not NextAction.NONE]
            told = {item.name: one for item, one in rehearse_campaign(campaign, bench, states=left).items}
        except (BenchError, CampaignError) as error:
            refusal = str(error)
    rows = tuple(
        ItemSummary(
            line,
            campaign.needs_operator(line.item),
            tuple(campaign.accepted_estimates(line.item).values()),
            told.get(line.item.name),
        )
        for line in lines
    )
    ready = [row for row in rows if row.state.next_action in (NextAction.RUN, NextAction.REPEAT, NextAction.RESUME)]
    return CampaignSummary(
        path=campaign.path,
        specimen=campaign.specimen,
        simulated=campaign.simulated,
        items=rows,
        next_item=ready[0] if ready else None,
        next_hands_free=next((row for row in ready if not row.needs_operator), None),
        refusal=refusal,
        can_undo=campaign.can_undo,
        can_redo=campaign.can_redo,
    )


def estimate_campaign(campaign: Campaign, amplifier: AmplifierMap) -> CampaignEstimates:
    """What the runs that count tell together, by the paper's chain. Fits."""
    found = identify_campaign_runs(campaign, amplifier)
    if isinstance(found, str):
        return CampaignEstimates((), Tactor(), found)
    return CampaignEstimates(tuple(found.estimates), found.tactor, " ".join(found.notes[-1:]))


def identify_campaign_runs(campaign: Campaign, amplifier: AmplifierMap | None = None) -> IdentificationResult | str:
    """The parameters that the runs of a campaign tell so far; a sentence where they tell none.

    The chain goes in the campaign's order: what a later run cannot tell does not take away what the earlier ones do.
    """
    runs, why = campaign.valid_runs(), "no run of this campaign counts yet"
    for last in range(len(runs), 0, -1):
        try:
            found = identify(runs[:last], "chain", FitOptions(amplifier=amplifier or amplifier_of(runs[:1])))
        except (RunReadError, ObservationError, PaperChainError, ParameterError) as error:
            why = str(error)
        else:
            return found if last == len(runs) else replace(found, notes=(*found.notes, why))
    return why


def identified_tactor(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Tactor:
    """The specimen as far as it is known: what was identified, and the paper's Table I for the rest."""
    found = identify_campaign_runs(campaign, amplifier)
    return Tactor() if isinstance(found, str) else found.tactor
