"""What an armed generator must read back as, what it does with another program's burst, and how it comes down in any case."""

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest

from app.drivers import open_generator
from drivers.burst_generator import BurstGenerator
from drivers.clock import WallClock
from drivers.drive import Hold, Sine, Steps
from drivers.errors import InstrumentError, LinkError
from drivers.scpi import Link
from drivers.visa import VisaLink
from sim_hardware.bench import VirtualBench
from sim_hardware.clock import VirtualClock
from sim_hardware.served import ServedBench
from tests.contract.test_sources import BOXES, truth
from tests.support import simulated, volts_are_safe

KEYSIGHT = {
    "VOLT:UNIT VRMS": "VOLT:UNIT VPP",
    "VOLT:OFFS 2.51": "VOLT:OFFS 2.5",
    "BURS:STAT OFF": "BURS:STAT ON",
    "BURS:MODE GAT": "BURS:MODE TRIG",
    "BURS:NCYC INF": "BURS:NCYC 1",
    "BURS:PHAS 90": "BURS:PHAS 0",
    "TRIG:SOUR EXT": "TRIG:SOUR BUS",
    "UNIT:ANGL RAD": "UNIT:ANGL DEG",
    "VOLT 0.5": "VOLT 0.01",
    "VOLT:RANG:AUTO ON": "VOLT:RANG:AUTO OFF",
    "OUTP OFF": "OUTP ON",
}
CHANGES: dict[str, dict[str, str]] = {
    "33511B": {
        **KEYSIGHT,
        "FUNC SIN": "FUNC ARB",
        "FORM:BORD NORM": "FORM:BORD SWAP",
        "FUNC:ARB:FILT OFF": "FUNC:ARB:FILT STEP",
        "VOLT:LIM:LOW -1": "VOLT:LIM:LOW -0.005",
        "VOLT:LIM:HIGH 6": "VOLT:LIM:HIGH 5.005",
        "VOLT:LIM:STAT OFF": "VOLT:LIM:STAT ON",
    },
    "33220A": {
        **KEYSIGHT,
        "FUNC SIN": "FUNC USER",
        "FORM:BORD SWAP": "FORM:BORD NORM",
        "OUTP:LOAD 50": "OUTP:LOAD INF",
    },
    "DG1032Z": {
        ":OUTP1:LOAD 50": ":OUTP1:LOAD INF",
        ":SOUR1:VOLT:UNIT VRMS": ":SOUR1:VOLT:UNIT VPP",
        ":SOUR1:VOLT:OFFS 2.51": ":SOUR1:VOLT:OFFS 2.5",
        ":SOUR1:BURS:STAT OFF": ":SOUR1:BURS:STAT ON",
        ":SOUR1:BURS:MODE GAT": ":SOUR1:BURS:MODE TRIG",
        ":SOUR1:BURS:NCYC INF": ":SOUR1:BURS:NCYC 1",
        ":SOUR1:BURS:PHAS 90": ":SOUR1:BURS:PHAS 0",
        ":SOUR1:BURS:TRIG:SOUR EXT": ":SOUR1:BURS:TRIG:SOUR MAN",
        ":SOUR1:BURS:IDLE TOP": ":SOUR1:BURS:IDLE CENTER",
        ":SOUR1:FUNC:ARB:MODE FREQ": ":SOUR1:FUNC:ARB:MODE SRAT",
        ":SOUR1:VOLT 0.5": ":SOUR1:VOLT 0.01",
        ":SOUR1:VOLT:RANG:AUTO ON": ":SOUR1:VOLT:RANG:AUTO OFF",
        ":OUTP1 OFF": ":OUTP1 ON",
    },
    "SDG1032X": {
        "C1:OUTP LOAD,50": "C1:OUTP LOAD,HZ",
        "C1:OUTP PLRT,INVT": "C1:OUTP PLRT,NOR",
        "C1:BSWV AMP,4": "C1:BSWV AMP,5",
        "C1:BSWV OFST,2.51": "C1:BSWV OFST,2.5",
        "C1:BTWV STATE,OFF": "C1:BTWV STATE,ON",
        "C1:BTWV TRSR,EXT": "C1:BTWV TRSR,MAN",
        "C1:BTWV STPS,90": "C1:BTWV STPS,0",
        "C1:OUTP OFF": "C1:OUTP ON",
    },
    "AFG3022C": {
        "OUTP1:IMP 50": "OUTP1:IMP INF",
        "SOUR1:VOLT:UNIT VRMS": "SOUR1:VOLT:UNIT VPP",
        "SOUR1:VOLT:OFFS 2.51": "SOUR1:VOLT:OFFS 2.5",
        "SOUR1:BURS:STAT OFF": "SOUR1:BURS:STAT ON",
        "SOUR1:BURS:MODE GAT": "SOUR1:BURS:MODE TRIG",
        "SOUR1:BURS:NCYC INF": "SOUR1:BURS:NCYC 1",
        "SOUR1:BURS:TDEL 0.5": "SOUR1:BURS:TDEL 0",
        "TRIG:SOUR TIM": "TRIG:SOUR EXT",
        "SOUR1:VOLT 4": "SOUR1:VOLT 5",
        "SOUR1:VOLT:LIM:LOW -4": "SOUR1:VOLT:LIM:LOW -2.5",
        "SOUR1:VOLT:LIM:HIGH 8": "SOUR1:VOLT:LIM:HIGH 7.5",
        "OUTP1:STAT OFF": "OUTP1:STAT ON",
    },
}
"""What a hand at the front panel may change between two runs, and what mends it."""

RANGE_ASIDE = "RANG:AUTO"
"""Frozen anew, the range is another one: only a new preparation mends it."""


def made(model: str) -> tuple[BurstGenerator, VirtualBench, Link]:
    bench = VirtualBench(truth(model), VirtualClock())
    link = bench.link()
    return BOXES[model](link, bench.clock), bench, bench.link()


def press(panel: Link, command: str) -> None:
    panel.write(f"{command};*IDN?")
    panel.read()


def panel_reads(panel: Link, *questions: str) -> list[float]:
    return [float(asked(panel, question)) for question in questions]


def asked(panel: Link, question: str) -> str:
    panel.write(question)
    return panel.read()


@pytest.mark.parametrize("model", CHANGES)
def test_whatever_is_changed_at_the_front_panel_between_two_runs_is_noticed(model: str) -> None:
    source, _, panel = made(model)
    source.prepare(2.5, 0.0, 5.0)
    for change, mend in CHANGES[model].items():
        assert source.at_rest(2.5, 0.0, 5.0), f"before {change}"
        press(panel, change)
        assert not source.at_rest(2.5, 0.0, 5.0), f"{change} was not noticed"
        press(panel, mend)
        if RANGE_ASIDE in change or "BURS:NCYC" in change or "BURS:STAT" in change:
            source.prepare(2.5, 0.0, 5.0)


def test_a_load_declared_behind_the_limits_is_noticed_though_every_other_setting_reads_the_same() -> None:
    """Declared 50 ohm, 2.5 V on the display are 5 V at the amplifier: 1500 V on the specimen."""
    source, _, panel = made("33511B")
    source.prepare(2.5, 1.5, 3.5)
    assert source.at_rest(2.5, 1.5, 3.5)
    away = "VOLT:LIM:STAT OFF;:OUTP:LOAD 50;:VOLT 0.01;:VOLT:OFFS 2.5;:VOLT:LIM:LOW 1.495;:VOLT:LIM:HIGH 3.505"
    for command in away.split(";"):
        press(panel, command)
    press(panel, ":VOLT:LIM:STAT ON")
    assert panel_reads(panel, "VOLT:OFFS?", "VOLT:LIM:LOW?", "VOLT:LIM:HIGH?") == pytest.approx([2.5, 1.495, 3.505])
    assert not source.at_rest(2.5, 1.5, 3.5)


@pytest.mark.parametrize("model", CHANGES)
def test_limits_of_another_bench_file_are_another_state(model: str) -> None:
    source, _, _ = made(model)
    source.prepare(2.5, 0.0, 5.0)
    assert source.at_rest(2.5, 0.0, 5.0)
    assert not source.at_rest(2.6, 0.0, 5.0)
    if model not in ("33220A", "DG1032Z"):  # these have no limits of their own, and carry the drive in the amplitude
        assert not source.at_rest(2.5, 0.0, 4.0)


def test_another_waveform_at_the_front_panel_is_never_played() -> None:
    """What the driver remembers of the waveform memory holds no longer than until the next run asks for rest."""
    source, bench, panel = made("33511B")
    source.prepare(2.5, 0.0, 5.0)
    source.play(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    press(panel, "FUNC:ARB EXP_RISE")
    assert source.at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    source.play(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    report = bench.report()
    volts_are_safe(report)  # EXP_RISE at this amplitude would begin with a jump of a volt
    assert (report.lowest_v, report.highest_v) == (pytest.approx(1.5, abs=0.01), pytest.approx(3.5, abs=0.01))


def test_a_memory_that_is_full_is_cleared_with_next_to_nothing_on_the_output(monkeypatch: pytest.MonkeyPatch) -> None:
    """Clearing it selects EXP_RISE, whose first point is the lowest: half of the amplitude below the idle level."""
    monkeypatch.setattr("sim_hardware.keysight_33500.MEMORY_POINTS", 4500)
    source, bench, _ = made("33511B")
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.play(Sine(100.0, 2.5, 2.5, 5))
    bench.clock.sleep(0.2)  # it has ended by itself, its amplitude stands
    source.play(Steps((2.5, 2.6, 2.5), 0.05, 0.05))
    bench.clock.sleep(0.4)
    report = bench.report()
    volts_are_safe(report)
    assert report.highest_v == pytest.approx(5.0, abs=0.01)


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_a_drive_beyond_the_one_amplitude_of_such_a_box_is_refused(model: str) -> None:
    source, bench, _ = made(model)
    source.prepare(2.5, 1.5, 3.5)
    with pytest.raises(InstrumentError, match=r"was set up for 1 V at most .* not 1\.5 V; .*Nothing was sent"):
        source.play(Sine(50.0, 1.5, 2.5, 10))
    assert bench.report().outside_rest_s == 0


def test_a_box_that_does_not_read_back_is_said_with_what_and_whether_it_is_on(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, panel = made("33511B")
    handle = bench.port.handle

    def deaf_to_phase(message: str):  # a firmware that keeps a phase of its own
        return handle(message.replace("BURS:PHAS 0", "BURS:PHAS 30"))

    monkeypatch.setattr(bench.port, "handle", deaf_to_phase)
    with pytest.raises(InstrumentError, match=r"\(BURS:PHAS is \+3\.0+E\+01, not 0\); its output was not brought up"):
        source.prepare(2.5, 0.0, 5.0)
    assert not bench.generator.settings.on
    monkeypatch.setattr(bench.port, "handle", handle)
    source.prepare(2.5, 0.0, 5.0)
    press(panel, "VOLT:UNIT VRMS")
    monkeypatch.setattr(bench.port, "handle", deaf_to_phase)
    with pytest.raises(InstrumentError, match="its output is on as it was found"):
        source.prepare(2.5, 0.0, 5.0)


def test_a_box_whose_output_does_not_come_on_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, _ = made("33511B")
    handle = bench.port.handle
    monkeypatch.setattr(bench.port, "handle", lambda message: handle(message.replace("OUTP ON", "OUTP OFF")))
    with pytest.raises(InstrumentError, match="its output did not come on; look at its front panel"):
        source.prepare(2.5, 0.0, 5.0)


@pytest.mark.parametrize("model", BOXES)
def test_errors_that_others_left_do_not_keep_a_box_from_being_prepared(model: str) -> None:
    source, _, panel = made(model)
    for _ in range(3):
        press(panel, "NONSENSE 1")
    source.prepare(2.5, 0.0, 5.0)
    assert source.at_rest(2.5, 0.0, 5.0)


def test_a_box_that_was_told_of_another_load_is_not_moved_by_volts_that_mean_others() -> None:
    """At 50 ohm its 2.5 V read as 1.25 V: brought 'gently' to 2.5 V it would put 5 V, 1500 V on the specimen."""
    source, bench, panel = made("33220A")
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    press(panel, "OUTP:LOAD 50")
    found = len(bench.history.pieces())
    source.prepare(2.5, 0.0, 5.0)
    pieces = bench.history.pieces()[found:]
    assert pieces
    assert max(float(piece.segment.volts(np.array([piece.start_s + 1e-6]))[0]) for piece in pieces) < 2.6


# -- a burst that an earlier, killed program left playing ----------------------------------------------------------------


@pytest.mark.parametrize("model", BOXES)
def test_a_restart_during_a_burst_ends_it_before_anything_is_set_up(model: str) -> None:
    source, bench, _ = made(model)
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.play(Sine(50.0, 2.5, 2.5, 400))  # 8 s, and then the program is killed
    bench.clock.sleep(0.333)
    second = BOXES[model](
        bench.link(), bench.clock
    )  # high voltage is still on: the person switched the wrong amplifier
    second.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    volts_are_safe(bench.report())  # all the way
    begin = bench.report().outside_rest_s
    bench.clock.sleep(9.0)
    assert bench.report().outside_rest_s == begin, "the old burst played on"
    assert second.at_rest(2.5, 0.0, 5.0)
    second.play(Sine(100.0, 1.0, 2.5, 50))
    bench.clock.sleep(0.7)
    assert bench.report().outside_rest_s - begin == pytest.approx(0.5, rel=0.05)
    second.stop()
    volts_are_safe(bench.report())


@pytest.mark.parametrize("model", BOXES)
def test_a_restart_finds_a_held_level_and_brings_it_to_rest_gently(model: str) -> None:
    source, bench, _ = made(model)
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.move(4.0, 0.2)
    source.play(Hold(4.0, 100.0))
    second = BOXES[model](bench.link(), bench.clock)
    assert not second.at_rest(2.5, 0.0, 5.0)
    second.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    volts_are_safe(bench.report())


@pytest.mark.parametrize("model", ["SDG1032X", "AFG3022C"])
def test_whoever_finds_such_a_box_idle_need_not_wait_for_a_burst_that_is_long_over(model: str) -> None:
    source, bench, _ = made(model)
    source.prepare(2.5, 0.0, 5.0)
    source.play(Sine(50.0, 1.0, 2.5, 400))
    source.stop()
    second = BOXES[model](bench.link(), bench.clock)
    begin_s = bench.clock.now()
    assert second.at_rest(2.5, 0.0, 5.0)
    assert bench.clock.now() - begin_s < 0.5


@pytest.mark.parametrize(
    ("model", "commands"),
    [
        ("33511B", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:NCYC 1E6", "TRIG:SOUR BUS", "BURS:STAT ON", "OUTP ON", "*TRG")),
        ("33220A", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:NCYC 5E4", "TRIG:SOUR BUS", "BURS:STAT ON", "OUTP ON", "*TRG")),
        ("33220A", ("FUNC SIN", "VOLT 4", "FREQ 20", "BURS:STAT ON", "OUTP ON")),  # again and again, by its own timer
        ("DG1032Z", (":SOUR1:VOLT 4", ":SOUR1:BURS:NCYC 1E6", ":SOUR1:BURS:TRIG:SOUR MAN", ":SOUR1:BURS:STAT ON", ":OUTP1 ON", ":SOUR1:BURS:TRIG")),
        ("SDG1032X", ("C1:BTWV STATE,ON", "C1:BTWV TRSR,MAN,TIME,1000000", "C1:OUTP ON", "C1:BTWV MTRIG")),
        ("AFG3022C", ("SOUR1:VOLT 4", "TRIG:SOUR EXT", "SOUR1:BURS:NCYC 1E6", "SOUR1:BURS:STAT ON", "OUTP1:STAT ON", "*TRG")),
    ],
)  # fmt: skip
def test_a_burst_of_anybody_elses_is_over_when_the_box_has_been_prepared(model: str, commands: tuple[str, ...]) -> None:
    """Another program's sine, for hours: high voltage is off, and it is cut."""
    source, bench, panel = made(model)
    for command in commands:
        press(panel, command)
    bench.clock.sleep(0.37)
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.05)
    bench.enable_hv()
    bench.clock.sleep(3.0)
    report = bench.report()
    volts_are_safe(report)
    assert report.outside_rest_s == 0
    assert bench.generator.busy_s(bench.clock.now()) == 0


# -- stop: nothing keeps it from going down ------------------------------------------------------------------------------


@contextmanager
def direct(model: str) -> Iterator[tuple[BurstGenerator, VirtualBench, Link]]:
    source, bench, panel = made(model)
    yield source, bench, panel
    source.close()


@contextmanager
def wired(model: str) -> Iterator[tuple[BurstGenerator, VirtualBench, Link]]:
    bench = VirtualBench(truth(model), WallClock(5.0))
    with ServedBench(bench) as served:
        source = BOXES[model](VisaLink(served.scpi.resource, timeout_s=0.2), bench.clock)
        panel = VisaLink(served.scpi.resource, timeout_s=0.2)
        yield source, bench, panel
        source.close()
        panel.close()


HOLDERS = [model for model in BOXES if BOXES[model].HOLDS_RANGE]
WAYS = [pytest.param(make, model, id=f"{model} {make.__name__}") for model in HOLDERS for make in (direct, wired)]


def playing(source: BurstGenerator, bench: VirtualBench) -> None:
    source.prepare(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.play(Sine(40.0, 2.5, 2.5, 40 * 60))
    bench.clock.sleep(0.2)


@pytest.mark.parametrize(("make", "model"), WAYS)
def test_it_stops_although_others_have_left_errors_in_its_queue(make, model: str) -> None:
    with make(model) as (source, bench, panel):
        playing(source, bench)
        for _ in range(5):
            press(panel, "NONSENSE 1")
        source.stop()
        bench.clock.sleep(0.1)
        volts_are_safe(bench.report())
        assert source.at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("fault", ["scpi-garbled", "scpi-late", "scpi-half"])
@pytest.mark.parametrize(("make", "model"), WAYS)
def test_it_stops_although_its_answers_cannot_be_read_and_tells_so(make, model: str, fault: str) -> None:
    with make(model) as (source, bench, _):
        playing(source, bench)
        bench.inject(fault)
        with pytest.raises(LinkError, match="answers could not be read, and the way to rest was sent blind"):
            source.stop()
        bench.clock.sleep(0.3)
        volts_are_safe(bench.report())  # stands still at rest, and came there in small steps
        bench.clear(fault)
        bench.clock.sleep(0.1)
        source.reconnect()
        assert source.at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("fault", ["scpi-garbled", "scpi-late", "scpi-half"])
@pytest.mark.parametrize("model", BOXES)
def test_a_held_level_comes_to_rest_although_no_answer_can_be_read(model: str, fault: str) -> None:
    with direct(model) as (source, bench, _):
        source.prepare(2.5, 0.0, 5.0)
        bench.clock.sleep(0.1)
        bench.enable_hv()
        source.move(4.0, 0.3)
        bench.inject(fault)
        with pytest.raises(LinkError):
            source.move(2.5, 0.3)
        bench.clock.sleep(0.1)
        volts_are_safe(bench.report())


def test_away_from_rest_an_unreadable_answer_ends_the_way_at_once() -> None:
    with direct("33511B") as (source, bench, _):
        source.prepare(2.5, 0.0, 5.0)
        source.move(3.0, 0.1)
        bench.inject("scpi-garbled")
        with pytest.raises(LinkError):
            source.move(4.0, 0.3)
        assert bench.report().end_v == pytest.approx(3.0, abs=0.06)  # one step at most


def test_a_step_that_the_box_refuses_does_not_end_the_way_down() -> None:
    with direct("33511B") as (source, bench, panel):
        playing(source, bench)
        tell, steps = source._scpi.tell, []

        def refuses_every_fifth(command: str) -> None:
            if command.startswith("VOLT "):
                steps.append(command)
                if len(steps) % 5 == 0:
                    press(panel, "NONSENSE 1")  # its error answers our step
            tell(command)

        source._scpi.tell = refuses_every_fifth
        with pytest.raises(InstrumentError, match=r"33511B refused 'VOLT .*it was sent all the same; \d+ more"):
            source.stop()
        bench.clock.sleep(0.1)
        volts_are_safe(bench.report())


def test_a_driver_that_was_never_told_an_amplitude_and_cannot_ask_sends_nothing() -> None:
    """A blind step could be one up."""
    with direct("33511B") as (source, bench, _):
        playing(source, bench)
        second = open_generator("auto", bench.link(), bench.clock, 0.05)
        bench.inject("scpi-garbled")
        before = bench.generator.settings
        with pytest.raises(LinkError):
            second.stop()
        assert bench.generator.settings == before
        bench.clear()
        source.stop()


def test_a_supply_with_others_errors_in_its_queue_is_prepared_and_brought_to_rest() -> None:
    from drivers.dc_supply import DcSupply

    bench = VirtualBench(simulated(source="supply").truth, VirtualClock())
    panel = bench.link()
    source = DcSupply(bench.link(), bench.clock)
    press(panel, "NONSENSE 1")
    source.prepare(2.5, 0.0, 5.0)
    bench.enable_hv()
    source.move(4.0, 0.3)
    for _ in range(3):
        press(panel, "NONSENSE 1")
    with pytest.raises(InstrumentError, match="it was sent all the same"):
        source.move(2.5, 0.3)  # the queue was not emptied: that is for `stop`
    for _ in range(3):
        press(panel, "NONSENSE 1")
    source.stop()
    source.move(2.5, 0.3)
    bench.clock.sleep(0.5)
    volts_are_safe(bench.report())
    assert source.at_rest(2.5, 0.0, 5.0)
    press(panel, "CURR 0.002,(@1)")
    assert not source.at_rest(2.5, 0.0, 5.0)


@pytest.mark.parametrize("model", [model for model in CHANGES if model != "SDG1032X"])
def test_a_box_that_plays_another_rate_than_it_was_told_is_said_and_nothing_is_played(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, bench, _ = made(model)
    source.prepare(2.5, 0.0, 5.0)
    handle = bench.port.handle

    def steps_of_a_percent(message: str):
        command, space, rate = message.partition(" ")
        if command.endswith(("FREQ", "SRAT")) and space:
            rate, rest = rate.partition(";")[::2]
            message = f"{command} {float(rate) * 1.01:.10g};{rest}"
        return handle(message)

    monkeypatch.setattr(bench.port, "handle", steps_of_a_percent)
    with pytest.raises(InstrumentError, match=r"was set to .* and reads back .* nothing more was sent"):
        source.play(Sine(100.0, 1.0, 2.5, 5))
    assert bench.report().outside_rest_s == 0


def test_a_waveform_whose_loading_was_never_answered_is_not_taken_for_the_one_before(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The box has taken the steps, and nobody knows: the next sine must be loaded anew, or it would play the steps."""
    source, bench, _ = made("33511B")
    source.prepare(2.5, 0.0, 5.0)
    bench.enable_hv()
    source.play(Sine(100.0, 1.0, 2.5, 5))
    bench.clock.sleep(0.2)
    source.stop()
    handle = bench.port.handle

    def answers_nothing_to_it(message: str):
        reply = handle(message)
        return None if "FUNC:ARB TB" in message else reply

    monkeypatch.setattr(bench.port, "handle", answers_nothing_to_it)
    with pytest.raises(LinkError):
        source.play(Steps((2.5, 3.5, 2.5), 0.1, 0.05))
    monkeypatch.setattr(bench.port, "handle", handle)
    before_s = bench.clock.now()
    source.play(Sine(100.0, 0.5, 2.5, 5))
    bench.clock.sleep(0.2)
    report = bench.report()
    volts_are_safe(report)
    played = bench.history.volts(before_s + np.arange(2000) / 1e4)
    assert (played.min(), played.max()) == (pytest.approx(2.0, abs=0.01), pytest.approx(3.0, abs=0.01))
