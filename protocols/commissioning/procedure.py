"""Commissioning of a bench: exercises the source, then the inputs of the card, with high voltage off."""

from collections.abc import Callable
from dataclasses import replace

from drivers import Bench, HighVoltageSwitch, ScanOrderError
from protocols.commissioning.card_inputs import NAME, SCAN_RATE_HZ, exercise_inputs, scan_order
from protocols.commissioning.messages import MessageLog
from protocols.commissioning.sequence import PLANNED_S, Commissioned, Commissioning, ProgressListener


def commission_bench(
    bench: Bench,
    switch: HighVoltageSwitch,
    rate_hz: float,
    messages: MessageLog,
    progress: ProgressListener = lambda _name, _fraction: None,
    second_client: Callable[[], float] | None = None,
    check_stop: Callable[[], object] = lambda: None,
) -> Commissioned:
    """Exercise the instruments of a bench; return what was measured.

    Args:
        bench: its source is brought to rest at the end, whatever happens.
        switch: disables high voltage; it is never enabled.
        rate_hz: scans per second while the source is exercised.
        messages: notes the messages to the source.
        progress: called with the name of each exercise as it begins, and the fraction that is done.
        second_client: connects to the instrument once more, and returns the time of its reply; None if there is none.
        check_stop: called with every block that is read; raises to abandon, with the source brought to rest.

    Raises:
        BenchError: an instrument is absent, or rejects what it must do to be set up.
    """
    with bench.exercised(rate_hz, lambda _: None, switch) as exercised:
        found = Commissioning(exercised, bench.clock, messages, progress, second_client, check_stop).run()
    if not found.plays_bursts:
        return found
    progress(NAME, 1 - PLANNED_S[NAME] / sum(PLANNED_S.values()))
    order = scan_order(2 + len(bench.channels))
    try:
        with bench.exercised(SCAN_RATE_HZ, lambda _: None, switch, order) as scanned:
            inputs = exercise_inputs(scanned, bench.clock, order, bench.amplifier.map.rest_v, check_stop)
    except ScanOrderError:  # a converter for each input: no skew, and nothing that would have to settle
        return found
    return replace(found, checks=(*found.checks, *inputs.checks), traces=(*found.traces, *inputs.traces))
