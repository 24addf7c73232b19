"""Carries a campaign out on a session, and goes through it before that. Who asks - a terminal, a window - is not known here."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

from app.campaign import Campaign
from app.campaign_plan import Item
from app.campaign_standing import Listed, Next
from app.session import Session, SessionEvent
from drivers.bench import Bench
from drivers.errors import BenchError
from model.parameters import Tactor
from protocols.continuation import earlier
from protocols.events import RunEnded, RunStarted
from protocols.rehearsal import Rehearsal, must_fit, rehearse


class Conductor:
    """Begins the runs of a campaign; an observer of the session that makes them.

    ::

        conductor = Conductor(campaign)
        session = Session(connect, [conductor, ...], operator)
        conductor.begin(session, campaign.next())
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self._present = ""

    def begin(self, session: Session, line: Listed) -> None:
        """Ask the session for an item's run, or to go on with the one that was broken off; returns at once.

        Raises:
            CampaignError: the protocol is not known any more, or refuses its settings.
            RunError: the run cannot be gone on with.
        """
        self._present = line.item.name
        before = earlier(line.run) if line.next is Next.RESUME and line.run is not None else None
        protocol = self.campaign.protocol(line.item) if before is None else before.protocol
        session.run(protocol, self.campaign.path.parent, self.campaign.specimen, before, line.item.prepare)

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case RunStarted():
                self.campaign.began(self._present, Path(event.path))
            case RunEnded():
                self.campaign.ended()


@dataclass(frozen=True, slots=True)
class CampaignRehearsal:
    """What the items of a campaign will ask of the bench together, and one by one."""

    items: tuple[tuple[Item, Rehearsal], ...]
    duration_s: float
    prompts: int
    highest_specimen_v: float
    lowest_specimen_v: float
    file_bytes: int
    cautions: tuple[str, ...]


def rehearse_campaign(
    campaign: Campaign, bench: Bench, tactor: Tactor | None = None, lines: Iterable[Listed] | None = None
) -> CampaignRehearsal:
    """Go through what is left of a campaign, or through `lines`.

    Raises:
        DriveRefused, CannotRun: an item cannot be done on this bench; the sentence names it.
        CampaignError: an item's protocol is not known, or refuses its settings.
    """
    left = campaign.listed() if lines is None else lines
    told: list[tuple[Item, Rehearsal]] = []
    prompts = 0
    for line in left:
        if lines is None and line.next is Next.NOTHING:
            continue
        protocol = campaign.protocol(line.item)
        try:
            one = rehearse(protocol, bench.amplifier, sensor=bench.sensor, tactor=tactor, meters=bench.meters)
        except BenchError as error:
            raise type(error)(f"{line.item.name}: {error}") from None
        told.append((line.item, one))
        # High voltage goes off and on once more around what hands prepare.
        hands = protocol.high_voltage and any(prompt.hands_on for prompt in line.item.prepare)
        prompts += one.prompts + len(line.item.prepare) + 2 * hands
    file_bytes = sum(one.file_bytes for _, one in told)
    must_fit(file_bytes, campaign.path.parent)
    return CampaignRehearsal(
        items=tuple(told),
        duration_s=sum(one.duration_s for _, one in told),
        prompts=prompts,
        highest_specimen_v=max((one.highest_specimen_v for _, one in told), default=0.0),
        lowest_specimen_v=min((one.lowest_specimen_v for _, one in told), default=0.0),
        file_bytes=file_bytes,
        cautions=tuple(dict.fromkeys(words for _, one in told for words in one.cautions)),
    )
