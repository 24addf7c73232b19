"""SCPI engine: accepts what an instrument accepts, and reports its error numbers for the rest."""

import math

import pytest

from sim_hardware.wires.scpi_engine import (
    ScpiCommand,
    ScpiEngine,
    ScpiError,
    format_real,
    header_regex,
    match_keyword,
    parse_boolean,
    parse_number,
    single_argument,
)


class Lamp:
    """A small instrument with nested commands."""

    identity = "Acme,Lamp,1,1.0"

    def __init__(self) -> None:
        self.level, self.mode, self.triggers, self.resets = 1.0, "CW", 0, 0

    @property
    def commands(self) -> list[ScpiCommand]:
        return [
            ScpiCommand("[SOURce[1]:]LEVel[:IMMediate]", self._set_level, lambda _: format_real(self.level)),
            ScpiCommand("[SOURce[1]:]LEVel:LIMit", None, lambda _: "5"),
            ScpiCommand("LAMP:MODE", self._set_mode, lambda _: self.mode),
            ScpiCommand("LAMP:STATe:HOURs", None, lambda _: "12"),
            ScpiCommand("LAMP:STATe:COUNt", None, lambda _: "3"),
        ]

    def _set_level(self, a) -> None:
        self.level = parse_number(single_argument(a), "V", 0.0, 5.0, 1.0)

    def _set_mode(self, a) -> None:
        self.mode = match_keyword(single_argument(a), "CW", "PULSed")

    def reset(self) -> None:
        self.resets += 1

    def trigger(self) -> None:
        self.triggers += 1

    def busy_s(self) -> float:
        return 0.25


@pytest.fixture
def lamp() -> Lamp:
    return Lamp()


@pytest.fixture
def engine(lamp: Lamp) -> ScpiEngine:
    return ScpiEngine(lamp)


def ask(engine: ScpiEngine, message: str) -> str | None:
    answer = engine.execute(message)
    return answer.text if answer else None


@pytest.mark.parametrize(
    ("pattern", "header", "fits"),
    [
        ("[SOURce[1]:]VOLTage[:LEVel][:IMMediate]:OFFSet", "VOLT:OFFS", True),
        ("[SOURce[1]:]VOLTage[:LEVel][:IMMediate]:OFFSet", "source1:voltage:level:immediate:offset", True),
        ("[SOURce[1]:]VOLTage[:LEVel][:IMMediate]:OFFSet", "SOUR:VOLT:IMM:OFFS", True),
        ("[SOURce[1]:]VOLTage[:LEVel][:IMMediate]:OFFSet", "SOUR2:VOLT:OFFS", False),
        ("[SOURce[1]:]VOLTage[:LEVel][:IMMediate]:OFFSet", "VOLTA:OFFS", False),
        ("OUTPut[1][:STATe]", "OUTP", True),
        ("OUTPut[1][:STATe]", "OUTP1:STAT", True),
        ("OUTPut[1][:STATe]", "OUTPU", False),
        ("*IDN", "*idn", True),
    ],
)
def test_headers_have_one_short_and_one_long_form(pattern, header, fits):
    assert bool(header_regex(pattern).match(header)) is fits


@pytest.mark.parametrize(
    ("message", "answer"),
    [
        ("*IDN?", "Acme,Lamp,1,1.0"),
        ("LEV 2;:LEV?", "+2.00000000000000E+00"),
        ("lev 250 mv;:lev?", "+2.50000000000000E-01"),
        ("LEV MAX;:SOUR1:LEV:IMM?", "+5.00000000000000E+00"),
        ("LAMP:MODE PULSED;MODE?", "PULS"),
        ("LAMP:STAT:HOUR?;COUN?", "12;3"),
        ("LAMP:STAT:HOUR?;*IDN?;COUN?", "12;Acme,Lamp,1,1.0;3"),
        ("LEV?;LEV:LIM?", "+1.00000000000000E+00;5"),
        ("  :LEV?  ", "+1.00000000000000E+00"),
        ("LEV 3", None),
        (";;", None),
    ],
)
def test_messages_and_their_answers(engine, message, answer):
    assert ask(engine, message) == answer
    assert ask(engine, "SYST:ERR?") == '+0,"No error"'


@pytest.mark.parametrize(
    ("message", "code"),
    [
        ("NONSENSE 1", -113),
        ("LAMP:MODE CW;LEV 3", -113),  # LEV is looked for under LAMP
        ("LEV:LIM 3", -113),  # query only
        ("LEV", -109),
        ("LEV 1,2", -108),
        ("LEV abc", -104),
        ("LEV 3 HZ", -131),
        ("LAMP:MODE BLINK", -224),
    ],
)
def test_refusals_carry_the_numbers_of_scpi(engine, message, code):
    assert ask(engine, message + ";:SYST:ERR?").startswith(f"{code},")


def test_one_bad_command_does_not_stop_the_rest_of_its_message(engine, lamp):
    assert ask(engine, "NONSENSE;:LEV 4;:SYST:ERR?").startswith("-113")
    assert lamp.level == 4.0


def test_the_error_queue_holds_twenty_and_tells_that_more_were_lost(engine):
    for _ in range(25):
        engine.execute("NONSENSE")
    codes = [ask(engine, "SYST:ERR?").split(",")[0] for _ in range(21)]
    assert codes == ["-113"] * 19 + ["-350", "+0"]


def test_clear_empties_queue_and_event_register(engine):
    engine.execute("NONSENSE")
    engine.execute("*CLS")
    assert ask(engine, "*ESR?;:SYST:ERR?") == '+0;+0,"No error"'
    engine.execute("NONSENSE;*OPC")
    assert ask(engine, "*ESR?") == "+33"


def test_common_commands_reach_the_instrument_and_opc_waits_for_it(engine, lamp):
    engine.execute("*RST;*TRG")
    assert (lamp.resets, lamp.triggers) == (1, 1)
    answer = engine.execute("*OPC?")
    assert answer is not None
    assert (answer.text, answer.delay_s) == ("1", 0.25)


@pytest.mark.parametrize(
    ("text", "unit", "value"),
    [
        ("5", "HZ", 5.0),
        ("5 HZ", "HZ", 5.0),
        ("5KHZ", "HZ", 5e3),
        ("2 MHZ", "HZ", 2e6),
        ("20MV", "V", 0.02),
        ("3 ms", "S", 3e-3),
        ("1.5E-3", "V", 1.5e-3),
        (".5", "V", 0.5),
        ("INF", "OHM", math.inf),
        ("MIN", "V", -1.0),
    ],
)
def test_numbers_with_units(text, unit, value):
    assert parse_number(text, unit, -1.0, 1.0) == pytest.approx(value)


def test_booleans_and_missing_keywords():
    assert [parse_boolean(t) for t in ("ON", "off", "1", "0")] == [True, False, True, False]
    with pytest.raises(ScpiError):
        parse_number("DEF", "V")
    assert float(format_real(math.inf)) == 9.9e37
