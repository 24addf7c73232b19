"""Connection of the specimen, seen under a small sine: short-circuited, open, broken, depolarised, or the wrong way round.

One set of checks for the wiring check, which prints it, and for a protocol that refuses higher voltages before they are applied.
"""

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from functools import partial
from typing import Annotated, Any, Self

import numpy as np
from annotated_types import Interval, Unit

from drivers import Sine
from model import Array
from protocols.base import FLOW_KINDS, ChannelSignal, CheckResult, Outcome, Protocol, Recording
from protocols.signals.electrical import ElectricalResponse, InputErrors, electrical_response
from protocols.signals.sine import fit_frequency, fit_sine

SIGNIFICANCE = 5.0
"""Standard errors of a significant value."""

Polarity = Annotated[int, Unit("1"), Interval(ge=-1, le=1), "correct sign of displacement per volt; 0: either sign"]
SmallestCapacitance = Annotated[
    float, Unit("F"), Interval(gt=0), "capacitance below which the specimen counts as not connected"
]
LargestLoss = Annotated[
    float, Unit("1"), Interval(gt=0), "loss factor of the check above which the specimen counts as short-circuited"
]
ExpectedCapacitance = Annotated[
    float, Unit("F"), Interval(ge=0), "capacitance of the specimen, by sheet; 0: of its last good run, if there is one"
]
ExpectedBending = Annotated[
    float, Unit("m/V"), Interval(ge=0), "bending per volt on the specimen; 0: of its last good run, if there is one"
]
SmallestShare = Annotated[
    float, Unit("1"), Interval(gt=0, lt=1), "smallest share of the expected capacitance and bending, and its reciprocal"
]

DIELECTRIC_SHARE = 0.7
"""Loss of capacitance relative to the loss of bending, above which an electrode is broken: it takes both alike. A depolarised
ceramic keeps its clamped capacitance, two thirds of the whole."""


@dataclass(frozen=True, slots=True)
class ConnectionLimits:
    """The parameters of a protocol that are limits of the connection; an expected value of 0 is not compared."""

    polarity: int
    smallest_f: float
    largest_loss: float
    expected_f: float
    expected_bending: float
    smallest_share: float

    @classmethod
    def of(cls, protocol: Protocol) -> Self:
        """Return the limits among the parameters of a protocol."""
        return cls(**{each.name: getattr(protocol, each.name) for each in fields(cls)})

    def expected(self, points: Mapping[str, Array]) -> dict[str, float]:
        """Return the expected values that are not stated, from the first sine of an earlier run; empty without one."""
        sines = np.flatnonzero(np.isfinite(points.get("capacitance", np.zeros(0))))
        if not sines.size:
            return {}
        seen = {"expected_f": "capacitance", "expected_bending": "bending"}
        return {name: abs(float(points[column][sines[0]])) for name, column in seen.items() if not getattr(self, name)}


@dataclass(frozen=True, slots=True)
class Connection:
    """Capacitance (F), loss factor, and in-phase displacement per volt on the specimen (m/V) with its standard error."""

    capacitance: float
    loss: float
    bending: float
    bending_errors: float

    def checks(self, limits: ConnectionLimits) -> tuple[CheckResult, ...]:
        """Return the checks, the most dangerous fault first; a bending below its noise has no polarity."""
        limit = partial(CheckResult, consequence=Outcome.DID_NOT_PASS)
        found = []
        if self.capacitance > 0 and not math.isnan(self.loss):
            found.append(
                limit(
                    "loss factor of the specimen", self.loss, "1", None, limits.largest_loss,
                    "the specimen is short-circuited or damaged; switch high voltage off, discharge it and measure its resistance",
                )
            )  # fmt: skip
        found += [
            limit(
                "capacitance of the specimen", self.capacitance, "F", limits.smallest_f, None,
                "the specimen is not connected, an electrode is broken, or the current is not wired to the card; check the cable with high "
                "voltage off, and gain and sign of the channel",
            ),
            limit(
                "bending / its standard error", abs(self.bending) / self.bending_errors, "1", SIGNIFICANCE, None,
                "the specimen has its capacitance but does not move: check that it is under the laser sensor and not held; otherwise it is "
                "depolarised",
            ),
            limit(
                "sign of the bending", math.copysign(1.0, self.bending) * (limits.polarity or math.copysign(1.0, self.bending)), "1", 1.0,
                None, "the specimen is connected the wrong way round, or the sign of the bench's gain of the sensor is wrong; exchange its "
                "wires with high voltage off, or set polarity",
            ),
        ]  # fmt: skip
        return (*found, *self._comparisons(limits))

    def _comparisons(self, limits: ConnectionLimits) -> tuple[CheckResult, ...]:
        shares = {
            "bending": abs(self.bending) / (limits.expected_bending or math.nan),
            "capacitance": self.capacitance / (limits.expected_f or math.nan),
        }
        lost = {name: 0.0 if math.isnan(share) else 1 - share for name, share in shares.items()}
        if lost["capacitance"] > max(DIELECTRIC_SHARE * lost["bending"], 0.0):
            remedy = "an electrode is broken, or a part of it has no contact; look at its fingers and its solder, with high voltage off"
        elif lost["bending"] > 0:
            remedy = "the specimen is depolarised, or held; pole it again, or set expected_bending if it is right"
        else:
            remedy = "it is another specimen, or the gain of a channel is wrong; set expected_f and expected_bending if it is right"
        low, high = limits.smallest_share, 1 / limits.smallest_share
        return tuple(
            CheckResult(f"{name} / expected", share, "1", low, high, remedy, Outcome.DID_NOT_PASS)
            for name, share in shares.items()
            if not math.isnan(share)
        )


def flow(recording: Recording) -> ChannelSignal:
    """Return current or charge of a recording.

    Raises:
        ValueError: the run has no such channel.
    """
    seen = None if recording.inputs is None else recording.inputs.signal(recording.rows, *FLOW_KINDS)
    if seen is None:
        raise ValueError(f"the run has no channel of the kind {' or '.join(FLOW_KINDS)}")
    return seen


def specimen_voltage(recording: Recording) -> ChannelSignal:
    """Return the volts on the specimen of a recording with a current or a charge."""
    assert recording.inputs is not None
    return recording.inputs.specimen_voltage(recording.rows, recording.drive_v)


def input_errors(voltage: ChannelSignal, current: ChannelSignal) -> InputErrors:
    """Return delays and uncertainties of the two inputs."""
    v, i = voltage.channel, current.channel
    return InputErrors(
        voltage.delay_s,
        current.delay_s,
        math.hypot(v.gain_relative_uncertainty, i.gain_relative_uncertainty),
        math.hypot(v.delay_uncertainty_s, i.delay_uncertainty_s),
        i.bleed_s,
    )


def sine_response(recording: Recording) -> tuple[ElectricalResponse, Connection]:
    """Return the electrical response to a recorded sine, and the connection by it.

    Raises:
        ValueError: the run has no channel of a current or a charge, or the drive is no sine.
    """
    drive, rate = recording.drive, recording.rate_hz
    if not isinstance(drive, Sine):
        raise ValueError(f"a capacitance cannot be taken from a recording under {drive.kind}")
    current = flow(recording)
    frequency = fit_frequency(recording.drive_v, rate, drive.frequency_hz)
    voltage = specimen_voltage(recording)
    is_charge = current.channel.kind == FLOW_KINDS[1]
    seen = electrical_response(
        voltage.values, current.values, rate, frequency, input_errors(voltage, current), is_charge
    )
    moved = fit_sine(recording.displacement_m, rate, frequency, 4)
    turned = moved.fundamental * np.exp(2j * np.pi * frequency * recording.sensor_delay_s) / seen.voltage[0]
    loss = seen.loss.value if seen.is_seen else math.nan
    bending_errors = moved.standard_error / abs(seen.voltage[0])
    return seen, Connection(seen.capacitance.value, loss, float(turned.real), bending_errors)


def connection_columns(recording: Recording) -> dict[str, Any]:
    """Return capacitance, loss factor and bending as columns of a point; empty for a bench without current and charge."""
    try:
        return asdict(sine_response(recording)[1])
    except ValueError:
        return {}
