"""The parser of `tactor-bench campaign`. What it runs is imported when it runs."""

import argparse
from collections.abc import Callable
from typing import Any

from app.bench_parser import add_fault_option

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
    from app.campaign_commands import campaign

    return campaign(options)
