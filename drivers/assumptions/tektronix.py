"""What the driver of the Tektronix generators assumes of its families."""

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import TM_DEVICES

TEKTRONIX_SERIES = "AFG3000, AFG31000, AFG1000"

TEKTRONIX = (
    Assumption(
        "tektronix-afg",
        "AFG31000",
        "sequencer",
        "`SEQC:STAT OFF`, where the model knows it",
        "AlphaOmegaSemiconductor/pymeasure at 2f4caa0, after programmer manual 077-148-803",
        (OutputCheck.REST,),
    ),
    Assumption("tektronix-afg", "AFG31000", "edit memory", "65 536 points are used, of 131 072", TM_DEVICES),
    Assumption(
        "tektronix-afg", "AFG3000", "smallest amplitude used", "100 mVpp into a high-impedance load", TM_DEVICES
    ),
    Assumption(
        "tektronix-afg",
        "AFG3000, AFG31000",
        "channels tied together",
        "`CONC:STAT` and `COMB:FEED`: off",
        TM_DEVICES,
        (OutputCheck.REST,),
    ),
    Assumption(
        "tektronix-afg",
        "AFG1000",
        "load",
        "High Z, set by hand; measured at arming",
        "asvela/tektronix-func-gen at 30f7406",
        (OutputCheck.REST, OutputCheck.OFFSET, OutputCheck.SCALE),
    ),
    Assumption("tektronix-afg", "AFG1000", "`DATA:DEF`, `BURS:TDEL`, `FREQ:MODE`", "as on an AFG3000"),
)
