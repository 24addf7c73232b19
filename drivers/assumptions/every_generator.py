"""What the drivers of all function generators assume alike, each with its own evidence."""

from collections.abc import Iterator

from drivers.assumptions.assumption import Assumption, OutputCheck
from drivers.assumptions.evidence import (
    BENCHCTRL,
    COMMANDS_33500,
    DG1000Z_GUIDE,
    DG2000_GUIDE,
    EDU_GUIDE,
    GUIDE_33220,
    MENLO,
    PYMEASURE,
    QCODES,
    QMI,
    TM_DEVICES,
    XFEL,
)
from drivers.assumptions.keysight import OLDER_KEYSIGHT, TRUEFORM
from drivers.assumptions.rigol import DG800_SERIES
from drivers.assumptions.siglent import SIGLENT_SERIES
from drivers.assumptions.tektronix import TEKTRONIX_SERIES
from drivers.generators.burst_generator import BurstGenerator
from drivers.generators.keysight_33200 import Keysight33200
from drivers.generators.keysight_33500 import Keysight33500
from drivers.generators.rigol_dg import RigolDg
from drivers.generators.rigol_dg800 import RigolDg800
from drivers.generators.siglent_sdg import SiglentSdg
from drivers.generators.tektronix_afg import TektronixAfg

SURGES = {"rigol-dg": f"contradicted by {MENLO} for a DG1000Z at another offset than 0: look at the trace"}

IDLE_LEVELS: tuple[tuple[str, str, type[BurstGenerator], str, str], ...] = (
    (
        "keysight-33500",
        TRUEFORM,
        Keysight33500,
        "the first point of the waveform is 0",
        f"{EDU_GUIDE} p. 138, 160 (a burst begins and ends at its start phase, 0 degrees are the first point); others unproven",
    ),
    (
        "keysight-33200",
        OLDER_KEYSIGHT,
        Keysight33200,
        "the first point of the waveform is 0",
        f"{GUIDE_33220} p. 112, 227; 33210A guide p. 215; G5100A: unproven",
    ),
    (
        "rigol-dg",
        "DG1000Z",
        RigolDg,
        "`BURS:IDLE FPT`, the first point of the waveform, is the middle of its range",
        f"{DG1000Z_GUIDE} 2-165, {QCODES} (the setting)",
    ),
    (
        "rigol-dg800",
        DG800_SERIES,
        RigolDg800,
        "`BURS:IDLE FPT`, which a DG4000 does not have: the first point of the waveform is the middle of its range",
        f"{DG2000_GUIDE} p. 2-63 (the default); DG4000: unproven",
    ),
    ("siglent-sdg", SIGLENT_SERIES, SiglentSdg, "the first point of the waveform is 0", ""),
    (
        "tektronix-afg",
        TEKTRONIX_SERIES,
        TektronixAfg,
        "the first point of the waveform is the middle of its range; AFG31000: `BURS:IDLE START`",
        f"AFG31000: {XFEL} (BURSt:IDLE: START is the first point); others unproven",
    ),
)

POLARITY = {
    "keysight-33500": f"{COMMANDS_33500}; {EDU_GUIDE} p. 93 (about the offset)",
    "keysight-33200": f"{GUIDE_33220} p. 67, 190 (about the offset); {PYMEASURE} (keysight33250A)",
    "rigol-dg": "Rigol DG4000 Programming Guide, OUTPut:POLarity (about the offset); DG1000Z has the same command",
    "rigol-dg800": f"{DG2000_GUIDE}, OUTPut:POLarity (about the offset); Rigol DG4000 Programming Guide",
    "siglent-sdg": f"{BENCHCTRL}: `OUTP PLRT` and `INVT`; about the offset: unproven",
    "tektronix-afg": f"{TM_DEVICES} (AFG3000: relative to the offset level); AFG31000: {QMI} (the setting); AFG1000: unproven",
}

AFTER = {
    "keysight-33200": f"{GUIDE_33220} p. 225 (of gated bursts: the level of the starting phase)",
    "rigol-dg": f"{MENLO} (the first voltage of the waveform)",
}

VOLTS = {"keysight-33200": f"{GUIDE_33220} p. 63, 182, 184"}

MODULATION = {
    "keysight-33200": f"{GUIDE_33220} p. 228",
    "rigol-dg": f"{DG2000_GUIDE}, BURSt:STATe; DG1000Z: unproven",
    "rigol-dg800": f"{DG2000_GUIDE}, BURSt:STATe; others unproven",
}

USB = {"keysight-33500": "pyvisa-py issue 286 (a 33622A hung above 1 MB: 200 000 points at most); others unproven"}
"""With pyvisa-py up to 0.8.1 each packet is a transfer of its own; its pull request 628 is in no release yet."""

ABORT = {"keysight-33500": f"{COMMANDS_33500}: it halts a burst; where it leaves the output: unproven"}

RANGE_HOLD = {
    "keysight-33500": f"{PYMEASURE} (VOLT:RANG:AUTO); {EDU_GUIDE} p. 85, 91; the gap without it: E1441A guide p. 99",
    "keysight-33200": f"{GUIDE_33220} p. 66, 186, 332; Picotest G5100A guide p. 166; the gap without it: E1441A guide p. 99",
    "rigol-dg": f"{DG1000Z_GUIDE} 2-185",
}


def every_generator() -> Iterator[Assumption]:
    """Yield what the drivers of all function generators assume alike, by driver."""
    for driver, models, kind, how_idle, evidence in IDLE_LEVELS:
        yield from _assumptions_of(driver, models, kind, how_idle, evidence)


def _assumptions_of(
    driver: str, models: str, kind: type[BurstGenerator], how_idle: str, evidence: str
) -> Iterator[Assumption]:
    """Yield what one driver of a function generator assumes as all do."""
    idle = f"the offset: {how_idle}"
    yield Assumption(driver, models, "level between bursts", idle, evidence, (OutputCheck.REST,))
    yield Assumption(
        driver, models, "level after a burst", "as between bursts", AFTER.get(driver, ""), (OutputCheck.AFTER,)
    )
    yield Assumption(
        driver,
        models,
        "polarity",
        "not inverted; an inverted one flips about the offset",
        POLARITY[driver],
        (OutputCheck.POLARITY,),
    )
    yield Assumption(
        driver,
        models,
        "volts of the offset",
        "those of the open output",
        VOLTS.get(driver, ""),
        (OutputCheck.REST, OutputCheck.OFFSET),
    )
    yield Assumption(
        driver,
        models,
        "volts of an even waveform",
        "the amplitude, peak to peak at the open output",
        VOLTS.get(driver, ""),
        (OutputCheck.SCALE,),
    )
    if kind is not SiglentSdg:  # reset and read back there
        off = "switched off by burst mode"
        yield Assumption(driver, models, "modulation", off, MODULATION.get(driver, ""), (OutputCheck.SHAPE,))
    if kind is not SiglentSdg:  # refused there
        yield Assumption(
            driver, models, "uploads over USB", "arrive whole, in transfers of one packet", USB.get(driver, "")
        )
    yield Assumption(driver, models, "trigger", "each starts a drive", checks=(OutputCheck.START,))
    yield Assumption(
        driver, models, "a level held as one waveform", "steady to its planned end", checks=(OutputCheck.LONG_LEVEL,)
    )
    yield Assumption(driver, models, "start of a burst", "no surge", SURGES.get(driver, ""), (OutputCheck.SHAPE,))
    within = f"within {kind.IDLE_AMPLITUDE_VPP / 2 * 1e3:g} mV of the offset"
    yield Assumption(
        driver,
        models,
        "output while a waveform is uploaded and selected",
        f"stays {within}" if kind.CAN_FREEZE_RANGE else "stays at the offset",
        checks=(OutputCheck.SETTINGS,),
    )
    if kind.CAN_FREEZE_RANGE:
        held = "none: the range is held"
        yield Assumption(
            driver, models, "relay at a change of amplitude", held, RANGE_HOLD[driver], (OutputCheck.AMPLITUDE,)
        )
        how = f"plays {within} meanwhile" if driver != "keysight-33500" else f"`ABORt` ends it {within}"
        yield Assumption(driver, models, "abort in mid-burst", how, ABORT.get(driver, ""), (OutputCheck.STOP,))
    else:
        never = "possible: the amplitude is never changed at rest or in a drive"
        yield Assumption(driver, models, "relay at a change of amplitude", never)
        yield Assumption(driver, models, "Stop in mid-burst", "waits for its end, at rest", checks=(OutputCheck.STOP,))
        hastened = "plays the rest of it faster; used to end a level only where commissioning has recorded it"
        yield Assumption(driver, models, "change of frequency in mid-burst", hastened)
