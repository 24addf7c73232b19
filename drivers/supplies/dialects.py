"""DC supply dialects: the commands of each family as a table, and one output as a channel.

Sources: E3631A manual p. 74, 79; E3632A guide p. 88; E36300 programming guide; DP800 programming guide p. 2-6, 2-35, 2-57;
PyMeasure at 32503b8 (keysightE364xA, keysightE36312A, siglent_spdbase). Properties without a source are marked unproven in the
table of assumptions (docs/generators.md).
"""

import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity
from drivers.transport import Link, ScpiSession


@dataclass(frozen=True, slots=True)
class PersistentSetting:
    """A persistent setting of other users that can switch the output off or shift it.

    Args:
        name: for messages, after "its".
        query: its query.
        neutral: replies of a setting without effect, in capitals.
        reset: command that sets it to neutral.
        optional: whether models of the family may lack it.
    """

    name: str
    query: str
    neutral: tuple[str, ...]
    reset: str
    optional: bool = False


OFF_REPLIES = ("0", "+0", "OFF")


@dataclass(frozen=True, slots=True)
class SupplyDialect:
    """The commands of one family; `{ch}` is the output's number, `{v}` a value.

    Args:
        name: name of the family, for messages.
        model_pattern: regular expression for the start of the model in the `*IDN?` reply.
        set_voltage, set_current, enable_output: commands.
        query_current, measure_voltage, query_output: queries.
        query_ovp_enabled, query_ovp_level, query_ovp_tripped: queries of the over-voltage protection;
            empty if it has no remote access.
        persistent_settings: over-current protection, which switches the output off at an inrush, tracking and pairing.
        output_in_status_word: whether `query_output` is answered by a word of bits: bit 4 is output 1, bit 5 output 2, and bit 3
            reports series or parallel operation.
        accepts_compound_messages: whether a setting and the query that confirms it may share a message.
    """

    name: str
    model_pattern: str
    set_voltage: str
    set_current: str
    query_current: str
    measure_voltage: str
    enable_output: str
    query_output: str
    query_ovp_enabled: str = ""
    query_ovp_level: str = ""
    query_ovp_tripped: str = ""
    persistent_settings: tuple[PersistentSetting, ...] = ()
    output_in_status_word: bool = False
    accepts_compound_messages: bool = True


OCP = "over-current protection"

OCP_SWITCH = PersistentSetting(OCP, "CURR:PROT:STAT?", OFF_REPLIES, "CURR:PROT:STAT OFF")
TRACKING = PersistentSetting("tracking", "OUTP:TRAC?", OFF_REPLIES, "OUTP:TRAC OFF", optional=True)


def _keysight(
    name: str,
    model_pattern: str,
    *persistent_settings: PersistentSetting,
    select: str = "",
    channel_list: bool = False,
    has_ovp: bool = True,
) -> SupplyDialect:
    """Return the dialect of a family with one output, or with outputs selected before a command or listed after it."""
    of_setting, of_query = (",(@{ch})", " (@{ch})") if channel_list else ("", "")
    protection: dict[str, Any] = {
        "query_ovp_enabled": f"{select}VOLT:PROT:STAT?{of_query}",
        "query_ovp_level": f"{select}VOLT:PROT?{of_query}",
        "query_ovp_tripped": f"{select}VOLT:PROT:TRIP?{of_query}",
    }
    return SupplyDialect(
        name,
        model_pattern,
        set_voltage=f"{select}VOLT {{v:.4f}}{of_setting}",
        set_current=f"{select}CURR {{v:.4f}}{of_setting}",
        query_current=f"{select}CURR?{of_query}",
        measure_voltage=f"{select}MEAS:VOLT?{of_query}",
        enable_output=f"OUTP ON{of_setting}",
        query_output=f"OUTP?{of_query}",
        **protection if has_ovp else {},
        persistent_settings=persistent_settings,
    )


SELECT = "INST:NSEL {ch};:"

SUPPLY_DIALECTS = (
    _keysight(
        "Keysight E36200/E36300",
        r"E36(3\d\d|23[34])",
        # It trips at the current limit itself.
        PersistentSetting(OCP, "CURR:PROT:STAT? (@{ch})", OFF_REPLIES, "CURR:PROT:STAT OFF,(@{ch})"),
        PersistentSetting("pairing of outputs", "OUTP:PAIR?", ("OFF", "NONE"), "OUTP:PAIR OFF", optional=True),
        channel_list=True,
    ),
    _keysight(
        "Keysight E36100/E36200 with one output", r"E36(10[2-6]|15[0-5]|23[12])", replace(OCP_SWITCH, optional=True)
    ),
    _keysight("Keysight E3632A/E3633A/E3634A", r"E363[234]", OCP_SWITCH),
    _keysight("Keysight E3640A-E3645A", r"E364[0-5]"),
    _keysight("Keysight E3646A-E3649A", r"E364[6-9]", TRACKING, select=SELECT),
    # All outputs of an E3631A come on together; the output of a setting is selected in the same message.
    _keysight("Keysight E3631A", r"E3631A", TRACKING, select=SELECT, has_ovp=False),
    SupplyDialect(
        "Rigol DP800",
        r"DP8\d\d",
        set_voltage=":SOUR{ch}:VOLT {v:.4f}",
        set_current=":SOUR{ch}:CURR {v:.4f}",
        query_current=":SOUR{ch}:CURR?",
        measure_voltage=":MEAS:VOLT? CH{ch}",
        enable_output=":OUTP CH{ch},ON",
        query_output=":OUTP? CH{ch}",
        query_ovp_enabled=":OUTP:OVP? CH{ch}",
        query_ovp_level=":OUTP:OVP:VAL? CH{ch}",
        query_ovp_tripped=":OUTP:OVP:QUES? CH{ch}",
        persistent_settings=(
            PersistentSetting(OCP, ":OUTP:OCP? CH{ch}", OFF_REPLIES, ":OUTP:OCP CH{ch},OFF"),
            PersistentSetting("tracking", ":OUTP:TRAC? CH{ch}", OFF_REPLIES, ":OUTP:TRAC CH{ch},OFF", optional=True),
        ),
    ),
    # One command per message, no query for the output, no remote access to protections.
    SupplyDialect(
        "Siglent SPD",
        r"SPD[13]",
        set_voltage="CH{ch}:VOLT {v:.3f}",
        set_current="CH{ch}:CURR {v:.3f}",
        query_current="CH{ch}:CURR?",
        measure_voltage="MEAS:VOLT? CH{ch}",
        enable_output="OUTP CH{ch},ON",
        query_output="SYST:STAT?",
        output_in_status_word=True,
        accepts_compound_messages=False,
    ),
)


TRUE_REPLIES, FALSE_REPLIES = ("1", "+1", "ON", "YES"), ("0", "+0", "OFF", "NO")


class SupplyChannel:
    """One output of a DC supply, for use by several threads.

    Args:
        link: the connection.
        channel: the output's number.

    Attributes:
        name: the supply in messages.

    Raises:
        LinkError: nothing answers.
        InstrumentError: another instrument answers.
    """

    def __init__(self, link: Link, channel: int, now: Callable[[], float] = time.monotonic) -> None:
        self.link, self._channel = link, channel
        self._lock = threading.RLock()
        self._scpi = ScpiSession(link, f"DC supply at {link.name}", now)
        self.identity: Identity = self._scpi.identify()
        fits = [d for d in SUPPLY_DIALECTS if re.match(d.model_pattern, self.identity.model, re.IGNORECASE)]
        if not fits:
            link.close()
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {', '.join(d.name for d in SUPPLY_DIALECTS)}. "
                "Correct the driver or the resource in the bench file"
            )
        self._dialect = fits[0]
        self._unknown: set[str] = set()  # queries unknown to this model
        self._scpi.instrument = self.name = f"DC supply {self.identity.model}"

    def reopen(self) -> None:
        """Reconnect. Raises LinkError if nothing, or another instrument, answers."""
        with self._lock:
            self.link.reopen()
            seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self.link.name} now answers as '{seen}', not '{self.identity}'")

    @property
    def reply_s(self) -> float:
        """Median time of a reply."""
        return self._scpi.reply_s

    @property
    def slow_reply_s(self) -> float:
        """Time of a reply if the connection is slow and several commands may be sent without waiting, else 0."""
        return self._scpi.slow_reply_s if self._dialect.accepts_compound_messages else 0.0

    def voltage_command(self, volts: float) -> str:
        """Return the command that sets the level, without a query."""
        return self._dialect.set_voltage.format(ch=self._channel, v=volts)

    def set_voltage(self, volts: float) -> None:
        self._write_checked(self.voltage_command(volts))

    def set_current_limit(self, ampere: float) -> None:
        self._write_checked(self._dialect.set_current.format(ch=self._channel, v=ampere))

    def enable_output(self) -> None:
        """Switch the output on. It is never switched off: off is 0 V."""
        self._write_checked(self._dialect.enable_output.format(ch=self._channel))

    def clear_error_queue(self) -> None:
        """Empty the error queue of errors of other programs."""
        self._write_checked("*CLS")

    def measured_v(self) -> float:
        return self._query_float(self._dialect.measure_voltage)

    def current_limit_a(self) -> float:
        """Return the present current limit."""
        return self._query_float(self._dialect.query_current)

    def is_output_on(self) -> bool:
        if not self._dialect.output_in_status_word:
            return self._query_bool(self._dialect.query_output)
        return bool(self._status_word() >> (3 + self._channel) & 1)

    def _status_word(self) -> int:
        answer = self._query(self._dialect.query_output)
        try:
            return int(answer, 16)
        except ValueError:
            raise LinkError(f"{self.name}: '{answer[:60]}' is not a status word; check the cable") from None

    def reason_ovp_may_trip(self, min_level_v: float) -> str:
        """Return the reason why the over-voltage protection may trip below `min_level_v`; empty if it cannot."""
        dialect = self._dialect
        if dialect.query_ovp_tripped and self._query_bool(dialect.query_ovp_tripped):
            return "its over-voltage protection has tripped; clear it at the front panel"
        if (
            dialect.query_ovp_enabled
            and self._query_bool(dialect.query_ovp_enabled)
            and (ovp_v := self._query_float(dialect.query_ovp_level)) < min_level_v
        ):
            return (
                f"its over-voltage protection at {ovp_v:g} V could trip within the amplifier's range. A trip is 0 V, -500 V on "
                f"the specimen: set it to at least {min_level_v:g} V or off"
            )
        return ""

    def persistent_mismatch(self) -> str:
        """Describe the first setting of another user that can switch the output off or shift it; empty without one."""
        if self._dialect.output_in_status_word and self._status_word() >> 3 & 1:
            return "its outputs are in series or parallel"
        for setting in self._dialect.persistent_settings:
            answer = self._query_persistent(setting)
            if answer is not None and answer not in setting.neutral:
                return f"its {setting.name} is {answer}"
        return ""

    def reset_persistent_settings(self) -> None:
        """Reset settings of other users: over-current protection, tracking, pairing."""
        if self._dialect.output_in_status_word and self._status_word() >> 3 & 1:
            self._write_checked("OUTP:TRACK 0")
        for setting in self._dialect.persistent_settings:
            answer = self._query_persistent(setting)
            if answer is not None and answer not in setting.neutral:
                self._write_checked(setting.reset.format(ch=self._channel))

    def _query_persistent(self, setting: PersistentSetting) -> str | None:
        query = setting.query.format(ch=self._channel)
        if query in self._unknown:
            return None
        with self._lock:
            answer = self._scpi.query_optional(query) if setting.optional else self._scpi.query(query)
        if answer is None:
            self._unknown.add(query)
            return None
        return answer.strip().upper()

    def _query(self, query: str) -> str:
        with self._lock:
            return self._scpi.query(query.format(ch=self._channel))

    def _query_bool(self, query: str) -> bool:
        answer = self._query(query).upper()
        if answer not in (*TRUE_REPLIES, *FALSE_REPLIES):
            raise LinkError(f"{self.name}: '{answer[:60]}', which is neither yes nor no; check the cable")
        return answer in TRUE_REPLIES

    def _query_float(self, query: str) -> float:
        with self._lock:
            return self._scpi.query_float(query.format(ch=self._channel))

    def _write_checked(self, command: str) -> None:
        with self._lock:
            if self._dialect.accepts_compound_messages:
                self._scpi.write_checked(command)
                return
            self.link.write(command)
            answer = self._scpi.query("SYST:ERR?")
        code = re.match(r"\s*[+-]?\d+", answer)
        if code is None:
            raise LinkError(f"{self.name}: '{command}' was answered by '{answer[:60]}', which is not an error report")
        if int(code[0]):
            raise InstrumentError(f"{self.name} refused '{command}': {answer}")
