"""What the drivers of the Rigol generators assume of their own families."""

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import DG1000Z_GUIDE, DG2000_GUIDE, MENLO
from drivers.generators.rigol_dg import PACKET_POINTS
from drivers.generators.rigol_dg800 import DG4000

DG800_SERIES = "DG800, DG900, DG2000, DG4000"

RIGOL = (
    Assumption("rigol-dg", "DG1000Z", "points of a packet", f"{PACKET_POINTS}, 8 at least", MENLO),
    Assumption(
        "rigol-dg", "DG1000Z", "trigger source after a burst", "set anew before each", MENLO, (OutputCheck.START,)
    ),
    Assumption(
        "rigol-dg",
        "DG1000Z",
        "points",
        "unsigned 14-bit, little-endian",
        f"{DG1000Z_GUIDE} 2-173",
        (OutputCheck.SHAPE,),
    ),
    Assumption(
        "rigol-dg",
        "DG1000Z",
        "amplitude of an uneven waveform",
        "that of the converter's range",
        checks=(OutputCheck.UNEVEN,),
    ),
    Assumption(
        "rigol-dg",
        "DG1000Z",
        "gating, coupling, tracking, sum",
        "`OUTP:MODE`, `COUP`, `TRACK`, `SUM`: off, where the model knows them",
        f"{DG1000Z_GUIDE} (commands)",
        (OutputCheck.REST,),
    ),
    Assumption(
        "rigol-dg",
        "DG1000Z",
        "offset",
        "`APPL?`, not `VOLT:OFFS?`",
        "nominal-io/instro at 9530731 (rigol_dg1022z)",
        (OutputCheck.REST, OutputCheck.OFFSET),
    ),
    Assumption(
        "rigol-dg800",
        "DG800, DG900, DG2000",
        "range hold, sample-rate mode",
        "none: neither `VOLT:RANG` nor `FUNC:ARB:SRAT` exists",
        f"{DG2000_GUIDE}, command lists; DG800, DG900: a public driver of the three series (sample rate), unproven (range)",
    ),
    Assumption("rigol-dg800", "DG4000", "range hold", "none"),
    Assumption(
        "rigol-dg800",
        "DG800, DG900, DG2000",
        "points of a waveform",
        f"{PACKET_POINTS}, in one packet",
        f"{MENLO}: half of what the guides say",
    ),
    Assumption(
        "rigol-dg800",
        "DG4000",
        "points of a waveform",
        f"{DG4000.points}; fewer are stretched",
        "DG4000 Programming Guide, TRACe:DATA:DAC",
    ),
    Assumption(
        "rigol-dg800",
        "DG4000",
        "channel of an upload",
        "that of the front panel: it is verified that channel 1 took it",
        "DG4000 Programming Guide, TRACe:DATA:DAC (the current channel)",
        (OutputCheck.SHAPE,),
    ),
    Assumption(
        "rigol-dg800",
        DG800_SERIES,
        "points",
        "unsigned 14-bit, little-endian",
        f"range: {DG2000_GUIDE}, TRACe:DATA:DAC16; byte order: a public DG4202 driver (firmware 00.01.14), others unproven",
        (OutputCheck.SHAPE,),
    ),
    Assumption(
        "rigol-dg800",
        DG800_SERIES,
        "trigger source after a burst",
        "set anew before each",
        MENLO,
        (OutputCheck.START,),
    ),
    Assumption(
        "rigol-dg800",
        DG800_SERIES,
        "amplitude of an uneven waveform",
        "that of the converter's range",
        checks=(OutputCheck.UNEVEN,),
    ),
    Assumption(
        "rigol-dg800",
        "DG900, DG2000",
        "coupling, tracking, sum",
        "`COUP`, `TRACK`, `SUM`: off",
        f"{DG2000_GUIDE} (commands)",
        (OutputCheck.REST,),
    ),
    Assumption(
        "rigol-dg800",
        "DG4000",
        "noise, modulation, coupling",
        "`OUTP:NOIS`, `MOD`, `COUP`: off, where the model knows them",
        "a public DG4202 driver (firmware 00.01.14)",
        (OutputCheck.REST,),
    ),
)
