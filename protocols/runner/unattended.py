"""Unattended runs: the conditions for high voltage with nobody at the bench, each with its remedy."""

from collections.abc import Callable, Iterator

from drivers import Bench, LevelAction
from protocols.base import Protocol, UnattendedRun
from protocols.rehearsal import CannotRunError
from protocols.runner.abort_levels import MONITOR_LEVELS

COMMISSIONED = ("commissioned", "exempt")
"""States of the source in which its drives and its way to rest are known; a simulated source is exempt."""


def check_unattended(protocol: Protocol, bench: Bench, offer_stop: Callable[[], str] | None = None) -> tuple[str, str]:
    """Return the conditions of an unattended run as a sentence for its log, and the address of its stop from a phone; both may be empty.

    `offer_stop` opens the page of that address, see `RunControl`.

    Raises:
        CannotRunError: a condition is not met; the message lists each with its remedy.
        BenchError: the page for the stop cannot be opened.
    """
    run = protocol.unattended_run
    if run is None:
        return "", ""
    if missing := tuple(_missing(run, bench, offer_stop is not None)):
        raise CannotRunError("an unattended run is refused: " + "; ".join(missing))
    stop_url = offer_stop() if run.stop_from_phone and offer_stop else ""
    stop = "is enabled; its address is shown now and stored nowhere" if stop_url else "is not enabled"
    return (
        f"Unattended run. Responsible: {run.responsible}. It ends at rest after {run.longest_s:g} s at the latest. Notice of its end: "
        f"{bench.notice}. A stop from a phone {stop}"
    ), stop_url


def _missing(run: UnattendedRun, bench: Bench, offers_stop: bool) -> Iterator[str]:
    commissioning = bench.configuration.get("commissioning") or {}
    if commissioning.get("status") not in COMMISSIONED:
        yield "the source is not commissioned: run 'tactor-bench commission'"
    if why := bench.watchdog.inactive_reason:
        yield f"there is no watchdog ({why}): enable it in [watchdog] of the bench file, on a source that it can reach"
    if bench.levels.laser_lost is not LevelAction.REST:
        yield f"the abort level laser_lost has the action '{bench.levels.laser_lost}': set it to 'rest' in [levels] of the bench file"
    for kind, (level, _) in MONITOR_LEVELS.items():
        if not any(channel.kind == kind for channel in bench.channels):
            yield f"the bench has no {kind} for the abort level {level}: wire one to the card and add it to [[channels]] of the bench file"
        if (action := getattr(bench.levels, level)) is not LevelAction.REST:
            yield f"the abort level {level} has the action '{action}': set it to 'rest' in [levels] of the bench file"
    if not run.longest_s:
        yield "no longest duration is stated: set longest_s"
    if not run.responsible:
        yield "no responsible person is stated: set responsible to a name and how to reach the person"
    if run.stop_from_phone and not offers_stop:
        yield "this program has no page for a stop from a phone: start the run by 'tactor-bench', or set stop_from_phone to false"
    if not bench.notice:
        yield "nobody is told of its end: start the program with --after-run and a command that sends a message"
