"""What the driver of the DC supplies assumes."""

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import PYMEASURE

SUPPLIES = (
    Assumption(
        "dc-supply",
        "E36300",
        "over-current protection",
        "off: it acts at the current limit",
        "public E36312A adapter (CURR:PROT:STAT)",
    ),
    Assumption("dc-supply", "E3632A, E3633A, E3634A", "over-current protection", "off", "E3632A guide p. 88"),
    Assumption(
        "dc-supply",
        "DP800",
        "over-current protection",
        "off: it switches the output off",
        "DP800 Programming Guide p. 2-57",
    ),
    Assumption(
        "dc-supply",
        "E36300",
        "pairing of outputs",
        "`OUTP:PAIR OFF`, where the model knows it",
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    ),
    Assumption("dc-supply", "E3631A, E3646A-E3649A, DP800", "tracking", "off, where the model knows it"),
    Assumption(
        "dc-supply",
        "SPD3303",
        "series or parallel",
        "bit 3 of the status word; `OUTP:TRACK 0` ends it",
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    ),
    Assumption("dc-supply", "E36100, E36231A, E36232A", "channel lists", "none"),
    Assumption(
        "dc-supply",
        "E3640A-E3649A",
        "commands",
        "without channel lists; two outputs by `INST:NSEL`",
        f"{PYMEASURE} (keysightE364xA)",
    ),
    Assumption("dc-supply", "E3631A", "output off", "up to 0.6 V of the other sign: never sent", "E3631A manual p. 79"),
    Assumption(
        "dc-supply",
        "all",
        "volts of the level",
        "those of the loaded output",
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    ),
    Assumption("dc-supply", "all", "held level", "steady", checks=(OutputCheck.LONG_LEVEL,)),
    Assumption(
        "dc-supply",
        "all",
        "output while the level is stepped",
        "between the two levels",
        checks=(OutputCheck.SETTINGS,),
    ),
    Assumption(
        "dc-supply",
        "all",
        "fall of the output",
        "within `fall_time_s`, measured by its own voltmeter",
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    ),
)
