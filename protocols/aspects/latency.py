"""Aspects of the protocol `latency`."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

from model import SeriesAxis, quantity_label
from protocols.base import Aspects, Figure, ReferenceSpan, ResultTable, RunFigure

if TYPE_CHECKING:
    from protocols.aspects.run_points import RunPoints
    from protocols.runfile import RunRecord

FELT = "latency"
"""Prefix of the names of times to the threshold."""
BETWEEN = "rise_time, after a step"
"""Prefixes of the names of times between two moments of a response, which the sensor's delay does not shift."""

HISTORY_SHARE = 2e-3
"""Standard uncertainty of each number, as a share, by what earlier drives leave in a specimen with hysteresis and creep: times and
overshoots on the simulated bench `realistic` deviate by 0.1 to 0.3 % from those after equal onsets alone."""

TIMES_NOTE = (
    "± total standard uncertainty, with the sensor's gain and delay, and 0.2 % by the specimen's history. A step's times count from the centroid of its "
    "edge in the recorded drive, a sine's from its begin; the amplifier's own delay is part of them. Rise: 10 to 90 % of a step, "
    "from the begin to 90 % of the peak of a sine."
)
PUBLISHED_NOTE = "Times to nearly the full vibration: the rise of a sine's onset compares with them, the time to the threshold does not."


class OnsetLatencyAspects(Aspects):
    """Latency beside its measurement."""

    def run_figures(self, run: RunRecord, estimates: Sequence[RunFigure]) -> Iterator[RunFigure]:
        """Yield the estimates with the sensor's delay and gain in their total uncertainty.

        An error of the delay shifts all times from an onset. An error of the gain shifts the threshold, which the displacement
        reaches at the measured speed; shares of the final value are independent of the gain. The history of the specimen moves each.
        """
        sensor, threshold_m = run.sensor, float(run.parameters["threshold_m"])
        speeds = {f.name.rpartition(", ")[2]: f.value for f in estimates if f.unit == "m/s"}
        for figure in estimates:
            name, _, onset = figure.name.rpartition(", ")
            from_onset = figure.unit == "s" and not figure.name.startswith(BETWEEN)
            delay_s = sensor.delay_uncertainty_s if from_onset else 0.0
            timed = name.startswith(FELT) and speeds.get(onset, 0.0) > 0
            moved_s = sensor.gain_relative_uncertainty * threshold_m / speeds[onset] if timed else 0.0
            remembered = HISTORY_SHARE * abs(figure.value)
            yield figure._replace(total=math.hypot(figure.total, delay_s, moved_s, remembered))

    def figures(self, points: RunPoints) -> Iterator[Figure]:
        """Yield the responses after an onset, and the times over the frequency beside the times of other actuators."""
        from model.response import PUBLISHED_LATENCIES  # slow to import

        threshold_m = float(points.run.setup.parameters["threshold_m"])
        yield Figure(lines=points.run.series(), levels=(-threshold_m, threshold_m))
        x = SeriesAxis("frequency", "Hz", "frequency of the sine, a step at 0")
        columns = (("latency", f"time to {1e6 * threshold_m:g} µm"), ("rise", "rise: step 10 to 90 %, sine to 90 %"))
        times = tuple(points.series(x, SeriesAxis(name, "s", "time"), label) for name, label in columns)
        spans = (
            ReferenceSpan(each.low_s, each.high_s, f"{each.actuator}: {each.meaning}") for each in PUBLISHED_LATENCIES
        )
        yield Figure(times, spans=tuple(spans), log_limits=(1e-4, 0.3))

    def remarks(self, figures: Iterator[RunFigure]) -> Iterator[tuple[str, RunFigure | None]]:
        """Yield the latencies with their total uncertainty, and the published ones of other actuators."""
        from model.response import PUBLISHED_LATENCIES  # slow to import

        for figure in figures:
            if figure.name.startswith(FELT):
                yield f"{quantity_label(figure.name)}, with the uncertainty of the sensor's gain and delay", figure
        yield "published for other actuators, to nearly the full vibration:", None
        yield from ((f"  {published.description}", None) for published in PUBLISHED_LATENCIES)

    def result_tables(self, run_name: str, figures: Sequence[RunFigure]) -> Iterator[ResultTable]:
        """Yield the table of the times of each onset, and the table of other actuators."""
        from model.response import PUBLISHED_LATENCIES  # slow to import

        onsets: dict[str, dict[str, RunFigure]] = {}
        for figure in figures:
            name, _, onset = quantity_label(figure.name).rpartition(", ")
            if name and figure.unit != "m/s":
                onsets.setdefault(onset, {})[name] = figure
        names = list(dict.fromkeys(name for values in onsets.values() for name in values))
        names.sort(key=lambda name: not name.startswith(FELT))
        rows = tuple(
            (onset, *(values.get(name, "–") for name in names))
            for onset, values in sorted(onsets.items(), key=_onset_order)
        )
        yield ResultTable(f"Latency as measured ({run_name})", ("onset", *names), rows, TIMES_NOTE, "perception")
        published = tuple(
            (p.actuator, f"{'below ' if not p.low_s else ''}{_span_ms(p.low_s, p.high_s)} ms", p.meaning, p.source)
            for p in PUBLISHED_LATENCIES
        )
        heads = ("actuator", "time", "what", "source")
        yield ResultTable("Other actuators, published", heads, published, PUBLISHED_NOTE, "perception")


def _onset_order(item: tuple[str, object]) -> tuple[bool, float]:
    """Return steps before sines, each by its number."""
    return item[0].startswith("from"), float(next(word for word in item[0].split() if word[0].isdigit()))


def _span_ms(low_s: float, high_s: float) -> str:
    low, high = f"{1e3 * low_s:g}", f"{1e3 * high_s:g}"
    return high if low in ("0", high) else f"{low} to {high}"


ASPECTS = OnsetLatencyAspects()
