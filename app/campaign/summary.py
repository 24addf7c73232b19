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
from app.campaign.status import Listed, Next, Standing
from app.config.tables import AmplifierTable
from app.identification.identify import Identified, identify
from app.identification.observations import ObservingError
from drivers.errors import BenchError
from model.amplifier_map import AmplifierMap
from model.identification.fit_options import Setting
from model.identification.paper_chain import ChainError
from model.parameter_spec import ParameterError
from model.parameters import Tactor
from protocols.base.records import Estimate
from protocols.rehearsal import Rehearsal
from protocols.runfile.reader import Run, RunError

if TYPE_CHECKING:
    from drivers.bench.bench import Bench
    from model.identification.calibration import Estimate as ModelEstimate


@dataclass(frozen=True, slots=True)
class Row:
    """One item."""

    line: Listed
    hands: bool
    """Whether a person must touch something for it."""
    carried: tuple[Estimate, ...] = ()
    """Accepted by now of what it rests on."""
    told: Rehearsal | None = None
    """What it will ask of the bench; None where nothing is left to do, or there is no bench."""

    @property
    def name(self) -> str:
        return self.line.item.name

    @property
    def pending(self) -> bool:
        """Done, and nobody has accepted yet what it found."""
        return self.line.standing is Standing.DONE and not self.line.accepted

    @property
    def state(self) -> str:
        """How it stands, in words."""
        if self.line.standing is Standing.DONE:
            return "done, accepted" if self.line.accepted else "done, to be accepted"
        return str(self.line.standing)


@dataclass(frozen=True, slots=True)
class Sheet:
    """A campaign at one moment."""

    path: Path
    specimen: str
    simulated: bool
    rows: tuple[Row, ...]
    next: Row | None
    """What can be done now."""
    free: Row | None
    """What can be done now without hands."""
    refusal: str = ""
    """Why the bench cannot do what is left; empty where it can, or where there is no bench."""
    can_undo: bool = False
    can_redo: bool = False

    def row(self, name: str) -> Row | None:
        return next((row for row in self.rows if row.name == name), None)

    @property
    def pending(self) -> Row | None:
        """The first item whose result waits to be accepted."""
        return next((row for row in self.rows if row.pending), None)

    @property
    def done(self) -> int:
        return sum(row.line.standing is Standing.DONE for row in self.rows)

    @property
    def wanted(self) -> int:
        """How many items are not left out."""
        return sum(row.line.standing is not Standing.SKIPPED for row in self.rows)

    @property
    def left(self) -> tuple[Rehearsal, ...]:
        """What is still to be done, where the bench was asked."""
        return tuple(row.told for row in self.rows if row.told is not None)

    def left_s(self, but: str = "") -> float:
        """Bench time that is still needed, without one item."""
        return sum(row.told.duration_s for row in self.rows if row.told is not None and row.name != but)


@dataclass(frozen=True, slots=True)
class Known:
    """What the runs of a campaign tell together about the specimen."""

    estimates: tuple[ModelEstimate, ...]
    tactor: Tactor
    why_not: str = ""
    """Why they tell nothing, or not more."""


def sheet_of(campaign: Campaign, bench: Bench | None) -> Sheet:
    """The campaign now. Reads run files.

    Raises:
        CampaignError: an item's protocol is not known, or refuses its settings.
    """
    lines = campaign.listed()
    told: Mapping[str, Rehearsal] = {}
    refusal = ""
    if bench is not None:
        try:
            left = [line for line in lines if line.next is not Next.NOTHING]
            told = {item.name: one for item, one in rehearse_campaign(campaign, bench, lines=left).items}
        except (BenchError, CampaignError) as error:
            refusal = str(error)
    rows = tuple(
        Row(
            line,
            campaign.needs_hands(line.item),
            tuple(campaign.carried(line.item).values()),
            told.get(line.item.name),
        )
        for line in lines
    )
    ready = [row for row in rows if row.line.next in (Next.RUN, Next.AGAIN, Next.RESUME)]
    return Sheet(
        path=campaign.path,
        specimen=campaign.specimen,
        simulated=campaign.simulated,
        rows=rows,
        next=ready[0] if ready else None,
        free=next((row for row in ready if not row.hands), None),
        refusal=refusal,
        can_undo=campaign.can_undo,
        can_redo=campaign.can_redo,
    )


def known_of(campaign: Campaign, amplifier: AmplifierMap) -> Known:
    """What the runs that count tell together, by the paper's chain. Fits."""
    found = identified(campaign, amplifier)
    if isinstance(found, str):
        return Known((), Tactor(), found)
    return Known(tuple(found.estimates), found.tactor, " ".join(found.notes[-1:]))


def identified(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Identified | str:
    """The parameters that the runs of a campaign tell so far; a sentence where they tell none.

    The chain goes in the campaign's order: what a later run cannot tell does not take away what the earlier ones do.
    """
    runs, why = campaign.counting(), "no run of this campaign counts yet"
    for last in range(len(runs), 0, -1):
        try:
            found = identify(runs[:last], "chain", Setting(amplifier=amplifier or _amplifier_of(runs[0])))
        except (RunError, ObservingError, ChainError, ParameterError) as error:
            why = str(error)
        else:
            return found if last == len(runs) else replace(found, notes=(*found.notes, why))
    return why


def _amplifier_of(path: Path) -> AmplifierMap:
    """The amplifier as it was in a run: its map is copied into every run file."""
    with Run(path) as run:
        return AmplifierTable.of(run.configuration).map


def believed(campaign: Campaign, amplifier: AmplifierMap | None = None) -> Tactor:
    """The specimen as far as it is known: what was identified, and the paper's Table I for the rest."""
    found = identified(campaign, amplifier)
    return Tactor() if isinstance(found, str) else found.tactor
