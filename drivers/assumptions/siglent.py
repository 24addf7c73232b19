"""What the driver of the Siglent generators assumes of its families."""

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import BENCHCTRL
from drivers.generators.siglent_sdg import FULL_SCALE, max_points

SIGLENT_SERIES = "SDG1000X, SDG2000X, SDG6000X, T3AFG"
DMM6500 = "dmm6500-serial-decode at 0465be2 (SDG2122X, firmware 2.01.01.38R4 and 39R7)"

SDG6022X = "a public SDG6022X driver (firmware 6.01.01.37R6 and 38R3)"

SIGLENT = (
    Assumption(
        "siglent-sdg",
        "SDG6000X",
        "header and size of an upload",
        f"with levels, little-endian, {max_points('SDG6022X')} points",
        f"{SDG6022X} (levels); size and byte order as on an SDG2000X: unproven",
        (OutputCheck.SHAPE,),
    ),
    Assumption(
        "siglent-sdg",
        "SDG6000X",
        "selection of a waveform by its name",
        "may be ignored: it is uploaded again",
        SDG6022X,
    ),
    Assumption(
        "siglent-sdg",
        "SDG2000X",
        "full-scale code",
        f"{FULL_SCALE}",
        f"{DMM6500}: 0.3309 of AMP where 0.3300 was computed",
        (OutputCheck.SCALE,),
    ),
    Assumption(
        "siglent-sdg",
        "SDG1000X, T3AFG",
        "full-scale code",
        f"{FULL_SCALE}; Siglent's application note says 8192",
        checks=(OutputCheck.SCALE,),
    ),
    Assumption(
        "siglent-sdg",
        "SDG1000X",
        "end of a waveform's message",
        "the first byte 0x0A: none is sent",
        BENCHCTRL,
    ),
    Assumption(
        "siglent-sdg",
        "SDG2000X",
        "largest upload",
        f"{max_points('SDG2122X')} points, below 65 536 bytes",
        DMM6500,
    ),
    Assumption(
        "siglent-sdg",
        "SDG1000X",
        "largest upload",
        f"{max_points('SDG1032X')} points",
        BENCHCTRL,
    ),
    Assumption("siglent-sdg", "SDG1000X, SDG2000X, SDG6000X", "uploads over USB", "lost: refused", BENCHCTRL),
    Assumption("siglent-sdg", "SDG1000X, SDG2000X, SDG6000X", "LAN clients", "one at a time", DMM6500),
    Assumption(
        "siglent-sdg",
        "SDG1000X, SDG2000X, SDG6000X",
        "selection of a waveform",
        "restores no other levels than the present ones, or is read back",
        checks=(OutputCheck.SETTINGS,),
    ),
    Assumption(
        "siglent-sdg",
        "SDG1000X, SDG2000X, SDG6000X",
        "combining, coupling, modulation, sweep",
        "off",
        f"{BENCHCTRL}; SDG2000X: PG02-E05B",
        (OutputCheck.REST,),
    ),
    Assumption(
        "siglent-sdg",
        "SDG1000X, SDG2000X, SDG6000X",
        "over-voltage protection",
        "`VOLTPRT` may open the relay",
        "PG02-E05B",
    ),
)
