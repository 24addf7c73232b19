"""Simulated Siglent SDG1000X, SDG2000X or SDG6000X function generator, after its programming guide and observations of real ones.

Pitfalls: an impossible value is clipped silently, and there is no error queue; burst parameters are ignored before
`STATE,ON`; no range can be frozen; parameters that do not apply are missing from the reply; polarity, inversion, combining
and coupling are settings that persist.

Observed on real ones (benchctrl at 0c6e51e: SDG1032X, firmware 1.01.01.33R1B6; dmm6500-serial-decode at 0465be2: SDG2122X): the
first byte 0x0A ends a waveform's message; a waveform written by WVDT is selected; ARWV? names a user's waveform with `.bin` and
without an index; a quoted name is ignored; numbers have six digits; queries are not answered while a waveform is being stored;
one session is served; the third waveform above 64 kB hangs remote and panel while the output continues, and one of less than four
bytes destroys the instrument. A header with all fields was silently not stored by a B&K 4055B, which is an SDG2000X. An SDG6022X
with firmware 6.01.01.37R6 ignores a selection by name, and one with 38R3 has no rate mode; both take big-endian points in a block
with their size (nacs-lab/pyctrl at cdd5b16).
"""

import math
import random
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from model import Array
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_generator import OTHER_CHANNEL_V
from sim_hardware.generators.scpi_levels import MAX_EMF_V, MIN_EMF_VPP
from sim_hardware.generators.traits import RETIME, Trait, deviations
from sim_hardware.plant import ArbitraryWaveform
from sim_hardware.wires import Arguments, ScpiCommand, ScpiError

FULL_SCALE = 32767
LONG_HEADERS = {
    "OUTP": "OUTPUT",
    "BSWV": "BASIC_WAVE",
    "BTWV": "BURSTWAVE",
    "ARWV": "ARBWAVE",
    "INVT": "INVERT",
    "CMBN": "COMBINE",
    "COUP": "COUPLING",
    "SWWV": "SWEEPWAVE",
    "MDWV": "MODULATEWAVE",
    "SRATE": "SAMPLERATE",
}
MAX_BURST_CYCLES = 1e6
MAX_FREQUENCY_HZ = 30e6
BUILT_IN_NAME = "StairUp"
LARGE_BYTES = 65_536
NOISE_V = 0.3
"""Volts that represent the noise that an SDG2000X or SDG6000X can add to its output."""

TRAITS = (
    Trait(
        "selection",
        ("keeps-levels", "restores-levels"),
        "whether selecting a waveform restores the levels it was stored with: sources differ between firmwares",
        models="SDG1|SDG6",
    ),
    Trait(
        "silence",
        ("brief", "long"),
        "how long it answers nothing after a waveform arrived: 0.5 s on an SDG1032X, above 5 s in 15 of 86 cases on an SDG2122X",
    ),
    Trait(
        "stale", ("never", "often"), "whether a selection may not take until it is sent again: 19 of 233 on an SDG2122X"
    ),
    Trait(
        "inversion",
        ("one-switch", "two-switches"),
        "whether INVT and the polarity of OUTP are one switch or two: both exist",
    ),
    Trait(
        "recall",
        ("works", "ignored"),
        "whether a waveform is selected by its name: not with firmware 6.01.01.37R6, but with 38R3, on an SDG6022X",
        models="SDG6",
    ),
    Trait(
        "rate-mode",
        ("present", "absent"),
        "whether it has SRATE: an SDG6022X with firmware 6.01.01.38R3 has not",
        models="SDG6",
    ),
    RETIME,
)
DEVIATIONS = (
    *deviations(),
    Trait(
        "byte-order",
        ("big", "little"),
        "order of the bytes of a waveform: big-endian in a public driver of two SDG6022X (nacs-lab/pyctrl), little-endian in Siglent's application note",
        models="SDG6",
    ),
)


class ReplyHeaders:
    """Form of the headers in replies: `CHDR SHORT`, `LONG` or `OFF`."""

    def __init__(self) -> None:
        self._form = "SHORT"

    def around(self, commands: Sequence[ScpiCommand]) -> list[ScpiCommand]:
        """Return the commands with replies in this form, and the command that chooses it."""
        chosen = ScpiCommand("CHDR", self._choose, lambda _: f"CHDR {self._form}")
        return [chosen, *(replace(each, query=each.query and partial(self._answer, each.query)) for each in commands)]

    def _choose(self, a: Arguments) -> None:
        self._form = a[0].upper()

    def _answer(self, query: Callable[[Arguments], str], a: Arguments) -> str:
        header, _, rest = query(a).partition(" ")
        name = header.removeprefix("C1:")
        if self._form == "OFF" and name in LONG_HEADERS:
            return rest
        return f"{header.replace(name, LONG_HEADERS.get(name, name)) if self._form == 'LONG' else header} {rest}"


class SimulatedSiglentSdg:
    """One channel over a `SimulatedGenerator` (sim_hardware.wires.scpi_engine.ScpiInstrument)."""

    SINGLE_SESSION = True

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        self.identity, self.traits = unit.identity, unit.traits
        self._is_sdg1000 = unit.model.startswith("SDG1")
        self._is_sdg2000 = unit.model.startswith("SDG2")
        self._is_sdg6000 = unit.model.startswith("SDG6")
        little = not self._is_sdg6000 or self.traits.get("byte-order") == "little"
        self._point_type = "<i2" if little else ">i2"
        self._random = random.Random(f"{unit.identity} {unit.seed}")
        self.hung = False
        self._large_downloads = 0
        self._silent_until_s = -math.inf
        self.queue_error: Callable[[ScpiError], None] = lambda _: None
        self._generator = generator
        self._now = now
        self._reset_state()

    def _reset_state(self) -> None:
        self._high_z = False
        self._inverted = {"PLRT": False, "INVT": False}
        self._switches: dict[str, bool] = {}
        self._headers = ReplyHeaders()
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
    def silent(self) -> bool:
        """Whether it does not answer: it stores a waveform, or hangs permanently."""
        return self.hung or self._now() < self._silent_until_s

    @property
    def commands(self) -> Sequence[ScpiCommand]:
        return self._headers.around(
            [
                ScpiCommand("C[1]:OUTP", self._set_output, lambda _: self._query_output()),
                ScpiCommand(
                    "C[1]:BSWV", lambda a: self._set_basic_wave(_parse_pairs(a)), lambda _: self._query_basic_wave()
                ),
                ScpiCommand("C[1]:BTWV", self._set_burst, lambda _: self._query_burst()),
                ScpiCommand("C[1]:WVDT", self._download),
                ScpiCommand("WVDT", None, self._query_waveform),
                ScpiCommand("C[1]:ARWV", self._select, lambda _: self._query_selection()),
                ScpiCommand("C[1]:INVT", self._set_inversion, lambda _: f"C1:INVT {self._on(self._inverted['INVT'])}"),
                ScpiCommand(
                    "C[1]:CMBN", partial(self._set_added, "CMBN"), lambda _: f"C1:CMBN {self._on(self._is_on('CMBN'))}"
                ),
                ScpiCommand("COUP", self._set_coupling, lambda _: self._query_coupling()),
                ScpiCommand("C[1]:SWWV", partial(self._set_mode, "SWWV"), partial(self._query_mode, "SWWV")),
                ScpiCommand("C[1]:MDWV", partial(self._set_mode, "MDWV"), partial(self._query_mode, "MDWV")),
                *(
                    []
                    if self._is_sdg1000
                    else [
                        ScpiCommand(
                            "C[1]:NOISE_ADD",
                            partial(self._set_added, "NOISE_ADD"),
                            partial(self._query_mode, "NOISE_ADD"),
                        )
                    ]
                ),
                *(
                    []
                    if self._is_sdg1000 or self.traits.get("rate-mode") == "absent"
                    else [ScpiCommand("C[1]:SRATE", self._set_rate_mode, lambda _: self._query_rate())]
                ),
            ]
        )

    @staticmethod
    def _on(on: bool) -> str:
        return "ON" if on else "OFF"

    def _is_on(self, switch: str) -> bool:
        return self._switches.get(switch, False)

    def _set_inversion(self, a: Arguments) -> None:
        self._invert("INVT", a[0].upper() == "ON")

    def _invert(self, switch: str, inverted: bool) -> None:
        self._inverted[switch] = inverted
        if self.traits.get("inversion") == "one-switch":
            self._inverted = dict.fromkeys(self._inverted, inverted)
            flipped = inverted
        else:
            flipped = self._inverted["PLRT"] != self._inverted["INVT"]
        self._generator.apply_settings(inverted=flipped)

    def _set_added(self, name: str, a: Arguments) -> None:
        """Switch the other channel, or the volts that represent the noise, onto the output."""
        self._switches[name] = a[-1 if name == "CMBN" else 1].upper() == "ON"
        volts = {"CMBN": OTHER_CHANNEL_V, "NOISE_ADD": NOISE_V}
        self._generator.apply_settings(added_v=sum(v for each, v in volts.items() if self._is_on(each)))

    @property
    def _coupling_names(self) -> tuple[str, ...]:
        return ("TRACE", "FCOUP", "PCOUP", "ACOUP") if self._is_sdg1000 else ("STATE", "TRACE")

    def _set_coupling(self, a: Arguments) -> None:
        for name, value in _parse_pairs(a).items():
            if name in self._coupling_names:
                self._switches[f"COUP {name}"] = value.upper() == "ON"

    def _query_coupling(self) -> str:
        pairs = ",".join(f"{name},{self._on(self._is_on(f'COUP {name}'))}" for name in self._coupling_names)
        return f"COUP {pairs}"

    def _set_mode(self, name: str, a: Arguments) -> None:
        if "STATE" in (requested := _parse_pairs(a)):
            self._switches[name] = requested["STATE"].upper() == "ON"
            if self._is_on(name):
                self._generator.apply_settings(burst=False)

    def _query_mode(self, name: str, _: Arguments) -> str:
        return f"C1:{name} STATE,{self._on(self._is_on(name))}"

    def _set_rate_mode(self, a: Arguments) -> None:
        if "MODE" in (requested := _parse_pairs(a)):
            self._switches["TARB"] = requested["MODE"].upper() == "TARB"

    def _query_rate(self) -> str:
        return "C1:SRATE MODE,TARB,VALUE,1e+06Sa/s" if self._is_on("TARB") else "C1:SRATE MODE,DDS"

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
            self._invert("PLRT", requested["PLRT"] == "INVT")

    def _query_output(self) -> str:
        on = "ON" if self._generator.settings.on else "OFF"
        return f"C1:OUTP {on},LOAD,{'HZ' if self._high_z else '50'},PLRT,{'INVT' if self._inverted['PLRT'] else 'NOR'}"

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
        if "AMP" not in requested and vpp > room:  # the amplitude is kept, the offset changes
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
            f"C1:BSWV WVTP,{kind},FRQ,{s.frequency_hz:.6g}HZ,PERI,{1 / s.frequency_hz:.6g}S,"
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
            if on:
                self._switches["SWWV"] = self._switches["MDWV"] = False
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
            f"C1:BTWV STATE,ON,PRD,{s.period_s:g}S,STPS,{s.phase_deg:g},TRSR,{source},TIME,{s.cycles:.0f},"
            "DLAY,2.4e-07S,GATE_NCYC,NCYC,CARR,WVTP,ARB"
        )

    def _download(self, a: Arguments) -> None:
        *parameters, data = a
        if len(parameters) % 2 == 0 or parameters[-1] != "WAVEDATA":
            return
        requested = _parse_pairs(parameters[:-1])
        raw = _without_block_header(data.encode("latin-1")) if self._is_sdg6000 else data.encode("latin-1")
        if (self._is_sdg2000 and len(requested) > 1) or self._is_sdg6000 != (requested.get("WVTP") == "USER"):
            return  # silently not stored
        self._large_downloads += len(raw) > LARGE_BYTES
        self.hung = self.hung or self._large_downloads >= 3 or len(raw) < 4
        points = np.frombuffer(raw[: len(raw) // 2 * 2], self._point_type) / FULL_SCALE
        self._stored_waveforms[requested["WVNM"]] = points, requested
        self._switch_to(requested["WVNM"])
        self._be_silent(len(raw))

    def _be_silent(self, size: int) -> None:
        long = self.traits.get("silence") == "long" and self._random.random() < 0.3
        self._silent_until_s = self._now() + (self._random.uniform(1.0, 5.5) if long else 0.05) + size / 100e3

    def _select(self, a: Arguments) -> None:
        name = _parse_pairs(a).get("NAME", "")
        if name not in self._stored_waveforms or self.traits.get("recall") == "ignored":
            return
        if name != self._selected_name and self.traits.get("stale") == "often" and self._random.random() < 0.4:
            return
        self._switch_to(name)
        self._be_silent(0)

    def _switch_to(self, name: str) -> None:
        self._selected_name = name
        points, brought = self._stored_waveforms[name]
        self._generator.apply_settings(wave=ArbitraryWaveform(points))
        if self.traits.get("selection") == "restores-levels":
            self._set_basic_wave({own: brought[theirs] for own, theirs in _STORED_PARAMETERS if theirs in brought})

    def _query_selection(self) -> str:
        name = self._selected_name
        return f"C1:ARWV INDEX,2,NAME,{name}" if name == BUILT_IN_NAME else f"C1:ARWV NAME,{name}.bin"

    def _query_waveform(self, a: Arguments) -> str:
        name = a[-1]
        raw = (
            np.rint(self._stored_waveforms[name][0] * FULL_SCALE).astype(self._point_type).tobytes()
            if name in self._stored_waveforms
            else b""
        )
        return f"WVDT POS,Local/,WVNM,{name},LENGTH,{len(raw)}B,TYPE,5,WAVEDATA,{raw.decode('latin-1')}"


_STORED_PARAMETERS = (("FRQ", "FREQ"), ("AMP", "AMPL"), ("OFST", "OFST"))


def _without_block_header(block: bytes) -> bytes:
    """Return the bytes of a block, as many as its header announces; none without a header."""
    digits = int(block[1:2]) if block[:1] == b"#" else 0
    return block[2 + digits :][: int(block[2 : 2 + digits])] if digits else b""


def _parse_pairs(arguments: Sequence[str]) -> dict[str, str]:
    return {name.upper(): value for name, value in zip(arguments[::2], arguments[1::2], strict=False)}


def _parse_value(text: str) -> float:
    return float(text.upper().rstrip("HZVSDEG"))


SIMULATED = {"siglent-sdg": SimulatedSiglentSdg}
