"""Readback of an armed generator: every change at the front panel is detected."""

from contextlib import nullcontext

import numpy as np
import pytest

from drivers.drive_shapes import Sine
from drivers.errors import InstrumentError
from tests.helpers.front_panel import made, panel_reads, press

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
        ":SOUR1:BURS:IDLE TOP": ":SOUR1:BURS:IDLE FPT",
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


@pytest.mark.parametrize("model", CHANGES)
def test_whatever_is_changed_at_the_front_panel_between_two_runs_is_noticed(model: str) -> None:
    source, _, panel = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    for change, mend in CHANGES[model].items():
        assert source.is_at_rest(2.5, 0.0, 5.0), f"before {change}"
        press(panel, change)
        assert not source.is_at_rest(2.5, 0.0, 5.0), f"{change} was not noticed"
        press(panel, mend)
        if RANGE_ASIDE in change or "BURS:NCYC" in change or "BURS:STAT" in change:
            source.initialize_at_rest(2.5, 0.0, 5.0)


@pytest.mark.one_in(1)
@pytest.mark.parametrize(("off_v", "plays"), [(0.0008, True), (-0.0008, True), (0.0012, False), (-0.0012, False)])
def test_a_drive_begins_only_where_the_output_idles_at_its_first_level(off_v: float, plays: bool) -> None:
    """The front panel has moved it by 1 mV, 0.6 V at the specimen."""
    source, bench, panel = made("33511B")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    press(panel, f"VOLT:OFFS {2.5 + off_v}")
    begin_s = bench.clock.now()
    with nullcontext() if plays else pytest.raises(InstrumentError, match="idles"):
        source.start_drive(Sine(40.0, 1.0, 2.5, 40))
    bench.clock.sleep(1.2)
    volts = bench.history.volts(np.arange(begin_s, bench.clock.now(), 1e-3))
    assert np.ptp(volts) == pytest.approx(2.0 if plays else 0.0, abs=0.02)


def test_changed_output_load_is_detected_when_other_settings_match() -> None:
    """Declared 50 ohm, 2.5 V on the display are 5 V at the amplifier: 1500 V on the specimen."""
    source, _, panel = made("33511B")
    source.initialize_at_rest(2.5, 1.5, 3.5)
    assert source.is_at_rest(2.5, 1.5, 3.5)
    away = "VOLT:LIM:STAT OFF;:OUTP:LOAD 50;:VOLT 0.01;:VOLT:OFFS 2.5;:VOLT:LIM:LOW 1.495;:VOLT:LIM:HIGH 3.505"
    for command in away.split(";"):
        press(panel, command)
    press(panel, ":VOLT:LIM:STAT ON")
    assert panel_reads(panel, "VOLT:OFFS?", "VOLT:LIM:LOW?", "VOLT:LIM:HIGH?") == pytest.approx([2.5, 1.495, 3.505])
    assert not source.is_at_rest(2.5, 1.5, 3.5)


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", CHANGES)
def test_limits_of_another_bench_file_are_another_state(model: str) -> None:
    source, _, _ = made(model)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert not source.is_at_rest(2.6, 0.0, 5.0)
    if model not in ("33220A", "DG1032Z"):  # these have no limits of their own, and carry the drive in the amplitude
        assert not source.is_at_rest(2.5, 0.0, 4.0)


def test_a_box_that_does_not_read_back_is_said_with_what_and_whether_it_is_on(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, panel = made("33511B")
    handle = bench.message_port.handle

    def deaf_to_phase(message: str):  # a firmware that keeps a phase of its own
        return handle(message.replace("BURS:PHAS 0", "BURS:PHAS 30"))

    monkeypatch.setattr(bench.message_port, "handle", deaf_to_phase)
    with pytest.raises(InstrumentError, match=r"\(BURS:PHAS is \+3\.0+E\+01, not 0\); its output was not brought up"):
        source.initialize_at_rest(2.5, 0.0, 5.0)
    assert not bench.generator.settings.on
    monkeypatch.setattr(bench.message_port, "handle", handle)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    press(panel, "VOLT:UNIT VRMS")
    monkeypatch.setattr(bench.message_port, "handle", deaf_to_phase)
    with pytest.raises(InstrumentError, match="its output is on as it was found"):
        source.initialize_at_rest(2.5, 0.0, 5.0)


def test_a_box_whose_output_does_not_come_on_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    source, bench, _ = made("33511B")
    handle = bench.message_port.handle
    monkeypatch.setattr(bench.message_port, "handle", lambda message: handle(message.replace("OUTP ON", "OUTP OFF")))
    with pytest.raises(InstrumentError, match="its output did not come on; look at its front panel"):
        source.initialize_at_rest(2.5, 0.0, 5.0)
