"""Checks of a commissioning: figures of the recorded outputs and their limits."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

from drivers.evidence import OutputCheck
from protocols.commissioning.evaluation import TRANSIENT_V, Evaluation, Transient
from protocols.commissioning.messages import MessageKind
from protocols.commissioning.verdict import CheckedOutput

HELD_V = 0.2
"""Distance from rest of the two levels that measure the scale of the offset."""

REST_LIMIT_V, LEVEL_LIMIT_V = 0.05, 0.03
CROSSTALK_LIMIT, START_ROUTE_LIMIT = 0.01, 0.1
GAIN_LIMIT, OFFSET_LIMIT, SHAPE_LIMIT = 0.03, 0.02, 0.08
FIT_LIMIT = 0.25
"""Largest departure (rms, in peaks) from the commanded form of a recording with amplitude and polarity."""

CARD_STOP_LIMIT_S = 2.0
"""Longest Stop of a card's output: a queue of 0.5 s, its margin, the fade and the measurement of the level. Without a rewrite:
the time-out of 0.1 s, four blocks in which the output is measured, and the ramp of a small drive."""

CAUSES = {
    OutputCheck.SETTINGS: (MessageKind.UPLOAD, MessageKind.OTHER),
    OutputCheck.AMPLITUDE: (MessageKind.AMPLITUDE,),
    OutputCheck.STOP: (MessageKind.ABORT, MessageKind.TRIGGER),
}
"""Messages whose transients belong to each check; a transient at the trigger, before Stop, belongs to the waveform."""


def worst_deviation(check: OutputCheck, deviations: Sequence[tuple[float, str]], limit: float) -> CheckedOutput:
    """Return the check of the largest deviation."""
    finite = [each for each in deviations if math.isfinite(each[0])]
    value, detail = max(finite, key=lambda each: abs(each[0]), default=(math.nan, ""))
    return CheckedOutput(check, value, "V", -limit, limit, detail)


def check_offset(above: Evaluation | None, below: Evaluation | None) -> CheckedOutput:
    """Return the check of the offset, by two levels."""
    scale = math.nan if above is None or below is None else (above.held_v - below.held_v) / (2 * HELD_V)
    return CheckedOutput(OutputCheck.OFFSET, scale, "1", 1 - OFFSET_LIMIT, 1 + OFFSET_LIMIT)


def check_waveforms(
    sine: Evaluation | None, uneven: Evaluation | None, larger: Evaluation | None
) -> Iterator[CheckedOutput]:
    """Yield polarity, amplitudes and form; a waveform that is no sine has neither polarity nor amplitude."""
    gain = sine.gain if sine is not None and sine.misfit < FIT_LIMIT else math.nan
    yield CheckedOutput(OutputCheck.POLARITY, math.copysign(1.0, gain) if math.isfinite(gain) else math.nan, "1", 1, 1)
    yield CheckedOutput(OutputCheck.SCALE, abs(gain), "1", 1 - GAIN_LIMIT, 1 + GAIN_LIMIT)
    ratio = abs(uneven.gain / gain) if uneven is not None and uneven.misfit < FIT_LIMIT else math.nan
    yield CheckedOutput(OutputCheck.UNEVEN, ratio, "1", 1 - GAIN_LIMIT, 1 + GAIN_LIMIT, "in parts of the sine's")
    played = [e for e in (sine, uneven, larger) if e is not None]
    deviations = [(e.residual, f"'{e.trace.name}'") for e in played]
    deviations += [
        (t.away_v / e.peak_v, f"at the start of '{e.trace.name}'")
        for e in played
        for t in e.transients()
        if is_at_start(e, t)
    ]
    value, detail = max(deviations, default=(math.nan, ""))
    yield CheckedOutput(OutputCheck.SHAPE, value, "1", None, SHAPE_LIMIT, f"largest departure in peaks, {detail}")


def is_at_start(evaluation: Evaluation, transient: Transient) -> bool:
    """Whether a transient belongs to the beginning of a waveform."""
    return transient.cause is MessageKind.TRIGGER and transient.time_s < evaluation.trace.stop_s


def check_transients(
    everything: Sequence[Evaluation],
    stopped: Evaluation | None,
    causes_of: Mapping[OutputCheck, tuple[MessageKind, ...]] = CAUSES,
) -> Iterator[CheckedOutput]:
    """Yield the checks of transients, by their causes; for Stop also the level after it."""
    transients: list[tuple[Transient, str]] = [
        (t, e.trace.name) for e in everything for t in e.transients() if not is_at_start(e, t)
    ]
    for check, causes in causes_of.items():
        caused = [(t, name) for t, name in transients if t.cause in causes]
        worst = max(caused, key=lambda each: each[0].away_v, default=None)
        value = worst[0].away_v if worst else 0.0
        detail = f"{worst[0].volts:.2f} V at '{worst[0].text}' in '{worst[1]}'" if worst else ""
        if check is OutputCheck.STOP:
            left_v = abs(stopped.final_v - stopped.before_v) if stopped is not None else math.nan
            if not left_v <= value:
                value, detail = left_v, "after Stop"
        yield CheckedOutput(check, value if everything else math.nan, "V", None, TRANSIENT_V, detail)


def check_stop_duration(stopped: Evaluation | None) -> CheckedOutput | None:
    """Return the check of a card's output that took too long for Stop; None if it did not, or for a source with its own connection."""
    if stopped is None or stopped.trace.messages or stopped.stop_duration_s <= CARD_STOP_LIMIT_S:
        return None
    detail = stopped.trace.error or f"in '{stopped.trace.name}'"
    return CheckedOutput(OutputCheck.STOP, stopped.stop_duration_s, "s", None, CARD_STOP_LIMIT_S, detail)


def with_rewrites_held_back(check: CheckedOutput) -> CheckedOutput:
    """Return the check of Stop with a remark: measured without a rewrite."""
    if check.check is not OutputCheck.STOP:
        return check
    remark = "NI's driver holds rewritten samples back: Stop keeps the sample that was reached, and leaves it in a line"
    return replace(check, detail="; ".join(filter(None, (check.detail, remark))))


def with_jump_at_stop(check: CheckedOutput, stopped: Evaluation) -> CheckedOutput:
    """Return the check of Stop with the jump at the end of a stopped drive, if that is larger."""
    if check.check is not OutputCheck.STOP or stopped.stop_jump_v <= check.value:
        return check
    return CheckedOutput(OutputCheck.STOP, stopped.stop_jump_v, "V", None, TRANSIENT_V, f"in '{stopped.trace.name}'")


def check_crosstalk(bursts: Sequence[Evaluation]) -> CheckedOutput:
    """Return the check of the drive in the card's other inputs: high voltage is off, so it arrives by crosstalk alone."""
    value = max((b.crosstalk for b in bursts if math.isfinite(b.crosstalk)), default=math.nan)
    detail = "of the drive, in another input"
    return CheckedOutput(OutputCheck.CROSSTALK, value, "1", None, CROSSTALK_LIMIT, detail)


def check_start_route(bursts: Sequence[Evaluation], errors: Sequence[str]) -> CheckedOutput:
    """Return the check that drives start on scans: the start of a sine always has the same position between two scans."""
    starts = [b.start_in_scans for b in bursts if math.isfinite(b.start_in_scans)]
    spread = max((abs((s - starts[0] + 0.5) % 1.0 - 0.5) for s in starts), default=math.nan)
    detail = "of a scan, between the starts of sines"
    if len(starts) < 2:
        spread, detail = (1.0, errors[0]) if errors else (math.nan, "")
    return CheckedOutput(OutputCheck.START_ROUTE, spread, "1", None, START_ROUTE_LIMIT, detail)


def check_wire(cut: Evaluation | None, bursts: Sequence[Evaluation]) -> list[CheckedOutput]:
    """Return the check of the level after a drive with an interrupted connection, against the other drives' levels."""
    if cut is None:
        return [CheckedOutput(OutputCheck.WIRE, math.nan, "V", -LEVEL_LIMIT_V, LEVEL_LIMIT_V)]
    others = [b.after_v - b.armed_v for b in bursts if math.isfinite(b.after_v)]
    usual_v = others[-1] if others else 0.0
    value = cut.after_v - cut.armed_v - usual_v
    return [CheckedOutput(OutputCheck.WIRE, value, "V", -LEVEL_LIMIT_V, LEVEL_LIMIT_V, "against other drives")]
