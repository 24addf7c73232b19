"""One output of a DC supply over its wire: what it can be told and asked, whatever its dialect.

The words of programmable DC supplies, one row a family.

Sources: E3631A manual p. 74, 79; E36300 programming guide; DP800 programming guide p. 2-6, 2-35. What is marked MEM was
written from memory and is to be confirmed on the first real box.
"""

import re
import threading
from dataclasses import dataclass

from drivers.errors import InstrumentError, LinkError
from drivers.interfaces import Identity
from drivers.transport.scpi import Link, Scpi


@dataclass(frozen=True, slots=True)
class Dialect:
    """The words of one family; `{ch}` is the output's number, `{v}` a value.

    Args:
        models: how the models of its `*IDN?` answer begin.
        ovp, ovp_v, tripped: ask whether over-voltage protection is armed, at what level, and whether it has tripped;
            empty where the box has none over the wire.
        status_word: whether `is_on` is answered by a word of bits: bit 4 is output 1, bit 5 output 2.
        compound: whether a setting and the query that confirms it fit in one message.
    """

    name: str
    models: str
    volts: str
    current: str
    current_is: str
    measure: str
    on: str
    is_on: str
    ovp: str = ""
    ovp_v: str = ""
    tripped: str = ""
    status_word: bool = False
    compound: bool = True


DIALECTS = (
    Dialect(
        "Keysight E36100/E36200/E36300",
        r"E36\d{3}",
        volts="VOLT {v:.4f},(@{ch})",
        current="CURR {v:.4f},(@{ch})",
        current_is="CURR? (@{ch})",
        measure="MEAS:VOLT? (@{ch})",
        on="OUTP ON,(@{ch})",
        is_on="OUTP? (@{ch})",
        ovp="VOLT:PROT:STAT? (@{ch})",
        ovp_v="VOLT:PROT? (@{ch})",
        tripped="VOLT:PROT:TRIP? (@{ch})",
    ),
    # All outputs of an E3631A come on together; which one a setting means is selected in the same message.
    Dialect(
        "Keysight E3631A",
        r"E3631A",
        volts="INST:NSEL {ch};:VOLT {v:.4f}",
        current="INST:NSEL {ch};:CURR {v:.4f}",
        current_is="INST:NSEL {ch};:CURR?",
        measure="INST:NSEL {ch};:MEAS:VOLT?",
        on="OUTP ON",
        is_on="OUTP?",
    ),
    Dialect(
        "Rigol DP800",
        r"DP8\d\d",
        volts=":SOUR{ch}:VOLT {v:.4f}",
        current=":SOUR{ch}:CURR {v:.4f}",
        current_is=":SOUR{ch}:CURR?",
        measure=":MEAS:VOLT? CH{ch}",
        on=":OUTP CH{ch},ON",
        is_on=":OUTP? CH{ch}",
        ovp=":OUTP:OVP? CH{ch}",
        ovp_v=":OUTP:OVP:VAL? CH{ch}",
        tripped=":OUTP:OVP:QUES? CH{ch}",
    ),
    # MEM: one command a message, no query for the output, no protection over the wire.
    Dialect(
        "Siglent SPD",
        r"SPD[13]",
        volts="CH{ch}:VOLT {v:.3f}",
        current="CH{ch}:CURR {v:.3f}",
        current_is="CH{ch}:CURR?",
        measure="MEAS:VOLT? CH{ch}",
        on="OUTP CH{ch},ON",
        is_on="SYST:STAT?",
        status_word=True,
        compound=False,
    ),
)


YES, NO = ("1", "+1", "ON", "YES"), ("0", "+0", "OFF", "NO")


class SupplyWire:
    """May be used by several threads.

    Args:
        link: the wire.
        channel: the output's number.

    Attributes:
        name: what an operator calls the supply.

    Raises:
        LinkError: nothing answers on the wire.
        InstrumentError: another instrument answers.
    """

    def __init__(self, link: Link, channel: int) -> None:
        self.link, self._channel = link, channel
        self._lock = threading.RLock()
        self._scpi = Scpi(link, f"DC supply at {link.name}")
        self.identity: Identity = self._scpi.identify()
        fits = [d for d in DIALECTS if re.match(d.models, self.identity.model, re.IGNORECASE)]
        if not fits:
            link.close()
            raise InstrumentError(
                f"{link.name} answered as '{self.identity}'; this driver is for {', '.join(d.name for d in DIALECTS)}. "
                "Correct the driver or the resource in the bench file"
            )
        self._words = fits[0]
        self._scpi.instrument = self.name = f"DC supply {self.identity.model}"

    def reopen(self) -> None:
        """Raises LinkError where nothing, or another instrument, answers."""
        with self._lock:
            self.link.reopen()
            seen = self._scpi.identify()
        if seen != self.identity:
            raise LinkError(f"{self.link.name} now answers as '{seen}', not '{self.identity}'")

    def volts_words(self, volts: float) -> str:
        """What sets the level, without a query."""
        return self._words.volts.format(ch=self._channel, v=volts)

    def set_volts(self, volts: float) -> None:
        self._tell(self.volts_words(volts))

    def set_current(self, ampere: float) -> None:
        self._tell(self._words.current.format(ch=self._channel, v=ampere))

    def switch_on(self) -> None:
        """There is no switching off: that is 0 V."""
        self._tell(self._words.on.format(ch=self._channel))

    def forget_errors(self) -> None:
        """What others left in the error queue is no answer to us."""
        self._tell("*CLS")

    def measured_v(self) -> float:
        return self._number(self._words.measure)

    def current_a(self) -> float:
        """The current limit that is set."""
        return self._number(self._words.current_is)

    def is_on(self) -> bool:
        if not self._words.status_word:
            return self._says_yes(self._words.is_on)
        answer = self._ask(self._words.is_on)
        try:
            return bool(int(answer, 16) >> (3 + self._channel) & 1)
        except ValueError:
            raise LinkError(f"{self.name}: '{answer[:60]}' is no status word; check the cable") from None

    def could_trip(self, least_v: float) -> str:
        """What is wrong with the over-voltage protection, in a sentence; empty where it allows `least_v`."""
        words = self._words
        if words.tripped and self._says_yes(words.tripped):
            return "its over-voltage protection has tripped; clear it at the front panel"
        if words.ovp and self._says_yes(words.ovp) and (ovp_v := self._number(words.ovp_v)) < least_v:
            return (
                f"its over-voltage protection at {ovp_v:g} V could trip within the amplifier's range. A trip is 0 V, -500 V on "
                f"the specimen: set it to at least {least_v:g} V or off"
            )
        return ""

    def _ask(self, query: str) -> str:
        with self._lock:
            return self._scpi.ask(query.format(ch=self._channel))

    def _says_yes(self, query: str) -> bool:
        answer = self._ask(query).upper()
        if answer not in (*YES, *NO):
            raise LinkError(f"{self.name}: '{answer[:60]}', which is no yes or no; check the cable")
        return answer in YES

    def _number(self, query: str) -> float:
        with self._lock:
            return self._scpi.ask_number(query.format(ch=self._channel))

    def _tell(self, command: str) -> None:
        with self._lock:
            if self._words.compound:
                self._scpi.tell(command)
                return
            self.link.write(command)
            answer = self._scpi.ask("SYST:ERR?")
        code = re.match(r"\s*[+-]?\d+", answer)
        if code is None:
            raise LinkError(f"{self.name}: '{command}' was answered by '{answer[:60]}', which is no error report")
        if int(code[0]):
            raise InstrumentError(f"{self.name} refused '{command}': {answer}")
