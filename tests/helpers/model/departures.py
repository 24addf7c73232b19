"""Departures from the model for the development of the attribution; `withheld_departures.py` has those that were kept from it."""

import numpy as np

from tests.helpers.laboratory import Laboratory
from tests.helpers.model.laboratories import Departure, Raw

G = 9.80665


def scaled(label: str, factor: float, exactly: bool = False):
    """Return a change of what the runs of a label read."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label or (raw.label.startswith(label) and not exactly):
            raw.w = raw.w * factor

    return read


def one_point(label: str, at: int, factor: complex):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label:
            raw.w = raw.w.astype(complex) if np.iscomplexobj(factor) else raw.w.copy()
            raw.w[at] *= factor

    return read


def dynamic(factor):
    """Return a change of all that is driven at a frequency, by its factor over the frequency."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in ("dwell", "sweep"):
            raw.w = raw.w * factor(raw.x)

    return read


def _softer_under_load(share: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind == "loading":
            raw.w = raw.w * (1 + share * raw.x / raw.x.max())

    return read


def _bent_sensor(share: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in ("loading", "steps"):
            raw.w = raw.w * (1 + share * np.abs(raw.w) / 1e-3)
        elif raw.kind in (
            "dwell",
            "sweep",
        ):  # of a quadratic term, a sine keeps none in its fundamental; of a cubic one it does
            raw.w = raw.w * (1 + 0.75 * share * np.abs(raw.w) / 1e-3)

    return read


def _slips(share: float, from_n: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind == "loading":
            raw.w = raw.w * (1 + share * np.maximum(raw.x - from_n, 0.0) / raw.x)

    return read


def wrong_side(label: str, repeat: int):
    """Return a change in which one repeat was made with the other side up."""

    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label:
            sign = 1 if "mfc" in label else -1
            raw.w = raw.w.copy()
            raw.w[raw.repeat == repeat] *= (1 - sign * lab.asymmetry) / (1 + sign * lab.asymmetry)

    return read


def _drifting(label: str, share: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label:
            raw.w = raw.w * (1 + share * np.linspace(0, 1, raw.w.size))

    return read


def _drifting_runs(share: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind in ("dwell", "sweep"):
            raw.w = raw.w * (1 + share * (raw.place - 4) / 4)

    return read


def stand(at_hz: float, size: float, q: float):
    """Return a factor of a sensor's mount that moves by a share of what it reads, most at its resonance."""

    def factor(f: np.ndarray) -> np.ndarray:
        r = f / at_hz
        return 1 + size / q * r**2 / (1 - r**2 + 1j * r / q)

    return factor


def _relabelled(index: int, shift_kg: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.kind == "masses":
            raw.x = raw.x.copy()
            raw.x[index] += shift_kg

    return read


def _lossy_dwells(share: float):
    def factor(f: np.ndarray) -> np.ndarray:
        return 1 - share * (np.log10(f / 100) + (np.euler_gamma + 0.5j * np.pi) / np.log(10))

    return dynamic(factor)


def from_place(first: int, **added: float):
    """Return fields of the specimen that have grown by so much from a run on."""

    def run_fields(label: str, place: int, lab: Laboratory) -> dict[str, float]:
        return {name: getattr(lab, name) + by for name, by in added.items()} if place >= first else {}

    return run_fields


def in_run(label: str, **added: float):
    """Return fields of the specimen that have grown by so much in one run."""

    def run_fields(each: str, place: int, lab: Laboratory) -> dict[str, float]:
        return {name: getattr(lab, name) + by for name, by in added.items()} if each == label else {}

    return run_fields


def _elongated(label: str, shift_m: float):
    def read(raw: Raw, lab: Laboratory) -> None:
        if raw.label == label and raw.elongation_m is not None:
            raw.elongation_m = raw.elongation_m + shift_m

    return read


DWELLS = r"(dwell|membrane).*"

DEVELOPED: tuple[Departure, ...] = (
    *(Departure("slope below rest", f"{100 * x:g} %", ("(stated )?gain_below_rest",), {"gain_below": x}) for x in (-0.1, 0.06)),
    *(Departure("delay", f"{1e6 * x:g} us", ("(stated )?delay.*",), {"delay_s": x}) for x in (1e-4, -7e-5)),
    *(Departure("elongation offset", f"{1e3 * x:g} mm", ("elongation_offset",), {"elongation_offset_m": x}) for x in (1e-3, 5e-4)),
    *(Departure("tare", f"{1e3 * x:g} g", ("load_offset",), {"load_offset_kg": x}) for x in (1e-3, 4e-3)),
    *(Departure("one mass's label", f"{1e3 * x:g} g", ("point 5 of masses",), read=_relabelled(4, x)) for x in (3e-4, 1e-3)),
    *(Departure("one static point", f"{100 * x - 100:g} %", ("point 8 of loading mfc",), read=one_point("loading mfc", 7, x)) for x in (1.06, 0.8)),
    *(Departure("one dwell point", f"{100 * x - 100:g} %", ("point 6 of dwell",), read=one_point("dwell", 5, x)) for x in (1.04, 0.85)),
    *(Departure("one step", f"{100 * x - 100:g} %", ("point 4 of steps",), read=one_point("steps", 3, x)) for x in (1.05, 0.8)),
    *(Departure("frequencies of a dwell", f"{100 * x:g} %", ("(time base|frequency) of dwell",), run_fields=in_run("dwell", frequency_error=x)) for x in (-0.01, 0.005)),
    *(Departure("statics softer with load", f"{100 * x:g} %", ("softening under load", "slip under load", "stiffening"), read=_softer_under_load(x)) for x in (0.03, 0.06)),
    *(Departure("zero drift", f"{1e6 * x:g} um", ("zero_drift",), {"zero_drift_m": x}) for x in (2e-5, 8e-6)),
    *(Departure("sensor not linear", f"{100 * x:g} % at 1 mm", ("sensor curvature",), read=_bent_sensor(x)) for x in (0.02, -0.04)),
    *(Departure("slip under weights", f"{100 * x:g} %", ("slip under load",), read=_slips(x, 1.2)) for x in (0.05, 0.1)),
    *(Departure("clamp turns", f"{100 * x:g} %", ("(stated )?clamp_flexibility",), {"clamp": x}) for x in (0.15, 0.25)),
    Departure("a repeat on the wrong side", "", ("repeat 2 of loading mfc",), {"asymmetry": 0.05}, read=wrong_side("loading mfc", 1)),
    *(Departure("Duffing", f"{100 * x:g} %", ("stiffening",), {"stiffening": x}) for x in (0.1, -0.06)),
    *(Departure("loose mount of the laser", f"{h:g} Hz, {100 * x:g} %", ("stand resonance",), read=dynamic(stand(h, x, q))) for h, x, q in ((95, 0.02, 12), (150, 0.05, 25))),
    *(Departure("drive falls off", f"{100 * x:g} % at 250 Hz", ("roll-off",), read=dynamic(lambda f, x=x: 1 - x * (f / 250) ** 2)) for x in (0.1, 0.04)),
    Departure("low-pass of first order", "800 Hz", ("roll-off",), read=dynamic(lambda f: 1 / (1 + 1j * f / 800))),
    *(Departure("drift within a dwell", f"{100 * x:g} %", ("drift in dwell",), read=_drifting("dwell", x)) for x in (0.05, -0.03)),
    *(Departure("drift over dwells", f"{100 * x:g} %", ("gain_drift",), read=_drifting_runs(x)) for x in (0.05, -0.02)),
    *(Departure("creep of dwells only", f"{100 * x:g} %", ("creep of the dwells",), read=_lossy_dwells(x)) for x in (0.01, 0.03)),
    Departure("dwell as rms", "", ("scale of (dwell|all dwells|steps)",), read=scaled("dwell", 0.5**0.5, exactly=True)),
    *(Departure("all driven runs as rms", "", ("scale of (all dwells|steps)",), read=dynamic(lambda f: 0.5**0.5 + 0 * f)) for _ in (0,)),
    *(Departure("steps too large", f"{100 * x - 100:g} %", ("scale of (steps|all dwells)",), read=scaled("steps", x)) for x in (1.05, 0.93)),
    *(Departure("laser's gain", f"{100 * x:g} %", ("(stated )?(sensor_gain|gain of the laser)",), {"sensor_gain": x}, undecidable=True) for x in (0.05,)),
    *(Departure("weights", f"{100 * x:g} %", ("(stated )?(load_gain|weights)",), {"load_gain": x}, undecidable=True) for x in (0.05,)),
    *(Departure("plate's thickness", f"{100 * x:g} %", ("stated (h_Al|E_Al|b_Al)",), sheet={"h_Al": x * 2e-4}) for x in (0.15, -0.2)),
    *(Departure("length L1", f"{1e3 * x:g} mm", ("stated L1",), sheet={"L1": x}) for x in (1.5e-3, -2e-3)),
    *(Departure("mass of a mounting", f"{1e3 * x:g} g", ("mass (of|from) membrane 0 mm.*",), run_fields=from_place(5, m_add=x)) for x in (3e-4, -1e-4)),
    *(Departure("mass in one dwell", f"{1e3 * x:g} g", ("mass of dwell again",), run_fields=in_run("dwell again", m_add=x)) for x in (3e-4,)),
    *(Departure("clamp of a mounting", f"{100 * x:g} %", ("clamp (of|from) membrane 0 mm.*",), run_fields=from_place(5, clamp=x)) for x in (0.03, 0.08)),
    *(Departure("one elongation", f"{1e3 * x:g} mm", ("elongation of membrane 2.54 mm",), read=_elongated("membrane 2.54 mm", x)) for x in (5e-4, -1e-3)),
    *(Departure("scale of a membrane dwell", f"{100 * x - 100:g} %", ("scale of membrane 2.54 mm",), read=scaled("membrane 2.54", x)) for x in (1.03, 0.9)),
)  # fmt: skip
