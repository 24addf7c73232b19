"""A fourth set of departures, written before its first run from physics, with knowledge of the list of causes.

Kinds, sizes or combinations are those of no other set. Some lie outside the list: a constant phase, crosstalk, a notch, memory of the level
before, a mass lost within a dwell; of those without any true word among the causes nothing is accepted. Of two departures at once, either.
"""

from dataclasses import replace

import numpy as np

from tests.helpers.laboratory import Laboratory
from tests.helpers.model.departures import dynamic, from_place, scaled
from tests.helpers.model.laboratories import Departure, Raw
from tests.helpers.model.withheld_departures_2 import DRIVEN_KINDS, MEMBRANE_OR_SAG, _of_kinds, _of_label, _over_x
from tests.helpers.model.withheld_departures_3 import _changing

NO_WORD: tuple[str, ...] = ()


def _wandering(raw: Raw) -> None:
    """Sun on the stand: the zero goes up and comes back."""
    raw.w = raw.w + 8e-6 * np.sin(np.pi * np.linspace(0, 1, raw.w.size))


def _clipped_at(limit_m: float):
    """The fundamental of sines that the end of the sensor's range cuts."""

    def change(raw: Raw) -> None:
        r = np.minimum(limit_m / abs(raw.w), 1.0)
        raw.w = raw.w * 2 / np.pi * (np.arcsin(r) + r * np.sqrt(1 - r**2))

    return change


def _misread(at: int, hz: float):
    def change(raw: Raw) -> None:
        raw.w = raw.w + np.where(np.arange(raw.w.size) == at, hz, 0.0)

    return change


def _remembers(share: float):
    """Every reading is taken too soon: a share of the way from the level before is missing."""

    def change(raw: Raw) -> None:
        before = np.concatenate(([0.0], raw.w[:-1]))
        raw.w = raw.w + share * (before - raw.w)

    return change


def _rest_below(volts: float):
    """The generator's offset is low: levels and rest lie on the smaller slope, and above the kink it is missed."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind == "steps":
            raw.w = raw.w - np.where(raw.x > 2.5, -400 * volts * lab.response(np.zeros(1))[0].real, 0.0)

    return read


def _loose_hum(raw: Raw) -> None:
    """Mains of 50 Hz that start anywhere, so that every run has its own phase."""
    raw.w = raw.w + np.where(raw.x == 50, 6e-6 * np.exp(2.1j * raw.place), 0.0)


def _crosstalk(raw: Raw) -> None:
    """A share of the drive couples into the sensor's line: a constant beside the displacement."""
    raw.w = raw.w + 3e-6


def _notch(f: np.ndarray) -> np.ndarray:
    """A filter against mains that somebody left on, 50 Hz with a quality of 5, not quite tuned."""
    r = f / 50.6
    return (1 - r**2) / (1 - r**2 + 1j * r / 5)


def _butterworth(f: np.ndarray) -> np.ndarray:
    s = 1j * f / 900
    return 1 / (1 + np.sqrt(2) * s + s**2)


def _turned(factor: float):
    """Turns of the screw that stretches were counted with the pitch of another one."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.elongation_m:
            raw.elongation_m = factor * raw.elongation_m

    return read


def _decimal_of_elongation(raw: Raw) -> None:
    raw.elongation_m = 6.35e-4


def _both(*changes):
    def read(raw: Raw, lab: Laboratory) -> None:
        for change in changes:
            change(raw, lab)

    return read


def _left_on(kg: float, *labels: str):
    return lambda label, place, lab: {"m_add": lab.m_add + kg} if label in labels else {}


WITHHELD_4: tuple[Departure, ...] = (
    # weights and masses
    Departure("sun on the stand", "8 um and back", ("zero of loading mfc", "(drift in|repeat 2 of) loading mfc"), read=_of_label("loading mfc", _wandering)),
    Departure("weights of one side in ounces as grams", "x 28.35", ("scale of loading mfc",), read=_of_label("loading mfc", lambda raw: setattr(raw, "x", raw.x / 28.35))),
    Departure("balance of the masses", "3 % more", ("(stated )?mass_fraction", "(stated )?added masses", "time base of masses"), read=_of_kinds(("masses",), lambda raw: setattr(raw, "x", 1.03 * raw.x))),
    Departure("side maximum taken for the resonance", "-4 Hz", ("point 6 of masses",), read=_of_kinds(("masses",), _misread(5, -4.0))),
    # steps
    Departure("levels read too soon", "2.5 % of the way", ("(stated )?(hysteresis|creep)", "creep of the dwells"), read=_of_kinds(("steps",), _remembers(0.025))),
    Departure("supply ends before the last level", "3.5 % at 5 V", ("softening of steps", r"points? \d+.* of steps"), read=_of_label("steps", _over_x(lambda u: np.where(u == 5, 0.965, 1.0)))),
    Departure("steps with the leads exchanged", "x -1", ("scale of steps",), read=scaled("steps", -1.0)),
    Departure("probe set to ten", "x 0.1", ("scale of steps", "scale of all dwells"), read=scaled("steps", 0.1)),
    Departure("offset of the generator is low", "-15 mV", ("(rest|zero) of steps", "(stated )?gain_below_rest"), read=_rest_below(-0.015)),
    # phase, filters, hum
    Departure("hum of its own phase in every run", "6 um at 50 Hz", ("hum at 50 Hz", r"points? 2.* of .*"), read=_of_kinds(("dwell",), _loose_hum)),
    Departure("phase of the lock-in everywhere", "+3 degrees", ("creep of the dwells",), read=dynamic(lambda f: np.exp(1j * np.radians(3)) + 0 * f)),
    Departure("filter of the sensor", "900 Hz, second order", ("roll-off", "(stated )?delay.*"), read=dynamic(_butterworth)),
    Departure("notch against mains", "50.6 Hz, Q 5", NO_WORD, read=dynamic(_notch)),
    Departure("crosstalk of the drive", "3 um", NO_WORD, read=_of_kinds(DRIVEN_KINDS, _crosstalk)),
    Departure("preamplifier coupled by a capacitor", "0.4 Hz", ("high-pass",), read=dynamic(lambda f: 1 / (1 - 0.4j / f))),
    Departure("sensor at the end of its range", "0.1 mm", ("softening of .*", "sensor curvature"), read=_of_kinds(DRIVEN_KINDS, _clipped_at(1e-4))),
    # the specimen changes
    Departure("specimen warms through the session", "-4 % of its stiffness", ("stiffness over the runs",), run_fields=lambda label, place, lab: {"k2": lab.k2 * (1 - 0.04 * min(place / 9, 1.0))}),
    Departure("specimen warms in the first minutes of a dwell", "-3 %, a fifth of the run", ("stiffness within membrane 0 mm",), read=_changing("membrane 0 mm", lambda lab, e, t: (replace(lab, k2=lab.k2 * (1 - 0.03 * (1 - np.exp(-t / 0.2)))), e))),
    Departure("film loses its polarization", "-5 % of the moment", ("scale from membrane 2.54 mm on", "gain_drift"), run_fields=lambda label, place, lab: {"mu": 0.95 * lab.mu} if place >= 6 else {}),
    Departure("tape on the clamp until the membrane", "20 % damping", ("damping (of|from) .*",), run_fields=lambda label, place, lab: {"c0": 1.2 * lab.c0} if place < 5 else {}),
    Departure("membrane dries before the last", "25 % of its damping", ("damping (of|from) membrane 6.35 mm.*",), run_fields=lambda label, place, lab: {"c_s_0": 1.25 * lab.c_s_0} if label == "membrane 6.35 mm" else {}),
    Departure("mass falls off within a dwell", "0.4 g", ("(mass of|drift in) dwell again", "mass from dwell again on"), read=_changing("dwell again", lambda lab, e, t: (replace(lab, m_add=lab.m_add - (4e-4 if t > 0.5 else 0.0)), e))),
    Departure("a mass left on", "1.75 g", ("mass of dwell again",), run_fields=_left_on(1.75e-3, "dwell again")),
    # membrane, sheet
    Departure("turns of another screw", "7 %", ("(stated )?elongation_slip",), read=_turned(1.067)),
    Departure("decimal point of an elongation", "6.35 as 0.635 mm", ("elongation of membrane 6.35 mm",), read=_of_label("membrane 6.35 mm", _decimal_of_elongation)),
    Departure("sag read to the wrong edge", "0.3 mm", (*MEMBRANE_OR_SAG, "zero of sag"), read=_of_label("sag", lambda raw: setattr(raw, "w", raw.w + 3e-4))),
    Departure("lengths with the edge of the clamp", "1.2 mm", ("stated L1?",), sheet={"L": 1.2e-3, "L1": 1.2e-3}),
    # two at once
    Departure("laser and plate moved before the membrane", "3 %, 5 %", ("(scale|clamp) (of|from) (membrane 0 mm|all dwells on the membrane).*",), run_fields=from_place(5, clamp=0.05), read=_both(scaled("membrane", 1.03), scaled("dwell again", 1.03))),
    Departure("tare and a clock", "3 g, 0.6 %", ("load_offset", "(time base|frequency) of dwell"), {"load_offset_kg": 3e-3}, run_fields=lambda label, place, lab: {"frequency_error": 6e-3} if label == "dwell" else {}),
)  # fmt: skip
"""Seeds of the laboratories: stream 2816."""
