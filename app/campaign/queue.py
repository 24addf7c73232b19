"""Runs or rehearses a campaign on a session, independent of the front end."""

import typing
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError, CampaignItem
from app.campaign.specimen_mass import with_specimen_mass
from app.campaign.status import ItemState, ItemStatus, NextAction
from app.identification import reference_model
from app.session import RunRejected, SessionEvent
from drivers import Bench, BenchError
from model import Tactor
from protocols import Rehearsal, check_disk_space, rehearse
from protocols.base import RunEnded, RunStarted
from protocols.runner import RunRequest


class RunStarter(typing.Protocol):
    """The part of a session that starts runs."""

    def run(self, request: RunRequest) -> None: ...


class CampaignRunner:
    """Starts the runs of a campaign, and observes the session that makes them.

    ::

        runner = CampaignRunner(campaign)
        session = Session(connect, [runner, ...], operator)
        runner.start(session, campaign.next_item())
    """

    def __init__(self, campaign: Campaign) -> None:
        self.campaign = campaign
        self._active_item = ""

    def prepare(self, state: ItemState) -> RunRequest:
        """Return the request for an item's run, new or resumed. Reads files.

        Raises:
            CampaignError: the protocol is unknown, or rejects its settings.
            RunReadError: the run cannot be resumed.
        """
        item, specimen, folder = state.item, self.campaign.specimen, self.campaign.path.parent
        if state.next_action is NextAction.RESUME and state.resumed_run is not None:
            request = RunRequest.resuming(state.resumed_run, folder)
        else:
            request = RunRequest(self.campaign.protocol_for(state.step or item), folder, specimen)
        reference = reference_model(folder, specimen)
        prepare = with_specimen_mass(item.prepare, folder, specimen)
        return replace(request, specimen=specimen, prepare=prepare, item=item.name, reference=reference)

    def submit(self, session: RunStarter, request: RunRequest) -> None:
        """Submit a run to the session and return immediately."""
        self._active_item = request.item
        session.run(request)

    def start(self, session: RunStarter, state: ItemState) -> None:
        """Prepare and submit an item's run; raises the errors of `prepare`."""
        self.submit(session, self.prepare(state))

    def __call__(self, event: SessionEvent) -> None:
        match event:
            case RunStarted():
                self.campaign.run_started(Path(event.path), self._active_item)
            case RunEnded() | RunRejected():
                self._active_item = ""
                self.campaign.run_ended()


def check_bench_kind(campaign: Campaign, simulated: bool) -> None:
    """Reject a bench of the other kind, real or simulated.

    Raises:
        CampaignError: simulated and real runs would be mixed.
    """
    if campaign.simulated != simulated:
        kind = "a simulated bench" if campaign.simulated else "a real bench"
        raise CampaignError(f"the campaign of {campaign.specimen} is of {kind}; give that with --bench")


def first_item(campaign: Campaign, name: str = "", hands_free: bool = False, resume: bool = False) -> ItemState:
    """Return the item to start with: the named one, or the next.

    Raises:
        CampaignError: nothing is left to measure, or this item cannot be measured now.
    """
    if name:
        line = campaign.item_state(name)
        if line.next_action is NextAction.NONE:
            how = "take it in again" if line.status is ItemStatus.SKIPPED else "'repeat' measures it again"
            raise CampaignError(f"{name} is {line.status}: {line.reason}; {how}")
        if line.next_action is NextAction.WAIT:
            raise CampaignError(f"{name} has to wait: it is {line.status}, {line.reason}")
    elif resume:
        broken = [line for line in campaign.item_states() if line.next_action is NextAction.RESUME]
        if not broken:
            raise CampaignError(
                "no item was interrupted, so there is nothing to resume; 'campaign run' measures the next item"
            )
        line = broken[0]
    elif (item := campaign.next_item(hands_free)) is not None:
        line = item
    else:
        left = [line.item.name for line in campaign.item_states() if line.next_action is not NextAction.NONE]
        hands = f"without hands; left: {', '.join(left)}" if left else "any more"
        raise CampaignError(f"there is nothing to do {hands}")
    if resume and line.next_action is not NextAction.RESUME:
        raise CampaignError(f"{line.item.name} was not interrupted (it is {line.status}: {line.reason})")
    return line


def next_item_after(campaign: Campaign, previous: ItemState, hands_free: bool) -> ItemState | None:
    """Return the item after a completed run; None if it is the same again, because its checks failed.

    A series continues with values that were never measured.
    """
    line = campaign.next_item(hands_free)
    if line is None or line.item.name != previous.item.name:
        return line
    return next_value(line)


def next_value(state: ItemState) -> ItemState | None:
    """Return the state of a series with an unmeasured value; None for a complete series, and for a single run."""
    return state if state.step is not None and state.next_action is NextAction.RUN else None


@dataclass(frozen=True, slots=True)
class CampaignRehearsal:
    """Rehearsals of the items of a campaign, with totals of the measurable ones."""

    items: tuple[tuple[CampaignItem, Rehearsal], ...]
    refusals: tuple[tuple[CampaignItem, str], ...]
    """Items that the bench cannot measure, each with the reason."""
    duration_s: float
    prompts: int
    highest_specimen_v: float
    lowest_specimen_v: float
    file_bytes: int
    cautions: tuple[str, ...]


def rehearse_campaign(
    campaign: Campaign, bench: Bench, tactor: Tactor | None = None, states: Iterable[ItemState] | None = None
) -> CampaignRehearsal:
    """Rehearse the remaining items of a campaign, or `states`.

    Raises:
        BenchError: the disk has no space for the files.
        CampaignError: an item's protocol is unknown, or rejects its settings.
    """
    rehearsals: list[tuple[CampaignItem, Rehearsal]] = []
    refusals: list[tuple[CampaignItem, str]] = []
    for line in campaign.item_states() if states is None else states:
        if line.next_action is NextAction.NONE:
            continue
        try:
            one = _join([_rehearse_item(campaign, item, bench, tactor) for item in line.pending or (line.item,)])
        except BenchError as error:
            refusals.append((line.item, str(error)))
            continue
        rehearsals.append((line.item, one))
    whole = CampaignRehearsal(tuple(rehearsals), tuple(refusals), **_totals([one for _, one in rehearsals]))
    check_disk_space(whole.file_bytes, campaign.path.parent)
    return whole


def _rehearse_item(campaign: Campaign, item: CampaignItem, bench: Bench, tactor: Tactor | None) -> Rehearsal:
    protocol = campaign.protocol_for(item)
    meters, channels = bench.meters, bench.channels
    one = rehearse(protocol, bench.amplifier, sensor=bench.sensor, tactor=tactor, meters=meters, channels=channels)
    # High voltage is switched off and on once more around manual preparation.
    hands = protocol.high_voltage and any(prompt.hands_on for prompt in item.prepare)
    return replace(one, prompts=one.prompts + len(item.prepare) + 2 * hands)


def _join(parts: Sequence[Rehearsal]) -> Rehearsal:
    """Return the rehearsal of several runs as one."""
    return replace(parts[0], entries=sum(one.entries for one in parts), **_totals(parts))


def _totals(parts: Sequence[Rehearsal]) -> dict[str, Any]:
    """Return the totals of several rehearsals, by name."""
    return {
        "duration_s": sum(one.duration_s for one in parts),
        "prompts": sum(one.prompts for one in parts),
        "highest_specimen_v": max((one.highest_specimen_v for one in parts), default=0.0),
        "lowest_specimen_v": min((one.lowest_specimen_v for one in parts), default=0.0),
        "file_bytes": sum(one.file_bytes for one in parts),
        "cautions": tuple(dict.fromkeys(text for one in parts for text in one.cautions)),
    }
