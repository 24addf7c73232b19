"""Assumptions of the generator and supply drivers: what safety or a number depends on, with its evidence.

The table of docs/generators.md is written from here. The values come from the drivers where they have them. An assumption
without evidence is unproven: `tactor-bench commission` measures those that show at the output, before high voltage is on.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import StrEnum

from drivers.generators.burst_generator import BurstGenerator
from drivers.generators.keysight_33200 import FULL_SCALES, Keysight33200
from drivers.generators.keysight_33500 import Keysight33500, has_two_channels
from drivers.generators.rigol_dg import PACKET_POINTS, RigolDg
from drivers.generators.rigol_dg800 import DG4000, RigolDg800
from drivers.generators.siglent_sdg import FULL_SCALE, SiglentSdg, max_points
from drivers.generators.tektronix_afg import TektronixAfg

BENCHCTRL = "benchctrl at 0c6e51e (SDG1032X, firmware 1.01.01.33R1B6)"
DMM6500 = "dmm6500-serial-decode at 0465be2 (SDG2122X, firmware 2.01.01.38R4 and 39R7)"
PYMEASURE, QCODES, TM_DEVICES = "PyMeasure at 32503b8", "QCoDeS at 19fae2b", "tm_devices at db887dd"
MENLO = "Menlo Systems' DG1000Z driver"
GUIDE_33220A = "33220A User's Guide"
DG1000Z_GUIDE = "DG1000Z Programming Guide"
DG2000_GUIDE = "DG2000 Programming Guide (PGB12000)"
EDU_GUIDE = "EDU33210 User's Guide (EDU33212-90002)"
SDG6022X = "a public SDG6022X driver (firmware 6.01.01.37R6 and 38R3)"

TRUEFORM = "33500B, 33600A, EDU33210, FG33530"
OLDER_KEYSIGHT = "33210A, 33220A, 33250A, G5100A"
DG800_SERIES = "DG800, DG900, DG2000, DG4000"
SIGLENT_SERIES = "SDG1000X, SDG2000X, SDG6000X, T3AFG"
TEKTRONIX_SERIES = "AFG3000, AFG31000, AFG1000"

CARD_INPUT, CARD_OUTPUT = "card", "card-output"
"""Where the table names a driver: the card that measures, and the driver of its analogue output."""

SUPPLY_MODELS = ("E36", "DP8", "SPD")
"""How the names of the supplies of drivers.supplies.dialects begin."""


class OutputCheck(StrEnum):
    """What commissioning measures at the output of a source. The texts are stored in records and never change."""

    REST = "level between bursts"
    AFTER = "level after a burst"
    OFFSET = "scale of the offset"
    POLARITY = "polarity"
    SCALE = "amplitude of a sine"
    UNEVEN = "amplitude of an uneven waveform"
    SHAPE = "form of a waveform"
    SETTINGS = "output while settings change"
    AMPLITUDE = "output at a change of amplitude"
    START = "start of a drive"
    STOP = "output at Stop"
    WIRE = "output after the wire is cut"
    CROSSTALK = "crosstalk of the card's inputs"
    SETTLING = "settling of the card's inputs"
    SKEW = "skew of the card's inputs"
    START_ROUTE = "start of a drive on a scan"
    LONG_LEVEL = "long level"


@dataclass(frozen=True, slots=True)
class Assumption:
    """One property of an instrument that a driver relies on.

    Args:
        driver: name of the driver, as the bench file has it.
        models: the models it is about.
        quantity: the property.
        value: the value that the driver assumes.
        evidence: guide and page, public driver with commit, or a measurement; empty if it is unproven.
        checks: what measures it at the output; empty if it cannot be seen there.
    """

    driver: str
    models: str
    quantity: str
    value: str
    evidence: str = ""
    checks: tuple[OutputCheck, ...] = ()

    @property
    def shows_at_output(self) -> bool:
        """Whether measuring the output can confirm it."""
        return bool(self.checks)

    def is_about(self, model: str) -> bool:
        """Whether it is about a model: `DG1000Z` means DG1032Z too, `two channels` a Keysight 33522B."""
        names = self.models.split(", ")
        if "two channels" in names:
            return self.driver == "keysight-33500" and has_two_channels(model)
        is_named = _is_supply if self.driver == "dc-supply" else _is_generator
        return any(is_named(model.upper(), name) for name in names)


def _is_generator(model: str, name: str) -> bool:
    """Return whether a name of the table is that of a generator: `DG1000Z` means DG1032Z too, `AFG3000` not AFG31052."""
    digits = name.rstrip("ABCXZ")
    begin = digits.rstrip("0")
    if begin == digits:
        return model.startswith(begin)
    return re.match(re.escape(begin) + r"\d" * (len(digits) - len(begin)) + r"(?!\d)", model) is not None


def _is_supply(model: str, name: str) -> bool:
    """Return whether a name of the table is that of a supply: `E36300` means E36312A too, `E3640A-E3649A` all between."""
    if name == "all":
        return True
    first, _, last = name.partition("-")
    if last:
        return len(model) == len(first) and first <= model <= last
    digits = first.rstrip("0")
    return re.match(re.escape(digits) + r"\d" * (len(first) - len(digits)), model) is not None


def assumptions_about(model: str) -> tuple[Assumption, ...]:
    """Return the assumptions about a model of a function generator or supply; none about one without a driver of this package."""
    is_supply = model.upper().startswith(SUPPLY_MODELS)
    return tuple(
        each
        for each in assumptions()
        if each.driver not in (CARD_INPUT, CARD_OUTPUT)
        and (each.driver == "dc-supply") == is_supply
        and each.is_about(model)
    )


def assumptions_about_card(*, plays: bool) -> tuple[Assumption, ...]:
    """Return the assumptions about the card that measures, and about its output if that plays the drives."""
    return (*CARD_INPUTS, *CARD_OUTPUTS) if plays else CARD_INPUTS


def assumptions() -> Iterator[Assumption]:
    """Yield the assumptions of all generators and supplies, by driver."""
    for driver, models, kind, how_idle, evidence in IDLE_LEVELS:
        yield from _common_assumptions(driver, models, kind, how_idle, evidence)
    yield from KEYSIGHT_33500
    yield from KEYSIGHT_33200
    yield from RIGOL
    yield from SIGLENT
    yield from TEKTRONIX
    yield from SUPPLIES
    yield from CARD_INPUTS
    yield from CARD_OUTPUTS


def _common_assumptions(
    driver: str, models: str, kind: type[BurstGenerator], how_idle: str, evidence: str
) -> Iterator[Assumption]:
    """Yield what every driver of a function generator assumes."""
    idle = f"the offset: {how_idle}"
    yield Assumption(driver, models, "level between bursts", idle, evidence, (OutputCheck.REST,))
    yield Assumption(driver, models, "level after a burst", "as between bursts", checks=(OutputCheck.AFTER,))
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
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    )
    yield Assumption(
        driver,
        models,
        "volts of an even waveform",
        "the amplitude, peak to peak at the open output",
        checks=(OutputCheck.SCALE,),
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
        yield Assumption(driver, models, "abort in mid-burst", how, checks=(OutputCheck.STOP,))
    else:
        never = "possible: the amplitude is never changed at rest or in a drive"
        yield Assumption(driver, models, "relay at a change of amplitude", never)
        yield Assumption(driver, models, "Stop in mid-burst", "waits for its end, at rest", checks=(OutputCheck.STOP,))
        hastened = "plays the rest of it faster; used to end a level only where commissioning has recorded it"
        yield Assumption(driver, models, "change of frequency in mid-burst", hastened)


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
        f"{GUIDE_33220A} p. 227; 33210A guide p. 215; G5100A: unproven",
    ),
    (
        "rigol-dg",
        "DG1000Z",
        RigolDg,
        "`BURS:IDLE CENTER`",
        f"{DG1000Z_GUIDE} 2-165 (the setting); what CENTER of an uneven waveform is: unproven",
    ),
    (
        "rigol-dg800",
        DG800_SERIES,
        RigolDg800,
        "`BURS:IDLE CENTER`; on a DG4000, which has no such setting, the first point of the waveform is the middle of its range",
        f"{DG2000_GUIDE}, BURSt:IDLE (the setting); what CENTER of an uneven waveform is, and DG4000: unproven",
    ),
    ("siglent-sdg", SIGLENT_SERIES, SiglentSdg, "the first point of the waveform is 0", ""),
    (
        "tektronix-afg",
        TEKTRONIX_SERIES,
        TektronixAfg,
        "the first point of the waveform is the middle of its range; AFG31000: `BURS:IDLE START`",
        "AFG31000: a public driver (BURSt:IDLE: START is the first point); others unproven",
    ),
)

POLARITY = {
    "keysight-33500": f"{QCODES} (output_polarity); {EDU_GUIDE} p. 93 (about the offset)",
    "keysight-33200": f"{PYMEASURE} (keysight33250A)",
    "rigol-dg": "Rigol DG4000 Programming Guide, OUTPut:POLarity (about the offset); DG1000Z has the same command",
    "rigol-dg800": f"{DG2000_GUIDE}, OUTPut:POLarity; Rigol DG4000 Programming Guide (about the offset)",
    "siglent-sdg": f"{BENCHCTRL}: `OUTP PLRT` and `INVT`; about the offset: unproven",
    "tektronix-afg": f"{TM_DEVICES} (AFG3000: relative to the offset level); AFG31000, AFG1000: unproven",
}

RANGE_HOLD = {
    "keysight-33500": f"{PYMEASURE} (VOLT:RANG:AUTO); {EDU_GUIDE} p. 85, 91; the gap without it: E1441A guide p. 99",
    "keysight-33200": "E1441A guide p. 99, Picotest G5100A guide p. 166",
    "rigol-dg": f"{DG1000Z_GUIDE} 2-185",
}

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
    Assumption("keysight-33500", TRUEFORM, "filter STEP", "smooths without overshoot", checks=(OutputCheck.SHAPE,)),
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
        "public 33512B adapter and agilent33500 driver, EDU33210 guide p. 151 (commands); their effect on the output: unproven",
        (OutputCheck.REST,),
    ),
    Assumption(
        "keysight-33500",
        TRUEFORM,
        "gating",
        "`OUTP:MODE NORM`, where the model knows it",
        checks=(OutputCheck.REST, OutputCheck.OFFSET),
    ),
)

KEYSIGHT_33200 = (
    Assumption(
        "keysight-33200",
        OLDER_KEYSIGHT,
        "amplitude of an uneven waveform",
        "its span",
        checks=(OutputCheck.UNEVEN,),
    ),
    Assumption(
        "keysight-33200",
        OLDER_KEYSIGHT,
        "smallest amplitude",
        f"{Keysight33200.MIN_AMPLITUDE_VPP * 1e3:g} mVpp into a high-impedance load",
        f"{PYMEASURE} (agilent33220A: limits double with High Z)",
    ),
    Assumption(
        "keysight-33200",
        "33250A",
        "converter",
        f"±{FULL_SCALES['33250']}",
        "Agilent's Visual Basic sample for the 33250A",
    ),
    Assumption(
        "keysight-33200",
        "33210A, 33220A, G5100A",
        "converter",
        "±8191, big-endian",
        f"{PYMEASURE} (agilent33220A); G5100A: unproven",
        (OutputCheck.SHAPE,),
    ),
)

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
        "nominal-io/instro (rigol_dg1022z)",
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

TEKTRONIX = (
    Assumption(
        "tektronix-afg",
        "AFG31000",
        "sequencer",
        "`SEQC:STAT OFF`, where the model knows it",
        "a public driver after programmer manual 077-148-803",
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
        "asvela/tektronix-func-gen",
        (OutputCheck.REST, OutputCheck.OFFSET, OutputCheck.SCALE),
    ),
    Assumption("tektronix-afg", "AFG1000", "`DATA:DEF`, `BURS:TDEL`, `FREQ:MODE`", "as on an AFG3000"),
)

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

NI_SKEW = "NI-DAQmx: AI Convert Clock, read from the task"
NI_LAST_SAMPLE = "NI-DAQmx help, Running to Committed State ('typically'); AllenInstitute/MIES issue 1774"

CARD_INPUTS = (
    Assumption(
        CARD_INPUT,
        "all",
        "settling and ghosting",
        "an input shows less than 1 % of the one converted before it",
        "NI knowledge base kA03q000000YHy6CAG (ghosting of open inputs and of sources above 1 kOhm)",
        (OutputCheck.CROSSTALK, OutputCheck.SETTLING),
    ),
    Assumption(CARD_INPUT, "all", "channel skew", "the conversion interval of the task", NI_SKEW, (OutputCheck.SKEW,)),
    Assumption(CARD_INPUT, "all", "time of the first scan", "that of the reply to the start, or by the count of scans"),
    Assumption(CARD_INPUT, "all", "scaling", "the card's own coefficients", "NI-DAQmx: AI Device Scaling Coefficients"),
)
"""What cannot be seen: the time of the first scan needs a common clock, the scaling a voltmeter."""

CARD_OUTPUTS = (
    Assumption(CARD_OUTPUT, "all", "level between drives", "the last sample", NI_LAST_SAMPLE, (OutputCheck.REST,)),
    Assumption(CARD_OUTPUT, "all", "level after a drive", "as before it", NI_LAST_SAMPLE, (OutputCheck.AFTER,)),
    Assumption(
        CARD_OUTPUT,
        "all",
        "volts of the output",
        "those of its scaling",
        checks=(OutputCheck.OFFSET, OutputCheck.POLARITY, OutputCheck.SCALE, OutputCheck.UNEVEN, OutputCheck.SHAPE),
    ),
    Assumption(
        CARD_OUTPUT,
        "all",
        "start of a drive",
        "each starts, from its first sample",
        checks=(OutputCheck.START,),
    ),
    Assumption(
        CARD_OUTPUT,
        "all",
        "start route",
        "with `start_trigger` each drive starts on a scan of the input",
        checks=(OutputCheck.START_ROUTE,),
    ),
    Assumption(CARD_OUTPUT, "all", "held level", "steady while it is renewed", checks=(OutputCheck.LONG_LEVEL,)),
    Assumption(CARD_OUTPUT, "all", "output while the next drive is written", "stays", checks=(OutputCheck.SETTINGS,)),
    Assumption(
        CARD_OUTPUT,
        "all",
        "output queue",
        "what is in flight is accounted for: Stop joins it without a step",
        checks=(OutputCheck.STOP,),
    ),
    Assumption(
        CARD_OUTPUT,
        "all",
        "rewriting of a playing drive",
        "replaces samples not yet on their way, and is not held back by NI's protection against glitches",
        checks=(OutputCheck.STOP,),
    ),
    Assumption(CARD_OUTPUT, "all", "lost connection in mid-drive", "the drive plays on", checks=(OutputCheck.WIRE,)),
)
