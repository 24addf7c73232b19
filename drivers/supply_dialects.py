"""The words of programmable DC supplies, one row a family.

Sources: E3631A manual p. 74, 79; E36300 programming guide; DP800 programming guide p. 2-6, 2-35. What is marked MEM was
written from memory and is to be confirmed on the first real box.
"""

from dataclasses import dataclass


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
