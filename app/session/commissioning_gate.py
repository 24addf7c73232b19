"""Commissioning gate: whether high voltage may be switched on with this source, by its commissioning record."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from drivers import Identity

if TYPE_CHECKING:
    from app.session.commissioning_record import CommissioningRecord

REMEDY = (
    "Run `tactor-bench commission` (a minute, without high voltage), or give a reason with --without-commissioning REASON, "
    "which every run of this session stores"
)

TIMES_USED = "stop_s", "reply_s", "level_stop_s", "interlock_s"


@dataclass(frozen=True, slots=True)
class CommissioningState:
    """Whether the source is commissioned.

    Attributes:
        refusal: reason why high voltage stays off; empty if it is allowed.
        note: text for the log of each run; may be empty.
        stored: plain values for each run file.
        stop_s: measured duration of Stop; 0 if unknown.
        reply_s: longest measured time from a message to its reply; 0 if unknown.
        holds_by_offset: whether a level is held by the offset, for want of a measurement of an uneven waveform's volts.
        level_stop_s: measured duration of Stop from a level with a hastened end; 0 if not measured, or impossible.
        interlock_s: measured time from the interlock's last heartbeat until high voltage is off; 0 if not measured.
        byte_order: order of the source's waveforms in which it was commissioned; empty if unknown.
    """

    refusal: str
    note: str
    stored: dict[str, Any]
    stop_s: float = 0.0
    reply_s: float = 0.0
    holds_by_offset: bool = False
    level_stop_s: float = 0.0
    interlock_s: float = 0.0
    byte_order: str = ""


def commissioning_state(
    identity: Identity, simulated: bool, reason: str = "", simulated_bench: str = ""
) -> CommissioningState:
    """Return whether a source is commissioned with its present firmware.

    Args:
        identity: of the source.
        simulated: a simulated bench is exempt.
        reason: reason for high voltage without commissioning.
        simulated_bench: key of the simulated bench, whose record states whether Stop may hasten the end of a level.
    """
    if simulated:
        return _state_of_simulated_bench(identity, simulated_bench)
    from app.session.commissioning_record import load_record

    record = load_record(identity)
    if record is not None and record.is_valid:
        times = _times_used(record)
        stop = f"; Stop took {times['stop_s']:.2f} s" if times["stop_s"] else ""
        reply = f"; its slowest reply took {times['reply_s']:.2f} s" if times["reply_s"] else ""
        note = f"{identity} was commissioned with this firmware on {record.date[:10]}{stop}{reply}"
        stored = {"status": "commissioned", "date": record.date, "record": str(record.path)}
        return _allowed(note, {**stored, **_or_null(times)}, times, record.byte_order)
    why = _describe_missing(identity, record)
    if reason:
        stored = {"status": "overridden", "reason": reason, "why": why}
        return CommissioningState(
            "",
            f"High voltage without a valid commissioning of the source: {reason}. {why}",
            stored,
            holds_by_offset=True,
        )
    return CommissioningState(f"{why}. {REMEDY}", "", {"status": "not commissioned", "why": why}, holds_by_offset=True)


def _state_of_simulated_bench(identity: Identity, simulated_bench: str) -> CommissioningState:
    stored: dict[str, Any] = {"status": "exempt", "why": "simulated bench"}
    times: dict[str, float] = {}
    byte_order = ""
    if simulated_bench:
        from app.session.commissioning_record import load_record

        record = load_record(identity, simulated_bench)
        if record is not None and record.verdict == "pass":
            times, byte_order = _times_used(record, "level_stop_s", "interlock_s"), record.byte_order
            stored |= {"record": str(record.path), **_or_null(times)}
    return _allowed("", stored, times, byte_order)


def _allowed(note: str, stored: dict[str, Any], times: dict[str, float], byte_order: str) -> CommissioningState:
    """Return the state in which high voltage is allowed, with the measured times and the byte order."""
    stop_s, reply_s, level_stop_s, interlock_s = (times.get(name, 0.0) for name in TIMES_USED)
    return CommissioningState(
        "", note, stored, stop_s, reply_s, level_stop_s=level_stop_s, interlock_s=interlock_s, byte_order=byte_order
    )


def _times_used(record: "CommissioningRecord", *names: str) -> dict[str, float]:
    """Return measured times that the program uses, by name; 0 where one was not measured."""
    times = {name: getattr(record.times, name) for name in names or TIMES_USED}
    return {name: time_s if math.isfinite(time_s) else 0.0 for name, time_s in times.items()}


def _or_null(times: dict[str, float]) -> dict[str, float | None]:
    return {name: time_s or None for name, time_s in times.items()}


def _describe_missing(identity: Identity, record: "CommissioningRecord | None") -> str:
    from app.session.commissioning_record import firmwares_with_record

    firmware = identity.firmware or "unknown"
    if record is not None and record.simulated:  # stored by an earlier version
        return f"The commissioning record of {identity} is of a simulated instrument"
    if record is not None:
        failures = "; ".join(record.failed)
        return f"The commissioning of {identity} on {record.date[:10]} did not pass ({failures})"
    if others := firmwares_with_record(identity):
        return f"{identity} was commissioned with firmware {', '.join(others)}, and now has {firmware}"
    return f"There is no commissioning record of {identity} with firmware {firmware}"
