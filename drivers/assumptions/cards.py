"""What the drivers of the card's inputs and output assume."""

from drivers.assumptions.assumption import Assumption, OutputCheck

CARD_INPUT, CARD_OUTPUT = "card", "card-output"
"""Where the table names a driver: the card that measures, and the driver of its analogue output."""

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
        "replaces samples not yet on their way; where NI's driver holds it back, Stop keeps the sample that was reached and "
        "leaves it in a line",
        checks=(OutputCheck.STOP,),
    ),
    Assumption(CARD_OUTPUT, "all", "lost connection in mid-drive", "the drive plays on", checks=(OutputCheck.WIRE,)),
)
