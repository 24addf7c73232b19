"""Settings of the previous user that would change the drive: corrected at arming, shown by the amplifier's input volts."""

from functools import cache

import pytest

from drivers.drive_shapes import Steps
from drivers.errors import LinkError
from drivers.generators.burst import BurstGenerator
from drivers.transport.scpi import Link, ScpiSession
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.parameters import SimulationParameters
from tests.helpers.front_panel import press
from tests.helpers.generators import BOXES
from tests.helpers.simulated_bench import assert_safe_voltage, simulated

FOREIGN_SETTINGS = {
    "33522B": (
        "OUTP:POL INV",
        "OUTP:MODE GAT",
        "TRIG:DEL 2",
        "FUNC:ARB:ADV TRIG",
        "INIT1:CONT OFF",
        "SOUR1:RATE:COUP ON",
        "SOUR1:COMB:FEED CH2",
        "SOUR1:VOLT:COUP ON",
        "SOUR1:FREQ:COUP ON",
        "SOUR1:TRAC ON",
        "SOUR2:TRAC INV",
    ),
    "33511B": ("OUTP:POL INV", "OUTP:MODE GAT", "INIT1:CONT OFF", "TRIG:DEL 0.003", "FUNC:ARB:ADV TRIG"),
    "EDU33212A": ("OUTP:POL INV", "SOUR1:COMB:FEED CH2", "SOUR1:VOLT:COUP ON", "SOUR1:TRAC ON", "SOUR2:TRAC INV"),
    "FG33532A": ("OUTP:POL INV", "SOUR1:COMB:FEED CH2"),
    "G5100A": ("OUTP:POL INV", "TRIG:DEL 2"),
    "33220A": ("OUTP:POL INV", "TRIG:DEL 2"),
    "33250A": ("OUTP:POL INV", "TRIG:DEL 2"),
    "33210A": ("OUTP:POL INV", "TRIG:DEL 2"),
    "DG1032Z": (
        ":OUTP1:POL INV",
        ":OUTP1:MODE GAT",
        ":SOUR1:BURS:TDEL 2",
        ":COUP ON",
        ":SOUR1:TRACK INV",
        ":SOUR2:TRACK ON",
        ":SOUR1:SUM ON",
    ),
    "DG811": (":OUTP1:POL INV", ":SOUR1:BURS:TDEL 0.003"),
    "DG972": (
        ":OUTP1:POL INV",
        ":COUP ON",
        ":COUP1:TRI ON",
        ":COUP2:TRI ON",
        ":SOUR1:TRACK INV",
        ":SOUR2:TRACK ON",
        ":SOUR1:SUM ON",
    ),
    "DG4162": (":OUTP1:POL INV", ":OUTP1:NOIS ON", ":SOUR1:MOD ON", ":COUP ON", ":SOUR2:FUNC USER"),
    "AFG3022C": (
        "OUTP1:POL INV",
        'SOUR1:COMB:FEED "EXTERNAL"',
        "SOUR2:VOLT:CONC:STAT ON",
        "SOUR1:FREQ:CONC:STAT ON",
    ),
    "AFG3021C": ("OUTP1:POL INV", "SOUR1:BURS:TDEL 2", 'SOUR1:COMB:FEED "EXTERNAL"'),
    "AFG31022": ("OUTP1:POL INV", "SEQC:STAT ON", "SOUR1:BURS:IDLE END"),
    "AFG1022": ("OUTP1:POL INV",),
}
"""What each model's previous user may leave, by the model: polarity, gating, the other channel added, coupled or tracked."""

DRIVERS = {
    "335": "33511B",
    "332": "33220A",
    "EDU": "33511B",
    "FG3": "33511B",
    "G51": "33220A",
    "DG1": "DG1032Z",
    "DG": "DG812",
    "AFG": "AFG3022C",
}
PRESENT = {"AFG31022": "sequencer=present", "AFG1022": "polarity=present", "DG4162": "noise=present"}
CASES = [(model, setting) for model, settings in FOREIGN_SETTINGS.items() for setting in settings]


@cache
def parameters(model: str, traits: str = "") -> SimulationParameters:
    return simulated(generator={"model": model, "traits": traits}).simulation_parameters


def opened(model: str, traits: str = "") -> tuple[BurstGenerator, SimulatedBench, Link]:
    bench = SimulatedBench(parameters(model, traits), VirtualClock())
    family = next(driver for start, driver in DRIVERS.items() if model.startswith(start))
    return BOXES[family](bench.link(), bench.clock), bench, bench.link()


def play_to_one_side(source: BurstGenerator, bench: SimulatedBench) -> None:
    """Play 480 V to the positive side: inverted it would be -480 V."""
    bench.enable_hv()
    source.start_drive(Steps((2.5, 3.3, 2.5), 0.05, 0.05))
    bench.clock.sleep(0.4)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.highest_v == pytest.approx(3.3, abs=0.02)
    assert report.lowest_v == pytest.approx(2.5, abs=0.02)


@pytest.mark.parametrize(("model", "setting"), CASES)
def test_arming_corrects_what_the_previous_user_left(model: str, setting: str) -> None:
    source, bench, panel = opened(model, PRESENT.get(model, ""))
    press(panel, setting)
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    play_to_one_side(source, bench)


@pytest.mark.parametrize(("model", "setting"), CASES)
def test_a_setting_changed_between_two_runs_is_noticed_and_corrected(model: str, setting: str) -> None:
    source, bench, panel = opened(model, PRESENT.get(model, ""))
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    press(panel, setting)
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    play_to_one_side(source, bench)


ABSENT = [
    ("AFG1022", "polarity=absent"),
    ("DG4162", "noise=absent"),
    ("AFG3021C", ""),
    ("DG811", ""),
    ("AFG31022", "sequencer=absent idle-setting=END"),
]


@pytest.mark.parametrize("unknown", ["rest-of-message", "whole-message"])
@pytest.mark.parametrize(("model", "trait"), ABSENT)
def test_a_model_without_such_a_setting_is_armed_all_the_same(model: str, trait: str, unknown: str) -> None:
    """It answers no query of an unknown header, and says so in its error queue; some do not read the rest of the message."""
    source, bench, _ = opened(model, f"{trait} unknown-header={unknown}".strip())
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert bench.clock.now() < 2.0, "a reply timeout passed"
    assert source.is_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    play_to_one_side(source, bench)


class ScriptedLink:
    """A link that replies from a dictionary keyed by the messages sent so far, and stays silent without an entry."""

    def __init__(self, name: str, replies: dict[str, tuple[str, ...]]) -> None:
        self.name, self._replies = name, replies
        self.sent: list[str] = []
        self._due: list[str] = []

    def write(self, message: str) -> None:
        self.sent.append(message)
        self._due += self._replies.get(" ".join(self.sent), ())

    def read(self) -> str:
        if not self._due:
            raise LinkError("silence")
        return self._due.pop(0)

    def clear(self) -> None:
        self._due.clear()

    reopen = close = clear


SOCKET, USB = "TCPIP::192.0.2.7::5025::SOCKET", "USB0::0x0699::0x0346::C01::INSTR"
NONE, UNKNOWN, NO_CHANNEL = '0,"No error"', '-113,"Undefined header"', '-114,"Header suffix out of range"'


@pytest.mark.one_in(1)
@pytest.mark.parametrize(
    ("name", "replies", "answer"),
    [
        pytest.param(SOCKET, {"X?": ("OFF",), "X? SYST:ERR?": (NONE,)}, "OFF", id="known"),
        pytest.param(SOCKET, {"X? SYST:ERR?": (UNKNOWN,)}, None, id="unknown"),
        pytest.param("ASRL3", {"X? SYST:ERR?": (NO_CHANNEL,)}, None, id="no-such-channel"),
        pytest.param(SOCKET, {"X?": ("OFF",)}, "OFF", id="second-message-lost"),
        pytest.param(SOCKET, {"X? SYST:ERR? SYST:ERR?": (UNKNOWN,)}, None, id="unknown-and-second-message-lost"),
        pytest.param(SOCKET, {"X? SYST:ERR?": ('-410,"Query INTERRUPTED"',), "X? SYST:ERR? X?": ("0",)}, "0", id="reply-discarded"),
        pytest.param(USB, {"X?": ("OFF",)}, "OFF", id="usb"),
        pytest.param(USB, {"X? SYST:ERR?": (NO_CHANNEL,)}, None, id="usb-no-such-channel"),
    ],
)  # fmt: skip
def test_an_optional_setting_is_known_or_unknown_whatever_becomes_of_the_second_message(
    name: str, replies: dict[str, tuple[str, ...]], answer: str | None
) -> None:
    assert ScpiSession(ScriptedLink(name, replies), "box").query_optional("X?") == answer


def test_an_optional_setting_that_is_known_and_not_answered_is_an_error() -> None:
    link = ScriptedLink(SOCKET, {"X? SYST:ERR?": (NONE,), "X? SYST:ERR? X? SYST:ERR?": (NONE,)})
    with pytest.raises(LinkError, match="no answer to 'X"):
        ScpiSession(link, "box").query_optional("X?")
