"""Messages to a source by the setting that they change, to which a transient of the output is attributed."""

import math
import re
from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from drivers import Clock, Link
from drivers.transport import ObservedLink
from protocols.commissioning.verdict import CommandTime


class MessageKind(StrEnum):
    """Setting that a message changes."""

    UPLOAD = "upload"
    AMPLITUDE = "amplitude"
    TRIGGER = "trigger"
    ABORT = "abort"
    OTHER = "other"


PATTERNS = (
    (MessageKind.TRIGGER, re.compile(r"\*TRG|BURS:TRIG(?!:SOUR)|MTRIG")),
    (MessageKind.ABORT, re.compile(r"ABOR|BURS:STAT")),
    (
        MessageKind.UPLOAD,
        re.compile(r"DATA:(ARB|VOL:CLE|DAC|DEF)|TRAC:(DATA|DEF)|\bDATA EMEM|WVDT WVNM|FUNC:(ARB|USER) |ARWV NAME"),
    ),
    (MessageKind.AMPLITUDE, re.compile(r"\bVOLT [0-9]|BSWV AMP")),
)
"""Settings by the headers of all supported families; the first match counts."""

SEPARATED_AT_START = frozenset({MessageKind.UPLOAD, MessageKind.AMPLITUDE, MessageKind.TRIGGER})
SEPARATED_AT_STOP = frozenset({MessageKind.ABORT})
"""Messages after a pause of observation, so that the transient of the previous message has ended."""

SEPARATION_S = 0.015
"""Duration of the pause: longer than the switching of an attenuator's relay."""


def message_kind(text: str) -> MessageKind:
    """Return the setting that a message changes."""
    head = text.partition(",#")[0][:120].upper()
    if head.rstrip().endswith("?") and ";" not in head:
        return MessageKind.OTHER
    return next((kind for kind, pattern in PATTERNS if pattern.search(head)), MessageKind.OTHER)


def command_name(text: str) -> str:
    """Return the header of a message's first command."""
    return re.split(r"[ ;]", text.strip(), maxsplit=1)[0].removeprefix(":")


@dataclass(frozen=True, slots=True)
class Message:
    """One message and the bench time at which it was sent."""

    time_s: float
    kind: MessageKind
    text: str


class MessageLog:
    """Records the messages to a source with their time, and separates messages in `separated`.

    Meanwhile the driver waits for the reply to each step of a ramp, even on a slow connection: the transients of steps sent ahead,
    or as one message, would follow other messages.
    """

    def __init__(self) -> None:
        self.separated: frozenset[MessageKind] = frozenset()
        self._clock: Clock | None = None
        self._messages: list[Message] = []
        self._reply_times: dict[str, list[float]] = {}
        self.reply_s = math.nan
        """Longest time from the beginning of a message to its reply; NaN before the first."""

    def observe(self, link: Link, clock: Clock) -> ObservedLink:
        """Return the link to the source that records its messages."""
        self._clock = clock
        return ObservedLink(link, self._note, self._note_reply, lambda: bool(self.separated))

    def take(self) -> tuple[Message, ...]:
        """Return the messages since the last call."""
        taken, self._messages = tuple(self._messages), []
        return taken

    def _note(self, text: str) -> None:
        if self._clock is None:
            return
        kind = message_kind(text)
        if kind in self.separated:
            self._clock.sleep(SEPARATION_S)
        self._messages.append(Message(self._clock.now(), kind, text.partition(",#")[0][:60]))

    def _note_reply(self) -> None:
        if self._clock is not None and self._messages:
            message = self._messages[-1]
            took_s = self._clock.now() - message.time_s
            self._reply_times.setdefault(command_name(message.text), []).append(took_s)
            self.reply_s = float(np.fmax(self.reply_s, took_s))

    def command_times(self) -> tuple[CommandTime, ...]:
        """Return the reply times of each command, the slowest first."""
        command_times = (
            CommandTime(command, len(times), float(np.median(times)), max(times))
            for command, times in self._reply_times.items()
        )
        return tuple(sorted(command_times, key=lambda each: -each.longest_s))
