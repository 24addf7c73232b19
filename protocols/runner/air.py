"""Temperature and humidity of the air through a run, from further inputs of the card or from a serial sensor beside it."""

import math
import threading
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from drivers import DISPLACEMENT_CHANNEL, HIGHEST_C, LOWEST_C, AbandonableThread, Bench, BenchError, Block, Scale
from protocols.base import AIR_KINDS, AirTarget, EstimatedQuantity, FurtherInputs, Prompt, Recording

if TYPE_CHECKING:
    from drivers import Clock, EnvironmentReading, EnvironmentSensor, InputChannel

MOST_SCANS = 10_000
"""Most scans of a recording that are averaged."""

PLAUSIBLE = {"temperature": (LOWEST_C, HIGHEST_C), "humidity": (0.0, 1.0)}
"""Values of laboratory air, °C and 1; a sensor that is not connected shows others."""

LONGEST_WAIT_S = 0.05
"""Longest wait of a run for a reading under way, bench seconds: a block of the card."""

SET_CHAMBER = "set-chamber"
"""Action of the prompt to set a climate chamber."""

FRESH_S = 10.0
"""Age beyond which a reading of a serial sensor no longer counts, bench seconds."""

POLL_S, LONGEST_END_S = 0.005, 4.0
"""Real time between looks at a reading under way, and at most at the end of a run."""

JUDGED_S = 2.0
"""Interval between the judgements of a wait for a temperature."""


class AirWait:
    """Wait of a run for a temperature of the air."""

    def __init__(self, target: AirTarget, now_s: float) -> None:
        self._target, self._begin_s, self._now_s = target, now_s, now_s
        self._near_since_s = math.inf
        self._seen = "without a reading"

    def is_over(self, now_s: float, celsius: float | None) -> bool:
        """Take a reading, or its absence; return whether the temperature has been near for long enough.

        Raises:
            BenchError: the wait is too long.
        """
        target, self._now_s = self._target, now_s
        self._seen = "without a reading" if celsius is None else f"{celsius:.2f} °C"
        near = celsius is not None and abs(celsius - target.celsius) <= target.within_k
        self._near_since_s = min(self._near_since_s, now_s) if near else math.inf
        if near and now_s - self._near_since_s >= target.steady_s:
            return True
        if self.left_s <= 0:
            raise BenchError(
                f"the air was not at {target} within {target.longest_s:g} s (now {self._seen}); check chamber and sensor, or raise "
                "air_longest_s or air_within_k"
            )
        return False

    @property
    def is_near(self) -> bool:
        """Whether the last reading was near."""
        return math.isfinite(self._near_since_s)

    @property
    def left_s(self) -> float:
        """Longest time that the wait may still take."""
        return self._begin_s + self._target.longest_s - self._now_s

    @property
    def text(self) -> str:
        """What is waited for, the last reading, and for how long it has been near, as a line."""
        near_s = max(self._now_s - self._near_since_s, 0.0)
        return f"{self._target}: {self._seen}, within for {near_s:.0f} s, after {self._now_s - self._begin_s:.0f} s"


def chamber_prompt(target: AirTarget) -> Prompt:
    """Return the prompt to set a climate chamber by hand."""
    text = f"Set the chamber, or the room, to {target.celsius:g} °C. The specimen stays at rest; do not touch it."
    return Prompt(SET_CHAMBER, text, {"temperature_c": target.celsius})


class SensorPolling:
    """Reads a serial sensor, each time in a thread of its own: neither its silence nor its errors reach the run.

    On a virtual clock, on which nothing passes meanwhile, the run waits for each reading of a sensor that answers.
    """

    def __init__(self, sensor: "EnvironmentSensor", clock: "Clock") -> None:
        self._sensor, self._clock = sensor, clock
        self._thread: threading.Thread | None = None
        self._latest: tuple[float, EnvironmentReading] | None = None
        self.name, self.problem = str(sensor.identity), ""
        """Reason why the last reading failed; empty if it did not."""

    def request(self) -> None:
        """Begin a reading, unless one is under way."""
        if self._thread is None or not self._thread.is_alive():
            self._thread = AbandonableThread(target=self._read, name="sensor of the air", daemon=True)
            self._thread.start()

    def _read(self) -> None:
        try:
            reading = self._sensor.read()
        except Exception as error:  # noqa: BLE001 - also of a plug-in: it is a gap, never the end of a run
            self.problem = str(error) or type(error).__name__
        else:
            self._latest, self.problem = (self._clock.now(), reading), ""

    def latest(self) -> "EnvironmentReading | None":
        """Return the last reading; None if it failed or is too old."""
        until_s = self._clock.now() + LONGEST_WAIT_S
        while (thread := self._thread) and thread.is_alive() and not self.problem and self._clock.now() < until_s:
            thread.join(POLL_S)
        if (latest := self._latest) is None or self.problem or self._clock.now() - latest[0] > FRESH_S:
            return None
        return latest[1]

    def close(self) -> None:
        """Wait for the reading under way; one that does not return is left behind."""
        if isinstance(self._thread, AbandonableThread):
            self._thread.join(LONGEST_END_S)
            self._thread.given_up = self._thread.is_alive()


def mean_air(recordings: Sequence[Recording]) -> Mapping[str, float]:
    """Return the mean of each column (AIR_COLUMNS) over recordings, NaN without a reading; empty without sensors."""
    names = dict.fromkeys(name for each in recordings for name in each.air)
    seen = {n: [v for each in recordings if not math.isnan(v := each.air.get(n, math.nan))] for n in names}
    return {name: math.fsum(values) / len(values) if values else math.nan for name, values in seen.items()}


def air_columns(bench: Bench) -> tuple[str, ...]:
    """Return the columns of the points (AIR_COLUMNS) that the sensors of a bench give."""
    kinds = {channel.kind for channel in bench.channels}
    return tuple(f"air_{kind}" for kind in AIR_KINDS if kind in kinds or bench.environment is not None)


class AirReadings:
    """Readings of the sensors of the air in each recording of a run; an input of the card takes precedence."""

    def __init__(self, bench: Bench) -> None:
        self._bench, self._columns = bench, air_columns(bench)
        self._polling = SensorPolling(bench.environment, bench.clock) if bench.environment is not None else None
        self._values: dict[str, list[float]] = {}
        self._errors: dict[str, float] = {}
        self._names: dict[str, str] = {}
        self._lost = False

    def request(self) -> None:
        """Begin a reading of the serial sensor, at the begin of a recording or of a wait."""
        if self._polling is not None:
            self._polling.request()

    def read(self, inputs: FurtherInputs, rows: tuple[int, int]) -> tuple[dict[str, float], list[str]]:
        """Return the values of a recording by column, NaN without a reading, and what is wrong with a sensor, or right again."""
        found, messages = dict.fromkeys(self._columns, math.nan), list[str]()
        rows = max(rows[0], rows[1] - MOST_SCANS), rows[1]
        seen = {kind: signal for kind in AIR_KINDS if (signal := inputs.signal(rows, kind)) is not None}
        for kind, signal in seen.items():
            channel = signal.channel
            value, error = channel.reading(float(np.mean(signal.values)))
            if reason := _implausible(kind, value, channel):
                messages.append(
                    f"{reason}: this recording is left out; check the sensor's cable, and the channel {channel.name}"
                )
            else:
                found[f"air_{kind}"] = value
                self._keep(kind, value, channel.name, error)
        if self._polling is not None and len(seen) < len(AIR_KINDS):
            messages += self._add_polled(self._polling, found)
        return found, messages

    def _add_polled(self, polling: SensorPolling, found: dict[str, float]) -> Iterator[str]:
        """Add the last reading of the serial sensor for what no input of the card measures."""
        reading = polling.latest()
        if reading is None and not self._lost:
            why = polling.problem or "no answer yet"
            yield f"The sensor of the air gives no reading ({why}): points are without it until it answers"
        elif reading is not None and self._lost:
            yield "The sensor of the air answers again"
        self._lost = reading is None
        values = (None, None) if reading is None else (reading.temperature_c, reading.humidity)
        for kind, value in zip(AIR_KINDS, values, strict=True):
            if value is not None and math.isnan(found[f"air_{kind}"]):
                found[f"air_{kind}"] = value
                stated = self._bench.configuration.get("environment", {}).get("uncertainty_k", 0.0)
                self._keep(kind, value, polling.name, stated if kind == AIR_KINDS[0] else 0.0)

    def _keep(self, kind: str, value: float, name: str, error: float) -> None:
        self._values.setdefault(kind, []).append(value)
        self._names[kind], self._errors[kind] = name, error

    def present_c(self, block: Block, scales: Sequence[Scale]) -> float | None:
        """Return the present temperature, degrees Celsius, by the card's last block or the serial sensor; None without a reading."""
        for at, channel in enumerate(self._bench.channels, DISPLACEMENT_CHANNEL + 1):
            if channel.kind == AIR_KINDS[0]:
                value, _ = channel.reading(float(np.mean(channel.values(scales[at].to_volts(block.raw[at])))))
                return None if _implausible(channel.kind, value, channel) else value
        reading = None if self._polling is None else self._polling.latest()
        return None if reading is None else reading.temperature_c

    def estimates(self) -> tuple[EstimatedQuantity, ...]:
        """Return the means over the recordings; their errors are the scatter, with drift, and the stated error of the gain."""
        found = []
        for kind, values in self._values.items():
            error = math.hypot(float(np.std(values)), self._errors[kind])
            source = f"{self._names[kind]}, mean of {len(values)} recordings, {min(values):.4g} to {max(values):.4g}"
            found.append(EstimatedQuantity.listed(f"air_{kind}", float(np.mean(values)), error, source))
        return tuple(found)

    def close(self) -> None:
        """End the reading of the serial sensor."""
        if self._polling is not None:
            self._polling.close()


def _implausible(kind: str, value: float, channel: "InputChannel") -> str:
    low, high = PLAUSIBLE[kind]
    if low <= value <= high:
        return ""
    unit = "°C" if kind == AIR_KINDS[0] else channel.unit
    return f"The {kind} at {channel.terminal} reads {value:.4g} {unit}, expected {low:g} to {high:g}"
