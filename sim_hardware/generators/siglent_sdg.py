"""Simulated Siglent SDG1000X or SDG2000X function generator, after its programming guide.

Pitfalls: an impossible value is clipped silently, and there is no error queue; burst parameters are ignored before
`STATE,ON`; a selected waveform restores the frequency, amplitude and offset it was stored with; no range can be frozen;
parameters that do not apply are missing from the reply; an inverted polarity is a setting that persists.
"""

from collections.abc import Callable, Sequence

import numpy as np

from model import Array
from sim_hardware.generators.generator import SimulatedGenerator
from sim_hardware.generators.scpi_levels import MAX_EMF_V, MIN_EMF_VPP
from sim_hardware.plant import ArbitraryWaveform
from sim_hardware.wires.scpi_engine import Arguments, ScpiCommand, ScpiError

FULL_SCALE = 32767
MAX_BURST_CYCLES = 1e6
MAX_FREQUENCY_HZ = 30e6
BUILT_IN_NAME = "StairUp"


class SimulatedSiglentSdg:
    """One channel over a `SimulatedGenerator` (sim_hardware.wires.scpi_engine.ScpiInstrument)."""

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], identity: str) -> None:
        self.identity = identity
        self.queue_error: Callable[[ScpiError], None] = lambda _: None
        self._generator = generator
        self._now = now
        self._reset_state()

    def _reset_state(self) -> None:
        self._high_z = False
        self._inverted = False
        self._selected_name = BUILT_IN_NAME
        self._stored_waveforms: dict[str, tuple[Array, dict[str, str]]] = {}

    def reset(self) -> None:
        self._reset_state()
        self._generator.reset()

    def trigger(self) -> None:
        """`*TRG` does nothing here; `BTWV MTRIG` does."""

    def busy_s(self) -> float:
        return self._generator.busy_s(self._now())

    @property
    def commands(self) -> Sequence[ScpiCommand]:
        return [
            ScpiCommand("C[1]:OUTP", self._set_output, lambda _: self._query_output()),
            ScpiCommand(
                "C[1]:BSWV", lambda a: self._set_basic_wave(_parse_pairs(a)), lambda _: self._query_basic_wave()
            ),
            ScpiCommand("C[1]:BTWV", self._set_burst, lambda _: self._query_burst()),
            ScpiCommand("C[1]:WVDT", self._download),
            ScpiCommand("C[1]:ARWV", self._select, lambda _: f"C1:ARWV INDEX,2,NAME,{self._selected_name}"),
        ]

    @property
    def _display_ratio(self) -> float:
        return 1.0 if self._high_z else 0.5

    def _set_output(self, a: Arguments) -> None:
        keywords = [word.upper() for word in a]
        if keywords and keywords[0] in ("ON", "OFF"):
            self._generator.apply_settings(on=keywords.pop(0) == "ON")
        requested = _parse_pairs(keywords)
        if "LOAD" in requested:
            self._high_z = requested["LOAD"] == "HZ"
        if "PLRT" in requested:
            self._inverted = requested["PLRT"] == "INVT"

    def _query_output(self) -> str:
        on = "ON" if self._generator.settings.on else "OFF"
        return f"C1:OUTP {on},LOAD,{'HZ' if self._high_z else '50'},PLRT,{'INVT' if self._inverted else 'NOR'}"

    def _set_basic_wave(self, requested: dict[str, str]) -> None:
        s = self._generator.settings
        changed: dict[str, object] = {}
        if kind := {"SINE": "SIN", "DC": "DC", "ARB": "ARB"}.get(requested.get("WVTP", "")):
            changed["function"] = kind
            if kind == "DC":
                changed["burst"] = False
        if "FRQ" in requested:
            changed["frequency_hz"] = min(max(_parse_value(requested["FRQ"]), 1e-6), MAX_FREQUENCY_HZ)
        vpp, offset = s.emf_vpp, s.emf_offset_v
        if "AMP" in requested:
            vpp = _parse_value(requested["AMP"]) / self._display_ratio
        if "OFST" in requested:
            offset = _parse_value(requested["OFST"]) / self._display_ratio
        offset = min(max(offset, -MAX_EMF_V), MAX_EMF_V)
        room = 2 * (MAX_EMF_V - abs(offset))
        if "AMP" not in requested and vpp > room:  # the amplitude stays, the offset gives way
            offset = min(max(offset, -MAX_EMF_V + vpp / 2), MAX_EMF_V - vpp / 2)
            room = vpp
        self._generator.apply_settings(
            emf_vpp=min(max(vpp, MIN_EMF_VPP), max(room, MIN_EMF_VPP)), emf_offset_v=offset, **changed
        )

    def _query_basic_wave(self) -> str:
        s = self._generator.settings
        offset = f"OFST,{s.emf_offset_v * self._display_ratio:.6g}V"
        if s.function == "DC":
            return f"C1:BSWV WVTP,DC,{offset}"
        kind = {"SIN": "SINE"}.get(s.function, s.function)
        return (
            f"C1:BSWV WVTP,{kind},FRQ,{s.frequency_hz:.10g}HZ,PERI,{1 / s.frequency_hz:.6g}S,"
            f"AMP,{s.emf_vpp * self._display_ratio:.6g}V,{offset},PHSE,0"
        )

    def _set_burst(self, a: Arguments) -> None:
        s = self._generator.settings
        if [word.upper() for word in a] == ["MTRIG"]:
            if s.burst and s.trigger == "BUS" and self.busy_s() == 0:
                self._generator.trigger()
            return
        requested = _parse_pairs(a)
        on = requested.pop("STATE", "ON" if s.burst else "OFF") == "ON"
        if on != s.burst and not (on and s.function == "DC"):
            self._generator.apply_settings(burst=on)
        if not s.burst and not on:
            return  # ignored
        changed: dict[str, object] = {}
        if "TIME" in requested:
            changed["cycles"] = min(max(float(round(_parse_value(requested["TIME"]))), 1.0), MAX_BURST_CYCLES)
        if "TRSR" in requested:
            changed["trigger"] = {"INT": "IMM", "MAN": "BUS"}.get(requested["TRSR"], "EXT")
        if "STPS" in requested:
            changed["phase_deg"] = _parse_value(requested["STPS"])
        if changed:
            self._generator.apply_settings(**changed)

    def _query_burst(self) -> str:
        s = self._generator.settings
        if not s.burst:
            return "C1:BTWV STATE,OFF"
        source = {"IMM": "INT", "BUS": "MAN"}.get(s.trigger, "EXT")
        return (
            f"C1:BTWV STATE,ON,PRD,{s.period_s:g}S,STPS,{s.phase_deg:g},TRSR,{source},TIME,{s.cycles:g},"
            "GATE_NCYC,NCYC,CARR,WVTP,ARB"
        )

    def _download(self, a: Arguments) -> None:
        *parameters, data = a
        if len(parameters) % 2 == 0 or parameters[-1] != "WAVEDATA":
            return
        requested = _parse_pairs(parameters[:-1])
        points = np.frombuffer(data.encode("latin-1"), "<i2") / FULL_SCALE
        self._stored_waveforms[requested["WVNM"]] = points, requested
        if requested["WVNM"] == self._selected_name:
            self._generator.apply_settings(wave=ArbitraryWaveform(points))

    def _select(self, a: Arguments) -> None:
        name = _parse_pairs(a).get("NAME", "")
        if name not in self._stored_waveforms:
            return
        self._selected_name = name
        points, brought = self._stored_waveforms[name]
        self._generator.apply_settings(wave=ArbitraryWaveform(points))
        self._set_basic_wave({own: brought[theirs] for own, theirs in _STORED_PARAMETERS if theirs in brought})


_STORED_PARAMETERS = (("FRQ", "FREQ"), ("AMP", "AMPL"), ("OFST", "OFST"))


def _parse_pairs(arguments: Sequence[str]) -> dict[str, str]:
    return {name.upper(): value for name, value in zip(arguments[::2], arguments[1::2], strict=False)}


def _parse_value(text: str) -> float:
    return float(text.upper().rstrip("HZVSDEG"))
