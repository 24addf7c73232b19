"""The command `campaign`: the measurements of one specimen in their order."""

import argparse
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

from app.campaign.campaign import Campaign
from app.campaign.plan import CampaignError
from app.campaign.presentation import ACTION_LABELS, STATUS_MARKS
from app.campaign.queue import (
    CampaignRehearsal,
    CampaignRunner,
    check_bench_kind,
    first_item,
    next_item_after,
    rehearse_campaign,
)
from app.campaign.status import ItemState
from app.cli.headless import exit_code, headless_session, select_bench
from app.cli.options import BenchOptions, define_command, faults_option, option, switch
from app.cli.output import print_json, print_line
from app.common.errors import ExitCode, UsageError
from app.common.formatting import format_bytes, format_duration, format_uncertain
from drivers import BenchError
from protocols.runfile.reader import RunReadError


@dataclass(frozen=True)
class CampaignOptions(BenchOptions):
    """Options of `campaign new`, `status` and `rehearse`."""

    json: bool = switch("--json", "one JSON object on standard output, SI units")


@dataclass(frozen=True)
class ItemOptions(CampaignOptions):
    """Options of the verbs for one item."""

    item: str = option(help="name of the item, as in 'status'")


@dataclass(frozen=True)
class SkipOptions(ItemOptions):
    """Options of `campaign skip`."""

    reason: str = option("--reason", default="skipped", help="why; kept in the campaign. '' takes it in again")


@dataclass(frozen=True)
class MoveOptions(ItemOptions):
    """Options of `campaign move`."""

    before: str = option("--before", required=True, metavar="ITEM", help="the item it shall stand before")


@dataclass(frozen=True)
class RunItemOptions(CampaignOptions):
    """Options of `campaign run` and `resume`."""

    item: str = option(nargs="?", default="", help="name of the item, as in 'status'")
    all: bool = switch("--all", "go on with what comes next until all is done")
    hands_free: bool = switch("--hands-free", "like --all, but only what nobody must touch the specimen for")
    faults: Sequence[str] = faults_option()


def campaign(verb: str, options: CampaignOptions) -> int:
    """Run `tactor-bench campaign VERB`."""
    folder, specimen = options.out or Path("runs"), options.specimen or "unnamed"
    try:
        if verb == "new":
            return _print_campaign(
                Campaign.create(folder, specimen, select_bench(options).config.simulated), options.json
            )
        known = Campaign.open(folder, specimen)
        match options:
            case RunItemOptions():
                return _run(known, options, verb == "resume")
            case SkipOptions():
                known.skip(options.item, options.reason)
            case MoveOptions():
                known.move(options.item, options.before)
            case ItemOptions():
                {"accept": known.accept, "repeat": known.repeat, "reject": known.reject}[verb](options.item)
            case _ if verb == "rehearse":
                return _rehearse(known, options)
        return _print_campaign(known, options.json)
    except (CampaignError, RunReadError) as error:
        raise UsageError(str(error)) from None


def _run(campaign_: Campaign, options: RunItemOptions, resume: bool) -> int:
    bench = select_bench(options)
    check_bench_kind(campaign_, bench.config.simulated)
    line: ItemState | None = first_item(campaign_, options.item, options.hands_free, resume)
    conductor, on = CampaignRunner(campaign_), options.all or options.hands_free
    with headless_session(bench, options.json, [conductor], options.faults) as front:
        while line is not None:
            if not options.json:
                action = ACTION_LABELS[line.next_action].lower()
                sys.stderr.write(f"campaign of {campaign_.specimen}: {action} {line.item.name} ({line.title})\n")
            conductor.start(front.session, line)
            front.wait()
            if exit_code(front.session) != ExitCode.DONE or front.interrupted.is_set() or not on:
                break
            line = next_item_after(campaign_, line, options.hands_free)
    if not options.json:
        _print_campaign(campaign_, as_json=False)
    return exit_code(front.session)


def _rehearse(campaign_: Campaign, options: CampaignOptions) -> int:
    from app.campaign.summary import identified_tactor
    from app.session.connect import connect

    bench = select_bench(options)
    try:
        with connect(bench.config, None if bench.config.simulated else bench.speed) as lab:
            rehearsal = rehearse_campaign(campaign_, lab.bench, identified_tactor(campaign_, lab.bench.amplifier.map))
    except BenchError as error:
        raise UsageError(str(error)) from None
    if options.json:
        items = [{"item": item.name, **asdict(one)} for item, one in rehearsal.items]
        print_json({**asdict(rehearsal), "items": items})
    else:
        print_line(_rehearsal_text(rehearsal))
    return ExitCode.DONE


def _rehearsal_text(rehearsal: CampaignRehearsal) -> str:
    lines = []
    for item, one in rehearsal.items:
        volts = f"{one.lowest_specimen_v:+.0f} ... {one.highest_specimen_v:+.0f} V"
        lines.append(
            f"{item.name:10} {format_duration(one.duration_s):>12}  {one.entries:4} points  {one.prompts:4} prompts  {volts:>18}  "
            f"{format_bytes(one.file_bytes):>7}  closest to a limit: {one.worst}"
        )
    volts = f"{rehearsal.lowest_specimen_v:+.0f} ... {rehearsal.highest_specimen_v:+.0f} V on the specimen"
    lines.append(
        f"together {format_duration(rehearsal.duration_s)}, {rehearsal.prompts} prompts, {volts}, {format_bytes(rehearsal.file_bytes)}"
    )
    return "\n".join([*lines, *(f"caution: {words}" for words in rehearsal.cautions)])


def _print_campaign(campaign_: Campaign, as_json: bool) -> int:
    from app.campaign.summary import identify_campaign_runs

    lines, found = campaign_.item_states(), identify_campaign_runs(campaign_)
    estimates = () if isinstance(found, str) else found.estimates
    if as_json:
        record = {"specimen": campaign_.specimen, "simulated": campaign_.simulated, "path": str(campaign_.path)}
        record["identified"] = [asdict(estimate) for estimate in estimates]
        print_json({**record, "items": [_item_record(line) for line in lines]})
        return ExitCode.DONE
    print_line(
        f"campaign of {campaign_.specimen}" + ("   SIMULATED" if campaign_.simulated else "") + f"   {campaign_.path}"
    )
    for line in lines:
        print_line(_item_text(line))
    if estimates:
        print_line("identified so far, by the paper's chain ('tactor-bench identify' for more):")
    for estimate in estimates:
        value = format_uncertain(estimate.value, estimate.standard_error, estimate.unit)
        print_line(f"    {estimate.name}: {value}")
    return ExitCode.DONE


def _item_record(state: ItemState) -> dict[str, Any]:
    estimates = {estimate.name: estimate for estimate in state.estimates}
    return {
        "item": state.item.name,
        "protocol": state.item.protocol,
        "needs": state.item.needs,
        "state": state.status,
        "reason": state.reason,
        "accepted": state.accepted,
        "next": state.next_action,
        "run": state.run and str(state.run),
        "estimates": {name: asdict(estimate) for name, estimate in estimates.items()},
    }


def _item_text(state: ItemState) -> str:
    mark = STATUS_MARKS.get(state.status, " ")
    accepted = "accepted, " if state.accepted else ""
    words = [f"{mark} {state.item.name:10} {state.status:10} {state.title:16} {accepted}{state.reason}"]
    if state.run is not None:
        words.append(f"    {state.run.name}")
    words += [f"    {e.name}: {format_uncertain(e.value, e.standard_error, e.unit)}" for e in state.estimates]
    return "\n".join(words)


VERBS: Mapping[str, tuple[type[CampaignOptions], str]] = {
    "new": (CampaignOptions, "begin a campaign of a specimen: the paper's measurements in their order"),
    "status": (CampaignOptions, "what is done, stale, missing or failed, and what comes next"),
    "rehearse": (CampaignOptions, "go through what is left without moving anything: time, prompts, volts, bytes"),
    "run": (RunItemOptions, "measure the next item, or the one that is named"),
    "resume": (RunItemOptions, "go on with the item that was broken off"),
    "skip": (SkipOptions, "leave an item out"),
    "repeat": (ItemOptions, "measure an item again: its runs until now do not count"),
    "accept": (ItemOptions, "say that what the run of an item found has been looked at and is taken"),
    "reject": (ItemOptions, "do not accept the run of an item that counts now"),
    "move": (MoveOptions, "put an item before another one"),
}


def _define_campaign(parser: argparse.ArgumentParser) -> None:
    parser.description = (
        "All measurements of one specimen, each after what it is based on. How they stand is read from the run "
        "files; a campaign can be stopped, killed and gone on with at any time."
    )
    parser.epilog = "example: tactor-bench campaign new --specimen T7 && tactor-bench campaign run --all --specimen T7"
    verbs = parser.add_subparsers(title="what to do", metavar="VERB", required=True)
    for verb, (kind, text) in VERBS.items():
        item = "" if kind is CampaignOptions else "dwell "
        define_command(
            verbs.add_parser(verb, help=text),
            kind,
            partial(campaign, verb),
            f"{text[0].upper()}{text[1:]}.",
            f"example: tactor-bench campaign {verb} {item}--specimen T7",
        )


COMMANDS: Mapping[str, Callable[[argparse.ArgumentParser], None]] = {"campaign": _define_campaign}
