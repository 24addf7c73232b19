"""Second sample rate: whether the interference measured at rest is folded back from above half the sample rate.

The card is read once more after the run, when rest is confirmed: a line that is folded has another frequency at another rate.
"""

import numpy as np

from drivers import DISPLACEMENT_CHANNEL, Bench, BenchError
from protocols.base import ChannelCalibration, InterferenceLine, Quality
from protocols.signals import find_lines, folded_frequencies, mark_folded

SECOND_RATE_SHARE = 0.87
"""Second rate divided by the run's; no small ratio of integers, at which a folded line could stay in its place."""


def tell_folded_lines(
    bench: Bench, lines: tuple[InterferenceLine, ...], rate_hz: float, duration_s: float
) -> tuple[InterferenceLine, ...]:
    """Return the lines with the true frequencies of those that a second rate shows to be folded.

    Nothing is commanded: the displacement is read, for `duration_s`.

    Raises:
        BenchError: the card cannot be read at the second rate, or the displacement is not valid.
    """
    parts, quality, count = [], Quality.GOOD, 0
    with bench.open_stream(SECOND_RATE_SHARE * rate_hz) as stream:
        channel = ChannelCalibration.pair(stream.scales, bench.sensor)[DISPLACEMENT_CHANNEL]
        while count < duration_s * stream.rate_hz:
            counts = stream.read().raw[DISPLACEMENT_CHANNEL]
            quality |= channel.quality(counts)
            parts.append(channel.to_si(counts))
            count += counts.size
        second_rate_hz = stream.rate_hz
    if not quality.usable:
        raise BenchError(f"the displacement at rest is {quality.description}")
    seen = find_lines(np.concatenate(parts), second_rate_hz)
    return mark_folded(lines, folded_frequencies(lines, rate_hz, seen, second_rate_hz, 1 / duration_s))
