"""What `tactor-bench campaign` does.

The parser of `tactor-bench campaign`. What it runs is imported when it runs.
"""

import argparse
import json
import sys
from collections.abc import Callable
from dataclasses import asdict
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
from app.cli.bench import add_fault_option
from app.cli.headless import exit_code, headless_session
from app.cli.run import selected_bench
from app.common.errors import ExitCode, UsageError
from app.common.formatting import format_bytes, format_duration, format_uncertain
from drivers.errors import BenchError
from protocols.base.jsonable import to_jsonable
from protocols.runfile.reader import RunReadError


def campaign(options: argparse.Namespace) -> int:
    """`tactor-bench campaign VERB`."""
    folder, specimen = options.out or Path("runs"), options.specimen or "unnamed"
    try:
        if options.verb == "new":
            begun = Campaign.create(folder, specimen, selected_bench(options)[0].simulated)
            return _print_campaign(begun, options.json)
        known = Campaign.open(folder, specimen)
        match options.verb:
            case "rehearse":
                return _rehearse(known, options)
            case "run" | "resume":
                return _run(known, options)
            case "skip":
                known.skip(options.item, options.reason)
            case "accept":
                known.accept(options.item)
            case "repeat":
                known.repeat(options.item)
            case "reject":
                known.reject(options.item)
            case "move":
                known.move(options.item, options.before)
        return _print_campaign(known, options.json)
    except (CampaignError, RunReadError) as error:
        raise UsageError(str(error)) from None


def _run(campaign_: Campaign, options: argparse.Namespace) -> int:
    config, speed = selected_bench(options)
    check_bench_kind(campaign_, config.simulated)
    line: ItemState | None = first_item(campaign_, options.item or "", options.hands_free, options.verb == "resume")
    conductor, on = CampaignRunner(campaign_), options.all or options.hands_free
    with headless_session(config, speed, options, [conductor], options.faults) as front:
        while line is not None:
            if not options.json:
                does = ACTION_LABELS[line.next_action].lower()
                sys.stderr.write(f"campaign of {campaign_.specimen}: {does} {line.item.name} ({line.title})\n")
            conductor.start(front.session, line)
            front.wait()
            if exit_code(front.session) != ExitCode.DONE or front.interrupted.is_set() or not on:
                break
            line = next_item_after(campaign_, line, options.hands_free)
    if not options.json:
        _print_campaign(campaign_, as_json=False)
    return exit_code(front.session)


def _rehearse(campaign_: Campaign, options: argparse.Namespace) -> int:
    from app.campaign.summary import identified_tactor
    from app.session.connect import connect

    config, speed = selected_bench(options)
    try:
        with connect(config, None if config.simulated else speed) as lab:
            told = rehearse_campaign(campaign_, lab.bench, identified_tactor(campaign_, lab.bench.amplifier.map))
    except BenchError as error:
        raise UsageError(str(error)) from None
    print(_rehearsal_record(told) if options.json else _rehearsal_text(told))  # noqa: T201 - the command line speaks here
    return ExitCode.DONE


def _rehearsal_record(rehearsal: CampaignRehearsal) -> str:
    items = [{"item": item.name, **asdict(one)} for item, one in rehearsal.items]
    return json.dumps(to_jsonable({**asdict(rehearsal), "items": items}), allow_nan=False)


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
        print(json.dumps(to_jsonable({**record, "items": [_item_record(line) for line in lines]}), allow_nan=False))  # noqa: T201
        return ExitCode.DONE
    print(  # noqa: T201
        f"campaign of {campaign_.specimen}" + ("   SIMULATED" if campaign_.simulated else "") + f"   {campaign_.path}"
    )
    for line in lines:
        print(_item_text(line))  # noqa: T201
    if estimates:
        print("identified so far, by the paper's chain ('tactor-bench identify' for more):")  # noqa: T201
    for estimate in estimates:
        value = format_uncertain(estimate.value, estimate.standard_error, estimate.unit)
        print(f"    {estimate.name}: {value}")  # noqa: T201
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


AddOptions = Callable[[argparse.ArgumentParser], None]

VERBS: dict[str, tuple[str, str]] = {
    "new": ("begin a campaign of a specimen: the paper's measurements in their order", ""),
    "status": ("what is done, stale, missing or failed, and what comes next", ""),
    "rehearse": ("go through what is left without moving anything: time, prompts, volts, bytes", ""),
    "run": ("measure the next item, or the one that is named", "ITEM"),
    "resume": ("go on with the item that was broken off", "ITEM"),
    "skip": ("leave an item out", "ITEM!"),
    "repeat": ("measure an item again: its runs until now do not count", "ITEM!"),
    "accept": ("say that what the run of an item found has been looked at and is taken", "ITEM!"),
    "reject": ("do not accept the run of an item that counts now", "ITEM!"),
    "move": ("put an item before another one", "ITEM!"),
}


def add_campaign_command(subparsers: Any, add_bench_options: AddOptions) -> None:
    """Register the command with the subparsers of the command; the options are those of `run`."""
    campaign = subparsers.add_parser(
        "campaign",
        help="the measurements of one specimen in their order: new, status, run, resume ...",
        description="All measurements of one specimen, each after what it is based on. How they stand is read from the run "
        "files; a campaign can be stopped, killed and gone on with at any time.",
        epilog="example: tactor-bench campaign new --specimen T7 && tactor-bench campaign run --all --specimen T7",
    )
    verbs = campaign.add_subparsers(title="what to do", metavar="VERB", required=True, parser_class=type(campaign))
    for verb, (words, item) in VERBS.items():
        one = verbs.add_parser(
            verb,
            help=words,
            description=f"{words[0].upper()}{words[1:]}.",
            epilog=f"example: tactor-bench campaign {verb} {'dwell ' if item else ''}--specimen T7",
        )
        add_bench_options(one)
        if item:
            one.add_argument("item", nargs=None if item.endswith("!") else "?", help="name of the item, as in 'status'")
        one.add_argument("--json", action="store_true", help="one JSON object on standard output, SI units")
        if verb in ("run", "resume"):
            one.add_argument("--all", action="store_true", help="go on with what comes next until all is done")
            one.add_argument(
                "--hands-free", action="store_true", help="like --all, but only what nobody must touch the specimen for"
            )
            add_fault_option(one)
        if verb == "skip":
            one.add_argument("--reason", default="skipped", help="why; kept in the campaign. '' takes it in again")
        if verb == "move":
            one.add_argument("--before", required=True, metavar="ITEM", help="the item it shall stand before")
        one.set_defaults(command=_campaign, verb=verb)


def _campaign(options: argparse.Namespace) -> int:

    return campaign(options)
