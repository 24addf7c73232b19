"""Attribution matrix: departures from the model in sizes, and what the adequacy check makes of each."""

from dataclasses import dataclass

from model.identification.adequacy import assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from tests.helpers.laboratory import Laboratory, measure


@dataclass(frozen=True)
class Departure:
    """One way in which a laboratory departs from the model.

    Attributes:
        name: what it is.
        field: of `Laboratory`.
        values: what the field is, for a small, a medium and a large departure.
        sizes: the three as text.
        causes: titles of the right cause; two where they are one effect in the model.
        small_runs: whether loads, masses and a free dwell can show it.
        withheld: whether it was kept from the tuning of the diagnosis.
    """

    name: str
    field: str
    values: tuple[float, float, float]
    sizes: tuple[str, str, str]
    causes: tuple[str, ...]
    small_runs: bool = True
    withheld: bool = False

    def laboratory(self, size: int) -> Laboratory:
        """Return the laboratory with this departure."""
        fields: dict[str, float] = {self.field: self.values[size]}
        return Laboratory(**fields)


def _percent(*values: float) -> tuple[str, str, str]:
    a, b, c = (f"{v:g} %" for v in values)
    return a, b, c


DEPARTURES = (
    Departure("mass fraction", "mass_fraction", (0.97, 0.9, 0.7), _percent(97, 90, 70), ("mass_fraction",)),
    Departure(
        "mass of cylinder and glue", "mass_offset_kg", (1e-4, 3e-4, 1e-3), ("0.1 g", "0.3 g", "1 g"), ("mass_offset",)
    ),
    Departure("side difference", "asymmetry", (0.01, 0.04, 0.1), _percent(1, 4, 10), ("asymmetry",)),
    Departure("creep per decade", "creep", (0.003, 0.01, 0.03), _percent(0.3, 1, 3), ("creep",)),
    Departure("hysteresis", "hysteresis", (0.005, 0.02, 0.08), _percent(0.5, 2, 8), ("hysteresis",), False),
    Departure("clamp turns", "clamp", (0.02, 0.06, 0.15), _percent(2, 6, 15), ("clamp_flexibility",)),
    Departure("tare of the pan", "load_offset_kg", (3e-4, 1e-3, 5e-3), ("0.3 g", "1 g", "5 g"), ("load_offset",)),
    Departure("zero drift, static", "zero_drift_m", (1e-6, 5e-6, 2e-5), ("1 um", "5 um", "20 um"), ("zero_drift",)),
    Departure("amplifier slope below rest", "gain_below", (0.01, 0.03, 0.1), _percent(1, 3, 10), ("gain_below_rest",), False),
    Departure("stiffening at 1 mm (Duffing)", "stiffening", (0.01, 0.05, 0.2), _percent(1, 5, 20), ("stiffening",)),
    Departure("phase delay", "delay_s", (1e-5, 3e-5, 1e-4), ("10 us", "30 us", "100 us"), ("delay",)),
    Departure("gain drift, dwells", "gain_drift", (0.003, 0.01, 0.05), _percent(0.3, 1, 5), ("gain_drift",), False),
    Departure("L1 by the ruler", "L1", (8.1e-3, 8.3e-3, 9e-3), ("+0.1 mm", "+0.3 mm", "+1 mm"), ("L1",)),
    Departure("contact length of the skin", "contact_m", (7.35e-3, 8e-3, 1e-2), _percent(5, 14, 43), ("contact_length",), False),
    Departure("one static point", "bad_static", (0.02, 0.05, 0.5), _percent(2, 5, 50), ("point of loading mfc",)),
    Departure(
        "scale of one membrane dwell", "membrane_gain", (0.005, 0.02, 0.1), _percent(0.5, 2, 10), ("scale of membrane 3.81 mm",), False
    ),
    Departure("laser's gain", "sensor_gain", (0.01, 0.03, 0.1), _percent(1, 3, 10), ("sensor_gain",)),
    Departure("plate h_Al", "h_Al", (2.02e-4, 2.06e-4, 2.2e-4), _percent(1, 3, 10), ("h_Al",), withheld=True),
    Departure("length L", "L", (2.21e-2, 2.23e-2, 2.3e-2), ("+0.1 mm", "+0.3 mm", "+1 mm"), ("L",), withheld=True),
    Departure("membrane thickness h_m", "h_m", (1.44e-3, 1.5e-3, 1.6e-3), _percent(3, 7, 14), ("h_m",), False, True),
    Departure(
        "all elongations", "elongation_offset_m", (1e-4, 3e-4, 1e-3), ("0.1 mm", "0.3 mm", "1 mm"), ("elongation_offset",), False
    ),
    Departure("one dwell point", "bad_dwell", (0.01, 0.03, 0.15), _percent(1, 3, 15), ("point of free",), withheld=True),
    Departure("one mass's label", "bad_mass_kg", (5e-5, 2e-4, 1e-3), ("0.05 g", "0.2 g", "1 g"), ("point of masses",), withheld=True),
    Departure("all weights", "load_gain", (0.01, 0.03, 0.1), _percent(1, 3, 10), ("load_gain",), withheld=True),
    Departure("scale of the steps", "steps_gain", (0.005, 0.02, 0.1), _percent(0.5, 2, 10), ("scale of steps",), False, True),
    Departure(
        "one elongation", "membrane_slip_m", (1e-4, 3e-4, 1e-3), ("0.1 mm", "0.3 mm", "1 mm"), ("elongation of membrane 3.81 mm",), False, True
    ),
    Departure("frequencies of a dwell", "frequency_error", (0.001, 0.004, 0.02), _percent(0.1, 0.4, 2), ("frequency of free",), withheld=True),
)  # fmt: skip


@dataclass(frozen=True)
class Cell:
    """One campaign: whether the model was called inadequate, and what was named."""

    detected: bool
    named: tuple[str, ...]
    """Titles of the first cause and of those not told from it, three at most."""

    def is_right(self, departure: Departure) -> bool:
        """Whether the right cause is named first, or is one of two or three that the runs do not tell apart."""
        return any(_without_index(name) in departure.causes for name in self.named)


def _without_index(title: str) -> str:
    return f"point of {title.partition(' of ')[2]}" if title.startswith("point ") else title


def cell(lab: Laboratory, seed: int, small: bool, swept: bool = False, attribute: bool = True) -> Cell:
    """Measure, fit and judge one campaign."""
    fit = joint_fit(measure(lab, seed, small, swept), FitOptions(n=20), max_starts=1)
    verdict = assess_adequacy(fit, attribute)
    likeliest = verdict.diagnosis.likeliest if verdict.diagnosis is not None else ()
    return Cell(verdict.adequate is False, tuple(e.cause.title for e in likeliest[:3]))
