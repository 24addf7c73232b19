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
from app.campaign.presentation import DOES, MARKS
from app.campaign.queue import CampaignRehearsal, Conductor, first, following, of_this_bench, rehearse_campaign
from app.campaign.status import Listed
from app.cli.bench import add_fault_option
from app.cli.headless import exit_code, headless
from app.cli.run import chosen_bench
from app.common.errors import DONE, UsageError
from app.common.formatting import duration, size, uncertain
from drivers.errors import BenchError
from protocols.base.jsonable import plain
from protocols.runfile.reader import RunError


def campaign(options: argparse.Namespace) -> int:
    """`tactor-bench campaign VERB`."""
    folder, specimen = options.out or Path("runs"), options.specimen or "unnamed"
    try:
        if options.verb == "new":
            begun = Campaign.new(folder, specimen, chosen_bench(options)[0].simulated)
            return _show(begun, options.json)
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
        return _show(known, options.json)
    except (CampaignError, RunError) as error:
        raise UsageError(str(error)) from None


def _run(known: Campaign, options: argparse.Namespace) -> int:
    config, speed = chosen_bench(options)
    of_this_bench(known, config.simulated)
    line: Listed | None = first(known, options.item or "", options.hands_free, options.verb == "resume")
    conductor, on = Conductor(known), options.all or options.hands_free
    with headless(config, speed, options, [conductor], options.faults) as front:
        while line is not None:
            if not options.json:
                does = DOES[line.next].lower()
                sys.stderr.write(f"campaign of {known.specimen}: {does} {line.item.name} ({line.title})\n")
            conductor.begin(front.session, line)
            front.wait()
            if exit_code(front.session) != DONE or front.stopped.is_set() or not on:
                break
            line = following(known, line, options.hands_free)
    if not options.json:
        _show(known, as_json=False)
    return exit_code(front.session)


def _rehearse(known: Campaign, options: argparse.Namespace) -> int:
    from app.campaign.summary import believed
    from app.session.connect import connect

    config, speed = chosen_bench(options)
    try:
        with connect(config, None if config.simulated else speed) as lab:
            told = rehearse_campaign(known, lab.bench, believed(known, lab.bench.amplifier.map))
    except BenchError as error:
        raise UsageError(str(error)) from None
    print(_rehearsal_record(told) if options.json else _rehearsal_text(told))  # noqa: T201 - the command line speaks here
    return DONE


def _rehearsal_record(told: CampaignRehearsal) -> str:
    items = [{"item": item.name, **asdict(one)} for item, one in told.items]
    return json.dumps(plain({**asdict(told), "items": items}), allow_nan=False)


def _rehearsal_text(told: CampaignRehearsal) -> str:
    lines = []
    for item, one in told.items:
        volts = f"{one.lowest_specimen_v:+.0f} ... {one.highest_specimen_v:+.0f} V"
        lines.append(
            f"{item.name:10} {duration(one.duration_s):>12}  {one.entries:4} points  {one.prompts:4} prompts  {volts:>18}  "
            f"{size(one.file_bytes):>7}  closest to a limit: {one.worst}"
        )
    volts = f"{told.lowest_specimen_v:+.0f} ... {told.highest_specimen_v:+.0f} V on the specimen"
    lines.append(f"together {duration(told.duration_s)}, {told.prompts} prompts, {volts}, {size(told.file_bytes)}")
    return "\n".join([*lines, *(f"caution: {words}" for words in told.cautions)])


def _show(known: Campaign, as_json: bool) -> int:
    from app.campaign.summary import identified

    lines, found = known.listed(), identified(known)
    estimates = () if isinstance(found, str) else found.estimates
    if as_json:
        record = {"specimen": known.specimen, "simulated": known.simulated, "path": str(known.path)}
        record["identified"] = [asdict(estimate) for estimate in estimates]
        print(json.dumps(plain({**record, "items": [_record(line) for line in lines]}), allow_nan=False))  # noqa: T201
        return DONE
    print(f"campaign of {known.specimen}" + ("   SIMULATED" if known.simulated else "") + f"   {known.path}")  # noqa: T201
    for line in lines:
        print(_text(line))  # noqa: T201
    if estimates:
        print("identified so far, by the paper's chain ('tactor-bench identify' for more):")  # noqa: T201
    for estimate in estimates:
        value = uncertain(estimate.value, estimate.standard_error, estimate.unit)
        print(f"    {estimate.name}: {value}")  # noqa: T201
    return DONE


def _record(line: Listed) -> dict[str, Any]:
    estimates = {estimate.name: estimate for estimate in line.estimates}
    return {
        "item": line.item.name,
        "protocol": line.item.protocol,
        "needs": line.item.needs,
        "state": line.standing,
        "reason": line.reason,
        "accepted": line.accepted,
        "next": line.next,
        "run": line.run and str(line.run),
        "estimates": {name: asdict(estimate) for name, estimate in estimates.items()},
    }


def _text(line: Listed) -> str:
    mark = MARKS.get(line.standing, " ")
    accepted = "accepted, " if line.accepted else ""
    words = [f"{mark} {line.item.name:10} {line.standing:10} {line.title:16} {accepted}{line.reason}"]
    if line.run is not None:
        words.append(f"    {line.run.name}")
    words += [f"    {e.name}: {uncertain(e.value, e.standard_error, e.unit)}" for e in line.estimates]
    return "\n".join(words)


Options = Callable[[argparse.ArgumentParser], None]

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


def add_campaign_command(known: Any, bench_options: Options) -> None:
    """Register the command with the subparsers of the command; the options are those of `run`."""
    campaign = known.add_parser(
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
        bench_options(one)
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
