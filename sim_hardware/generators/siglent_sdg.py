"""A Siglent SDG1000X or SDG2000X function generator as its programming guide describes it.

Its own traps: a value it cannot do is clipped without a word, and no error is ever to be had; burst parameters are not
heard before `STATE,ON`; a selected waveform brings along the frequency, amplitude and offset it was stored with; there is
no range to freeze; parameters that do not apply vanish from the answer; an inverted polarity is a setting that stays.
"""

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from sim_hardware.generators.generator import Generator
from sim_hardware.generators.scpi_levels import MAX_EMF_V, MIN_EMF_VPP
from sim_hardware.plant.segments import Wave
from sim_hardware.wires.scpi_engine import Arguments, Command, ScpiError

FULL_SCALE = 32767
MOST_CYCLES = 1e6
TOP_HZ = 30e6
BUILT_IN = "StairUp"


class SiglentSdg:
    """One channel over a `Generator` (sim_hardware.wires.scpi_engine.Instrument)."""

    def __init__(self, core: Generator, now: Callable[[], float], identity: str) -> None:
        self.identity = identity
        self.report: Callable[[ScpiError], None] = lambda _: None
        self._core = core
        self._now = now
        self._forget()

    def _forget(self) -> None:
        self._high_z = False
        self._inverted = False
        self._name = BUILT_IN
        self._stored: dict[str, tuple[NDArray[np.float64], dict[str, str]]] = {}

    def reset(self) -> None:
        self._forget()
        self._core.reset()

    def trigger(self) -> None:
        """`*TRG` does nothing here; `BTWV MTRIG` does."""

    def busy_s(self) -> float:
        return self._core.busy_s(self._now())

    @property
    def commands(self) -> Sequence[Command]:
        return [
            Command("C[1]:OUTP", self._set_output, lambda _: self._output()),
            Command("C[1]:BSWV", lambda a: self._set_basic(_pairs(a)), lambda _: self._basic()),
            Command("C[1]:BTWV", self._set_burst, lambda _: self._burst()),
            Command("C[1]:WVDT", self._download),
            Command("C[1]:ARWV", self._select, lambda _: f"C1:ARWV INDEX,2,NAME,{self._name}"),
        ]

    @property
    def _display(self) -> float:
        return 1.0 if self._high_z else 0.5

    def _set_output(self, a: Arguments) -> None:
        words = [word.upper() for word in a]
        if words and words[0] in ("ON", "OFF"):
            self._core.change(on=words.pop(0) == "ON")
        asked = _pairs(words)
        if "LOAD" in asked:
            self._high_z = asked["LOAD"] == "HZ"
        if "PLRT" in asked:
            self._inverted = asked["PLRT"] == "INVT"

    def _output(self) -> str:
        on = "ON" if self._core.settings.on else "OFF"
        return f"C1:OUTP {on},LOAD,{'HZ' if self._high_z else '50'},PLRT,{'INVT' if self._inverted else 'NOR'}"

    def _set_basic(self, asked: dict[str, str]) -> None:
        s = self._core.settings
        changed: dict[str, object] = {}
        if kind := {"SINE": "SIN", "DC": "DC", "ARB": "ARB"}.get(asked.get("WVTP", "")):
            changed["function"] = kind
            if kind == "DC":
                changed["burst"] = False
        if "FRQ" in asked:
            changed["frequency_hz"] = min(max(_value(asked["FRQ"]), 1e-6), TOP_HZ)
        vpp, offset = s.emf_vpp, s.emf_offset_v
        if "AMP" in asked:
            vpp = _value(asked["AMP"]) / self._display
        if "OFST" in asked:
            offset = _value(asked["OFST"]) / self._display
        offset = min(max(offset, -MAX_EMF_V), MAX_EMF_V)
        room = 2 * (MAX_EMF_V - abs(offset))
        if "AMP" not in asked and vpp > room:  # the amplitude stays, the offset gives way
            offset = min(max(offset, -MAX_EMF_V + vpp / 2), MAX_EMF_V - vpp / 2)
            room = vpp
        self._core.change(emf_vpp=min(max(vpp, MIN_EMF_VPP), max(room, MIN_EMF_VPP)), emf_offset_v=offset, **changed)

    def _basic(self) -> str:
        s = self._core.settings
        offset = f"OFST,{s.emf_offset_v * self._display:.6g}V"
        if s.function == "DC":
            return f"C1:BSWV WVTP,DC,{offset}"
        kind = {"SIN": "SINE"}.get(s.function, s.function)
        return (
            f"C1:BSWV WVTP,{kind},FRQ,{s.frequency_hz:.10g}HZ,PERI,{1 / s.frequency_hz:.6g}S,"
            f"AMP,{s.emf_vpp * self._display:.6g}V,{offset},PHSE,0"
        )

    def _set_burst(self, a: Arguments) -> None:
        s = self._core.settings
        if [word.upper() for word in a] == ["MTRIG"]:
            if s.burst and s.trigger == "BUS" and self.busy_s() == 0:
                self._core.trigger()
            return
        asked = _pairs(a)
        on = asked.pop("STATE", "ON" if s.burst else "OFF") == "ON"
        if on != s.burst and not (on and s.function == "DC"):
            self._core.change(burst=on)
        if not s.burst and not on:
            return  # not heard
        changed: dict[str, object] = {}
        if "TIME" in asked:
            changed["cycles"] = min(max(float(round(_value(asked["TIME"]))), 1.0), MOST_CYCLES)
        if "TRSR" in asked:
            changed["trigger"] = {"INT": "IMM", "MAN": "BUS"}.get(asked["TRSR"], "EXT")
        if "STPS" in asked:
            changed["phase_deg"] = _value(asked["STPS"])
        if changed:
            self._core.change(**changed)

    def _burst(self) -> str:
        s = self._core.settings
        if not s.burst:
            return "C1:BTWV STATE,OFF"
        source = {"IMM": "INT", "BUS": "MAN"}.get(s.trigger, "EXT")
        return (
            f"C1:BTWV STATE,ON,PRD,{s.period_s:g}S,STPS,{s.phase_deg:g},TRSR,{source},TIME,{s.cycles:g},"
            "GATE_NCYC,NCYC,CARR,WVTP,ARB"
        )

    def _download(self, a: Arguments) -> None:
        *words, data = a
        if len(words) % 2 == 0 or words[-1] != "WAVEDATA":
            return
        asked = _pairs(words[:-1])
        points = np.frombuffer(data.encode("latin-1"), "<i2") / FULL_SCALE
        self._stored[asked["WVNM"]] = points, asked
        if asked["WVNM"] == self._name:
            self._core.change(wave=Wave(points))

    def _select(self, a: Arguments) -> None:
        name = _pairs(a).get("NAME", "")
        if name not in self._stored:
            return
        self._name = name
        points, brought = self._stored[name]
        self._core.change(wave=Wave(points))
        self._set_basic({own: brought[theirs] for own, theirs in _BROUGHT if theirs in brought})


_BROUGHT = (("FRQ", "FREQ"), ("AMP", "AMPL"), ("OFST", "OFST"))


def _pairs(words: Sequence[str]) -> dict[str, str]:
    return {name.upper(): value for name, value in zip(words[::2], words[1::2], strict=False)}


def _value(text: str) -> float:
    return float(text.upper().rstrip("HZVSDEG"))
