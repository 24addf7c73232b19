"""Simulated Tektronix AFG3000, AFG31000 or AFG1000 function generator, after its programmer manual.

Pitfalls: a burst is triggered by the internal timer by default, again and again; no range can be frozen; an AFG1000's built-in DC
ignores the offset, and its load can be set at the front panel only; polarity, and with two channels concurrent settings and added
noise or external signals persist. An AFG31000 waits at the first point of a burst, its last one or the offset, by a setting, and
may play its sequencer instead.
"""

import re
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

import numpy as np

from sim_hardware import wires
from sim_hardware.generators.generator import InstrumentUnit, SimulatedGenerator
from sim_hardware.generators.scpi_generator import OTHER_CHANNEL_V, SOURCE, SimulatedScpiGenerator, decode_block
from sim_hardware.generators.scpi_levels import MIN_EMF_VPP
from sim_hardware.generators.traits import RETIME, UNKNOWN_HEADER, Trait, deviations

FULL_SCALE = 16382

TRAITS = (
    UNKNOWN_HEADER,
    Trait("polarity", ("present", "absent"), "whether it has OUTPut:POLarity: no public driver uses it", models="AFG1"),
    Trait(
        "idle-setting",
        ("START", "DC", "END"),
        "where a burst waits after a reset: its setting exists, its factory value is in no source",
        models=r"AFG31\d{3}",
    ),
    Trait("sequencer", ("present", "absent"), "whether it knows SEQControl without the option", models=r"AFG31\d{3}"),
    RETIME,
)
DEVIATIONS = deviations(combining="AFG3")


class SimulatedTektronixAfg(SimulatedScpiGenerator):
    """AFG3000, AFG31000 and AFG1000."""

    MAX_FREQUENCY_HZ = 25e6
    MAX_BURST_CYCLES = 1e6
    ARBITRARY_KEYWORD = "EMEMory"
    TRIGGER_KEYWORDS: ClassVar[Mapping[str, str]] = {"TIMer": "IMM", "EXTernal": "BUS"}
    TRIGGER_HEADER = "TRIGger[:SEQuence]"

    def __init__(self, generator: SimulatedGenerator, now: Callable[[], float], unit: InstrumentUnit) -> None:
        super().__init__(generator, now, unit)
        self._is_afg1000 = self._model.startswith("AFG1")
        self._is_afg31000 = re.match(r"AFG31\d{3}", self._model) is not None
        self._idle_keyword = self.traits.get("idle-setting", "START")
        self._memory_points = 8192 if self._is_afg1000 else 65_536
        self._edit_memory = np.zeros(1000)
        self._high_z = unit.high_z_by_hand  # the load set at the front panel of an AFG1000
        if self._is_afg1000 and self._high_z:
            self._levels.set_load(["INF"])

    def reset(self) -> None:
        super().reset()
        self._generator.apply_settings(period_s=1e-3)
        self._idle_keyword = self.traits.get("idle-setting", "START")
        if self._is_afg1000 and self._high_z:
            self._levels.set_load(["INF"])

    @property
    def _min_emf_vpp(self) -> float:
        # Into 50 ohm 10, 20 and 50 mVpp by the group of models, AFG1000 and AFG31000 1 mVpp (tm_devices at db887dd).
        if re.match(r"AFG31\d{3}", self._model):
            return MIN_EMF_VPP
        return {"AFG30": 0.02, "AFG31": 0.04, "AFG32": 0.1}.get(self._model[:5], MIN_EMF_VPP)

    @property
    def commands(self) -> Sequence[wires.ScpiCommand]:
        levels = self._levels
        shared = [c for c in levels.commands(SOURCE) if not any(w in c.pattern for w in (":RANGe", ":LOAD", ":STATe"))]
        load = wires.ScpiCommand("OUTPut[1]:IMPedance", levels.set_load, lambda _: self.format_number(levels.load_ohm))
        kept = [c for c in shared if not (self._is_afg1000 and "LIMit" in c.pattern)]
        return [
            *kept,
            *([] if self._is_afg1000 else [load]),
            *super().commands,
            self._choice(SOURCE + "FREQuency:MODE", "sweep", {"CW": False, "FIXed": False, "SWEep": True}),
            *self._other_channel_commands(),
            *self._afg31000_commands(),
            *([] if self._is_afg1000 else [self._stored_switch("SYSTem:KLOCk[:STATe]")]),
            self._number(SOURCE + "BURSt:TDELay", "delay_s", "S", 0.0, 85.0, 0.0),
            wires.ScpiCommand("TRACe:DEFine", self._define_edit_memory),
            wires.ScpiCommand("DATA:DEFine", self._define_edit_memory),
            wires.ScpiCommand("DATA[:DATA]", self._download),
            wires.ScpiCommand("DATA:POINts", None, lambda _: str(self._edit_memory.size)),
        ]

    def _afg31000_commands(self) -> list[wires.ScpiCommand]:
        if not self._is_afg31000:
            return []
        places = {place: place for place in ("START", "DC", "END")}
        idle = self._choice(SOURCE + "BURSt:IDLE", "_idle_keyword", places, self._wait_where_set)
        return [idle, *([] if self.traits.get("sequencer") == "absent" else [self._sum_command("SEQControl:STATe")])]

    def _wait_where_set(self) -> None:
        if self._is_afg31000:
            wave = self._generator.settings.wave
            last = float(wave.points[-1]) if wave else 0.0
            levels = {"START": None, "DC": 0.0, "END": last}
            self._generator.apply_settings(idle=levels[self._idle_keyword])

    def _other_channel_commands(self) -> list[wires.ScpiCommand]:
        if self._is_afg1000:
            return []
        feed = self._setting(
            SOURCE + "COMBine:FEED",
            "added_v",
            lambda text: OTHER_CHANNEL_V if text.strip("\"'") else 0.0,
            lambda volts: '"EXTERNAL"' if volts else '""',
        )
        concurrent = (
            f"{source}{quantity}:CONCurrent[:STATe]"
            for source in (SOURCE, "SOURce2:")
            for quantity in ("VOLTage", "FREQuency")
        )
        two = re.match(r"AFG3\d+", self._model)
        if two is None or not two[0].endswith("2"):
            return [feed]
        return [feed, *(self._stored_switch(pattern) for pattern in concurrent)]

    def trigger(self) -> None:
        # *TRG fires an external trigger; no other command does.
        s = self._generator.settings
        if not s.burst or s.trigger != "BUS" or self.busy_s() > 0:
            raise wires.ScpiError(-211)
        self._generator.trigger()

    def _select_function(self, function: str) -> None:
        super()._select_function(function)
        if function == "ARB":
            self._load_waveform(self._edit_memory)
            self._wait_where_set()
        elif function == "DC" and self._is_afg1000:
            self._generator.apply_settings(emf_offset_v=0.0)

    def _define_edit_memory(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 2)
        wires.match_keyword(a[0], "EMEMory")
        size = int(wires.parse_number(a[1], ""))
        if not 2 <= size <= self._memory_points:
            raise wires.ScpiError(-222)
        self._set_edit_memory(np.zeros(size))

    def _download(self, a: wires.Arguments) -> None:
        wires.check_argument_count(a, 2)
        wires.match_keyword(a[0], "EMEMory")
        points = decode_block(a[1], ">u2", 0, FULL_SCALE)
        if points.size > self._memory_points:
            raise wires.ScpiError(-225)
        self._set_edit_memory(2 * points / FULL_SCALE - 1)

    def _set_edit_memory(self, points: np.ndarray) -> None:
        self._edit_memory = points
        if self._generator.settings.function == "ARB":
            self._load_waveform(points)
            self._wait_where_set()


SIMULATED = {"tektronix-afg": SimulatedTektronixAfg}
