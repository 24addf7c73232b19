"""Departures that were kept from the development of the attribution: other kinds, laws, sizes, runs and laboratories."""

import numpy as np

from tests.helpers.laboratory import Laboratory
from tests.helpers.model.departures import dynamic, from_place, in_run, one_point, scaled, stand, wrong_side
from tests.helpers.model.laboratories import Departure, Raw


def _in_kind(kind: str, change):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind == kind:
            change(raw)

    return read


def _exchanged(i: int, j: int):
    def change(raw: Raw) -> None:
        raw.x = raw.x.copy()
        raw.x[[i, j]] = raw.x[[j, i]]

    return change


def _warming(label: str, share: float):
    """A gain that settles like a laser that warms up: an exponential, a third of the run long."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label:
            t = np.linspace(0, 1, raw.w.size)
            raw.w = raw.w * (1 - share * np.exp(-3 * t))

    return read


def _clipped(raw: Raw) -> None:
    """The amplifier's output gives less at its highest levels."""
    raw.w = raw.w * np.where(raw.x > 4.3, 0.955, 1.0)


def _held_back(raw: Raw) -> None:
    """The clamp gives way under the largest weight only."""
    raw.w = raw.w * np.where(raw.x > 0.9 * raw.x.max(), 1.04, 1.0)


def _zero_creeps(raw: Raw) -> None:
    raw.w = raw.w + 1.2e-5 * np.linspace(0, 1, raw.w.size) ** 2


def _butterworth(corner_hz: float):
    return lambda f: 1 / (1 + 1j * np.sqrt(2) * f / corner_hz - (f / corner_hz) ** 2)


def _late_phase(f: np.ndarray) -> np.ndarray:
    return np.exp(-2j * np.pi * f * 6e-5)


def _elongations(shift_m: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.elongation_m is not None and raw.elongation_m > 0:
            raw.elongation_m = raw.elongation_m + shift_m

    return read


def _hum_at(index: int, added_m: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == "membrane 0 mm":
            raw.w = raw.w.copy()
            raw.w[index] += added_m * (0.6 + 0.8j)

    return read


WITHHELD: tuple[Departure, ...] = (
    Departure("low-pass of second order", "900 Hz", ("roll-off",), read=dynamic(_butterworth(900.0))),
    Departure("low-pass of second order", "1500 Hz", ("roll-off", "delay"), read=dynamic(_butterworth(1500.0))),
    Departure("loose mount", "185 Hz, 4 %, Q 15", ("stand resonance",), read=dynamic(stand(185, 0.04, 15))),
    Departure("loose mount", "63 Hz, 3 %, Q 8", ("stand resonance",), read=dynamic(stand(63, 0.03, 8))),
    Departure("stand as a base in motion", "120 Hz", ("stand resonance",), read=dynamic(lambda f: 1 + 0.003 / (1 - (f / 120) ** 2 + 1j * f / 120 / 18))),
    Departure("Duffing", "-10 %", ("stiffening",), {"stiffening": -0.1}),
    Departure("Duffing", "25 %", ("stiffening",), {"stiffening": 0.25}),
    Departure("clamp gives under the largest weight", "4 %", ("slip under load", "softening under load"), read=_in_kind("loading", _held_back)),
    Departure("two masses exchanged", "3 and 6", ("exchange in masses",), read=_in_kind("masses", _exchanged(2, 5))),
    Departure("two masses exchanged", "8 and 9", ("exchange in masses",), read=_in_kind("masses", _exchanged(7, 8))),
    Departure("warming up in a dwell", "6 %", ("drift in dwell again",), read=_warming("dwell again", 0.06)),
    Departure("warming up in a dwell", "2 %", ("drift in membrane 6.35 mm",), read=_warming("membrane 6.35 mm", 0.02)),
    Departure("a membrane dwell peak to peak", "x 2", ("scale of membrane 0 mm",), read=scaled("membrane 0", 2.0)),
    Departure("loads of one side in other units", "x 1.0197", ("scale of loading aluminium", "stated asymmetry"), read=scaled("loading alu", 1.0197)),
    Departure("time base of a dwell", "0.8 %", ("time base of membrane 2.54 mm",), run_fields=in_run("membrane 2.54 mm", frequency_error=0.008)),
    Departure("time base of the second dwell", "-0.4 %", ("time base of dwell again",), run_fields=in_run("dwell again", frequency_error=-0.004)),
    Departure("mass glued again", "0.2 g", ("mass (of|from) membrane 2.54 mm.*",), run_fields=from_place(6, m_add=2e-4)),
    Departure("mass glued again", "-0.4 g", ("mass (of|from) membrane 0 mm.*",), run_fields=from_place(5, m_add=-4e-4)),
    Departure("plate clamped again", "5 %", ("clamp (of|from) membrane 2.54 mm.*",), run_fields=from_place(6, clamp=0.05)),
    Departure("plate clamped again, last dwell", "4 %", ("clamp (of|from) dwell again.*",), run_fields=in_run("dwell again", clamp=0.04)),
    Departure("elongations read short", "-0.7 mm", ("elongation_offset", "(stated )?elongation_slip"), read=_elongations(-7e-4)),
    Departure("tare taken off twice", "-2 g", ("load_offset",), {"load_offset_kg": -2e-3}),
    Departure("one side scaled", "3 %", ("scale of loading mfc", "stated asymmetry"), read=scaled("loading mfc", 1.03)),
    Departure("highest levels fall short", "4.5 %", ("softening of steps",), read=_in_kind("steps", _clipped)),
    Departure("zero creeps", "12 um", ("zero_drift",), read=_in_kind("loading", _zero_creeps)),
    Departure("lateness not corrected", "60 us", ("(stated )?delay.*",), read=dynamic(_late_phase)),
    Departure("slope below rest", "4 %", ("(stated )?gain_below_rest",), {"gain_below": 0.04}),
    Departure("plate's thickness", "12 %", ("stated (h_Al|E_Al|b_Al)",), sheet={"h_Al": 0.12 * 2e-4}),
    Departure("length L", "1.8 mm", ("stated (L|L2)",), sheet={"L": 1.8e-3}),
    Departure("membrane's thickness", "12 %", ("stated h_m",), sheet={"h_m": 0.12 * 1.4e-3}),
    Departure("hum on one point", "3 um", ("point 4 of membrane 0 mm",), read=_hum_at(3, 3e-6)),
    Departure("one point of the second dwell", "6 %, turned", ("point 9 of dwell again",), read=one_point("dwell again", 8, 1.05 * np.exp(0.05j))),
    Departure("second repeat on the wrong side", "", ("repeat 3 of loading aluminium",), {"asymmetry": -0.06}, read=wrong_side("loading aluminium", 2)),
    Departure("steps scaled", "-3 %", ("scale of (steps|all dwells)",), read=scaled("steps", 0.97)),
    Departure("steps scaled", "8 %", ("scale of (steps|all dwells)",), read=scaled("steps", 1.08)),
    Departure("one membrane dwell scaled", "-5 %", ("scale of membrane 6.35 mm",), read=scaled("membrane 6.35", 0.95)),
    Departure("clamp turns", "18 %", ("(stated )?clamp_flexibility",), {"clamp": 0.18}),
    Departure("one elongation", "-0.7 mm", ("elongation of membrane 6.35 mm",), read=lambda raw, lab: setattr(raw, "elongation_m", 5.65e-3) if raw.label == "membrane 6.35 mm" else None),
    Departure("one resonance misread", "2 Hz", ("point 7 of masses",), read=_in_kind("masses", lambda raw: raw.w.__setitem__(6, raw.w[6] + 2.0))),
)  # fmt: skip
"""Sizes and labels differ from those of the development; seeds of the laboratories begin at 5000."""
