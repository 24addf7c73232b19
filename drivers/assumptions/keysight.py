"""What the drivers of the Keysight generators assume of their own families."""

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import COMMANDS_33500, EDU_GUIDE, GUIDE_33220, PYMEASURE
from drivers.generators.keysight_33200 import FULL_SCALES, Keysight33200
from drivers.generators.keysight_33500 import Keysight33500

TRUEFORM = "33500B, 33600A, EDU33210, FG33530"
OLDER_KEYSIGHT = "33210A, 33220A, 33250A, G5100A"

KEYSIGHT_33500 = (
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "amplitude of an uneven waveform",
        "its span",
        "Keysight community thread 22573 (33522B)",
        (OutputCheck.UNEVEN,),
    ),
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "smallest amplitude used",
        f"{Keysight33500.IDLE_AMPLITUDE_VPP * 1e3:g} mVpp into a high-impedance load",
        "a public 33522A driver: minimum 2 mVpp",
    ),
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "filter STEP",
        "smooths without overshoot",
        checks=(OutputCheck.SHAPE, OutputCheck.LONG_LEVEL),
    ),
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "output limits",
        "before or after inversion: not relied on",
    ),
    Assumption(
        "keysight-33500",
        "EDU33210",
        "points",
        "1 000 000 at most, smoothed by the filter STEP",
        f"{EDU_GUIDE} p. 156",
    ),
    Assumption("keysight-33500", "FG33530", "commands", "those of a 33500B"),
    Assumption(
        "keysight-33500",
        "EDU33210, FG33530",
        "`ABORt`, byte order, `DATA:ARB`",
        "as on a 33500B: arming is refused if one is unknown",
    ),
    Assumption(
        "keysight-33500",
        "two channels",
        "combining, coupling, tracking",
        "`COMB:FEED`, `VOLT:COUP`, `FREQ:COUP`, `TRAC`: off",
        f"{COMMANDS_33500}; {EDU_GUIDE} p. 151",
        (OutputCheck.REST,),
    ),
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "gating",
        "`OUTP:MODE NORM`, where the model knows it",
        f"{COMMANDS_33500} (GATed: by the trigger input)",
        (OutputCheck.REST, OutputCheck.OFFSET),
    ),
)

KEYSIGHT_33200 = (
    Assumption(
        "keysight-33200",
        OLDER_KEYSIGHT,
        "amplitude of an uneven waveform",
        "its span",
        f"{GUIDE_33220} p. 59, 237 (the built-in Sinc, with a span of 61 % of the converter's, ends at 6.087 of 10 Vpp)",
        (OutputCheck.UNEVEN,),
    ),
    Assumption(
        "keysight-33200",
        OLDER_KEYSIGHT,
        "smallest amplitude",
        f"{Keysight33200.MIN_AMPLITUDE_VPP * 1e3:g} mVpp into a high-impedance load",
        f"{GUIDE_33220} p. 182, 189; {PYMEASURE} (agilent33220A: limits double with High Z)",
    ),
    Assumption(
        "keysight-33200",
        OLDER_KEYSIGHT,
        "smallest amplitude in a held range",
        "the same; where it is not taken, arming is refused and the output stays off",
        f"{GUIDE_33220} p. 66: it may not be reached",
    ),
    Assumption(
        "keysight-33200",
        "33250A",
        "converter",
        f"-{FULL_SCALES['33250']} to {FULL_SCALES['33250']}",
        "Agilent's Visual Basic sample for the 33250A",
    ),
    Assumption(
        "keysight-33200",
        "33210A, 33220A, G5100A",
        "converter",
        "±8191, big-endian",
        f"{GUIDE_33220} p. 237, 239; G5100A: unproven",
        (OutputCheck.SHAPE,),
    ),
)
