"""A second set of departures that was kept from the development of the attribution, and opened once.

Names and sizes are unique also with respect to `departures.py` and `withheld_departures.py`. Titles are accepted generously where two are the
same physical statement or cannot be told apart by the runs of these laboratories, and strictly otherwise.
"""

import numpy as np

from tests.helpers.laboratory import Laboratory
from tests.helpers.model.departures import dynamic, from_place, in_run, one_point, scaled, stand, wrong_side
from tests.helpers.model.laboratories import Departure, Raw

STATIC_KINDS = ("loading", "steps")
DRIVEN_KINDS = ("dwell", "sweep")
FIRST_DWELL = r"dwell(?! again).*"


def _of_label(label: str, change):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label:
            change(raw)

    return read


def _of_kinds(kinds: tuple[str, ...], change):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in kinds:
            change(raw)

    return read


def _in_time(law):
    """Return a change by a factor over the share of the run that has passed."""

    def change(raw: Raw) -> None:
        raw.w = raw.w * law(np.linspace(0, 1, raw.w.size))

    return change


def _over_x(law):
    """Return a change by a factor over what was set."""

    def change(raw: Raw) -> None:
        raw.w = raw.w * law(raw.x)

    return change


def _zero(law):
    """Return a change of the zero over the share of the run that has passed."""

    def change(raw: Raw) -> None:
        raw.w = raw.w + law(np.linspace(0, 1, raw.w.size))

    return change


def _afternoon(law):
    """Return a change of all that is driven by a factor over the place of the run after the first dwell."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in DRIVEN_KINDS:
            raw.w = raw.w * law(raw.place - 4)

    return read


def _bent_sensor(static, fundamental):
    """Return a change by a sensor that is not straight: its factor over mm, and that of the fundamental of a sine."""

    def read(raw: Raw, lab: Laboratory) -> None:
        mm = np.abs(raw.w) / 1e-3
        if raw.kind in STATIC_KINDS:
            raw.w = raw.w * static(mm)
        elif raw.kind in DRIVEN_KINDS:
            raw.w = raw.w * fundamental(mm)

    return read


def _digits_exchanged(at: int):
    """Return a change in which the second digit of a reading in micrometres and the first digit after it that differs change places."""

    def change(raw: Raw) -> None:
        digits = list(f"{1e6 * abs(raw.w[at]):.6e}".replace(".", ""))  # e.g. 2905123e+02
        other = next(i for i in range(2, 7) if digits[i] != digits[1])
        digits[1], digits[other] = digits[other], digits[1]
        text = "".join(digits)
        raw.w = raw.w.copy()
        raw.w[at] = np.sign(raw.w[at]) * 1e-6 * float(text[0] + "." + text[1:])

    return change


def _typed_mass(at: int, kg: float):
    def change(raw: Raw) -> None:
        raw.x = raw.x.copy()
        raw.x[at] = kg

    return change


def _exchanged(i: int, j: int):
    def change(raw: Raw) -> None:
        raw.x = raw.x.copy()
        raw.x[[i, j]] = raw.x[[j, i]]

    return change


def _typed_elongation(m: float):
    def change(raw: Raw) -> None:
        raw.elongation_m = m

    return change


def _repeat_scaled(repeat: int, factor: float):
    def change(raw: Raw) -> None:
        raw.w = np.where(raw.repeat == repeat, raw.w * factor, raw.w)

    return change


def _tare_of_one_side(kg: float):
    """A hook that hangs on one side only and is not written down."""

    def change(raw: Raw) -> None:
        raw.w = raw.w * (1 + kg * 9.80665 / raw.x)

    return change


def _soft_stop(from_m: float, share: float):
    """A stop of foam: beyond a deflection, a share of what follows is missing."""

    def change(raw: Raw) -> None:
        raw.w = raw.w - share * np.maximum(raw.w - from_m, 0.0)

    return change


def _tilted(degrees: float):
    """The laser reads along its own axis."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in (*STATIC_KINDS, *DRIVEN_KINDS, "sag"):
            raw.w = raw.w / np.cos(np.radians(degrees))

    return read


def _averaged(seconds: float):
    """Return the magnitude of a moving average whose delay was taken off."""
    return lambda f: np.sinc(f * seconds)


def _hidden_mode(at_hz: float, size: float, q: float):
    """Return a factor of a mount that takes up motion at its resonance."""
    factor = stand(at_hz, size, q)
    return lambda f: 1 / factor(f)


MEMBRANE_OR_SAG = ("stated (b_m|h_m|L_m)", "scale of sag", "(stated )?elongation_slip")
"""The modulus of the membrane is free: only the sag against the stiffness of the stretched membrane shows any of these."""

WITHHELD_2: tuple[Departure, ...] = (
    # gains that drift within a run
    Departure("laser warms up in the first dwell", "5 %, 0.45 of the run", ("drift in dwell",), read=_of_label("dwell", _in_time(lambda t: 1 - 0.05 * np.exp(-t / 0.45)))),
    Departure("one dwell with another averaging", "1.2 ms", ("drift in membrane 2.54 mm",), read=_of_label("membrane 2.54 mm", _over_x(_averaged(1.2e-3)))),
    Departure("glue under the hook creeps", "5 %, square root of time", ("drift in loading aluminium",), read=_of_label("loading aluminium", _in_time(lambda t: 1 + 0.05 * np.sqrt(t)))),
    # filters
    Departure("moving average of the laser", "0.9 ms", ("roll-off",), read=dynamic(_averaged(0.9e-3))),
    Departure("resistor before the actuator's capacitance", "1300 Hz", ("roll-off", "(stated )?delay.*"), read=dynamic(lambda f: 1 / (1 + 1j * f / 1300))),
    # scales
    Departure("second dwell with the laser aimed again", "-4.5 %", ("scale of dwell again",), read=scaled("dwell again", 0.955)),
    # mounts
    Departure("mount of the laser detuned", "215 Hz, 5 %, Q 20", ("stand resonance",), read=dynamic(stand(215, 0.05, 20))),
    Departure("mount takes up motion", "135 Hz, 4 %, Q 14", ("stand resonance",), read=dynamic(_hidden_mode(135, 0.04, 14))),
    # springs that are not straight
    Departure("film softens", "-14 %", ("stiffening",), {"stiffening": -0.14}),
    Departure("film stiffens a little", "5 %", ("stiffening",), {"stiffening": 0.05}),
    Departure("soft stop under the largest weight", "10 % beyond 0.35 mm", ("slip under load", "softening under load", "stiffening"), read=_of_kinds(("loading",), _soft_stop(3.5e-4, 0.1))),
    Departure("clamp slips as a square root", "5 % from 0.6 N", ("slip under load", "softening under load"), read=_of_kinds(("loading",), _over_x(lambda n: 1 + 0.05 * np.sqrt(np.maximum(n - 0.6, 0.0) / n.max())))),
    # sensors that are not straight
    Departure("laser bends with the cube", "7 % at 1 mm", ("sensor curvature",), read=_bent_sensor(lambda w: 1 + 0.07 * w**2, lambda w: 1 + 0.75 * 0.07 * w**2)),
    Departure("laser bends as a square root", "-5 % at 1 mm", ("sensor curvature",), read=_bent_sensor(lambda w: 1 - 0.05 * np.sqrt(w), lambda w: 1 - 0.915 * 0.05 * np.sqrt(w))),
    # mountings
    Departure("plate not yet tight in the first dwell", "6 %", (f"clamp (of|from) {FIRST_DWELL}", "clamp from membrane 0 mm.*"), run_fields=in_run("dwell", clamp=0.06)),
    Departure("mount detuned before the last membrane", "9 %", ("clamp (of|from) membrane 6.35 mm.*",), run_fields=from_place(7, clamp=0.09)),
    Departure("mass lost before the last membrane", "-0.35 g", ("mass (of|from) membrane 6.35 mm.*",), run_fields=from_place(7, m_add=-3.5e-4)),
    Departure("reflecting tape in the first dwell only", "0.25 g", (f"mass (of|from) {FIRST_DWELL}", "mass from membrane 0 mm.*"), run_fields=in_run("dwell", m_add=2.5e-4)),
    # single points
    Departure("digits of a reading exchanged", "two digits", ("point 11 of loading aluminium",), read=_of_label("loading aluminium", _digits_exchanged(10))),
    Departure("loose connector in one point", "-7 %, turned", ("point 11 of membrane 6.35 mm",), read=one_point("membrane 6.35 mm", 10, 0.93 * np.exp(-0.06j))),
    Departure("digits of a mass exchanged", "8.75 as 8.57 g", ("point 8 of masses",), read=_of_kinds(("masses",), _typed_mass(7, 8.57e-3))),
    Departure("labels of two masses exchanged", "5 and 7", ("exchange in masses",), read=_of_kinds(("masses",), _exchanged(4, 6))),
    # clocks
    Departure("generator's clock in the first dwell", "0.7 %", (f"(time base|frequency) of {FIRST_DWELL}",), run_fields=in_run("dwell", frequency_error=7e-3)),
    Departure("generator's clock on the last membrane", "-1.5 %", ("(time base|frequency) of membrane 6.35 mm",), run_fields=in_run("membrane 6.35 mm", frequency_error=-1.5e-2)),
    # zeros, tares
    Departure("hook on one side only", "6 g", ("load_offset",), read=_of_label("loading aluminium", _tare_of_one_side(6e-3))),
    Departure("draught on the balance", "0.35 g", ("load_offset",), {"load_offset_kg": 3.5e-4}),
    Departure("laser's zero warms up", "18 um, a quarter of the run", ("zero_drift",), read=_of_kinds(("loading",), _zero(lambda t: 1.8e-5 * (1 - np.exp(-t / 0.25))))),
    Departure("tripod was touched", "-9 um from the ninth reading", ("zero_drift",), read=_of_kinds(("loading",), _zero(lambda t: np.where(t > 0.55, -9e-6, 0.0)))),
    # gains over the afternoon
    Departure("room warms over the afternoon", "3.5 %, square root of time", ("gain_drift",), read=_afternoon(lambda p: 1 + 0.035 * np.sqrt(p / 6))),
    # membrane
    Departure("membrane glued under tension", "0.3 mm", ("elongation_offset",), {"elongation_offset_m": 3e-4}),
    Departure("digits of an elongation exchanged", "6.35 as 6.53 mm", ("elongation of membrane 6.35 mm",), read=_of_label("membrane 6.35 mm", _typed_elongation(6.53e-3))),
    Departure("slack membrane not slack", "0.4 mm", ("elongation of membrane 0 mm",), run_fields=in_run("membrane 0 mm", elongation_offset_m=4e-4)),
    Departure("sag read with parallax", "15 %", MEMBRANE_OR_SAG, read=scaled("sag", 1.15)),
    Departure("membrane's width before it was cut", "20 mm", MEMBRANE_OR_SAG, sheet={"b_m": 2e-2}),
    # repeats
    Departure("first repeat on the wrong side", "7 %", ("repeat 1 of loading aluminium",), {"asymmetry": 0.07}, read=wrong_side("loading aluminium", 0)),
    Departure("laser aimed again before the last repeat", "1.5 %", ("repeat 3 of loading mfc",), read=_of_label("loading mfc", _repeat_scaled(2, 1.015))),
    # the sheet
    Departure("modulus of steel on the sheet", "205 GPa", ("stated (h_Al|E_Al|b_Al)",), sheet={"E_Al": 136e9}),
    Departure("length read from the wrong edge", "-2.6 mm", ("stated (L|L2)",), sheet={"L": -2.6e-3}),
    # creep, delay, amplifier
    Departure("glue relaxes", "3 % at 60 Hz", ("creep of the dwells", "roll-off"), read=dynamic(lambda f: 1 + 0.03 / (1 + 1j * f / 60))),
    Departure("one sample late", "25 us", ("(stated )?delay.*",), read=dynamic(lambda f: np.exp(-2j * np.pi * f * 2.5e-5))),
    Departure("slope below rest", "2.5 %", ("(stated )?gain_below_rest",), {"gain_below": 0.025}),
    Departure("slope below rest bends", "-7 % beyond 0.5 V", ("(stated )?gain_below_rest",), read=_of_kinds(("steps",), _over_x(lambda u: 1 - 0.07 * np.tanh(np.maximum(2.5 - u, 0.0) / 0.5)))),
    Departure("amplifier saturates", "6 %, square of the level", ("softening of steps",), read=_of_kinds(("steps",), _over_x(lambda u: 1 - 0.06 * (np.maximum(u - 2.5, 0.0) / 2.5) ** 2))),
    Departure("clamp turns everywhere", "35 %", ("(stated )?clamp_flexibility",), {"clamp": 0.35}),
    Departure("laser tilted", "14 degrees", ("(stated )?(sensor_gain|gain of the laser|load_gain|weights)",), read=_tilted(14), undecidable=True),
)  # fmt: skip
"""Seeds of the laboratories: stream 2814."""
