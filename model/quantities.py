"""Quantities that the program names: identifier, name for people, symbol, units, rounding and definition, as one list; estimates of them.

A value of a quantity is rounded to two digits of its standard uncertainty; without one to `digits` significant digits.
An estimate has the name of a quantity, which a comma separates from a condition: `compliance, MFC up`.
"""

import re
from collections.abc import Container, Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

SCALES = {
    "µm": 1e6, "mm": 1e3, "ms": 1e3, "µs": 1e6, "g": 1e3, "mg": 1e6, "%": 1e2, "°": 57.29577951308232, "GPa": 1e-9, "MPa": 1e-6,
    "µm/V": 1e6, "nm/V": 1e9, "µm/N": 1e6, "N mm/kV": 1e6, "N mm^2": 1e6, "krad/s": 1e-3, "g/m": 1e3, "nF": 1e9, "mA": 1e3, "mN": 1e3,
    "nA": 1e9, "nC": 1e9, "GΩ": 1e-9, "µJ": 1e6, "mW": 1e3,
}  # fmt: skip
"""Factor from SI to a bench unit."""

BENCH_UNITS = {
    "m": "µm",
    "m/V": "µm/V",
    "m/N": "µm/N",
    "kg": "g",
    "s": "ms",
    "Pa": "MPa",
    "N m/V": "N mm/kV",
    "A": "mA",
    "F": "nF",
    "C": "nC",
    "J": "µJ",
    "W": "mW",
}
"""Bench units of SI units, for quantities without a bench unit of their own."""


ERRORS, TOTAL_ERRORS, FIT = "_errors", "_total_errors", "_fit"
"""Suffixes of the names of columns that belong to the y of a series."""

LENGTH_UNITS = ("m", "m/V", "m/N", "m/s")
"""Units of the quantities that scale with the gain of the displacement sensor."""


class ShownUnit(NamedTuple):
    """Display unit and the factor from SI to it; empty for a number without unit."""

    factor: float
    unit: str


@dataclass(frozen=True, slots=True)
class Quantity:
    """One quantity.

    Attributes:
        identifier: in files, options and JSON.
        name: for people.
        unit: SI; `1` for a number.
        bench: unit of display.
        definition: one noun phrase or sentence.
        former: names in run files of earlier versions.
        digits: significant digits of a value without uncertainty.
    """

    identifier: str
    name: str
    symbol: str
    unit: str
    bench: str
    definition: str
    former: tuple[str, ...] = ()
    digits: int = 6

    @property
    def shown(self) -> ShownUnit:
        """Factor from SI to the bench unit, and the bench unit."""
        return ShownUnit(SCALES.get(self.bench, 1.0), "" if self.bench == "1" else self.bench)


def _listed(*rows: tuple[Any, ...]) -> dict[str, Quantity]:
    return {row[0]: Quantity(*row) for row in rows}


# fmt: off
PARAMETERS: Mapping[str, Quantity] = _listed(
    ("L", "clamp to centre L", "L", "m", "mm", "half length, clamp to centre"),
    ("L1", "clamp to MFC L₁", "L₁", "m", "mm", "end of the bare plate, where the MFC begins"),
    ("L2", "clamp to cylinder L₂", "L₂", "m", "mm", "start of the cylinder's contact"),
    ("b_Al", "plate width", "b_Al", "m", "mm", "width of the aluminium plate"),
    ("h_Al", "plate thickness", "h_Al", "m", "mm", "thickness of the aluminium plate"),
    ("rho1", "mass per length ρ₁", "ρ₁", "kg/m", "g/m", "linear density of the bare plate"),
    ("rho2", "mass per length with MFC ρ₂", "ρ₂", "kg/m", "g/m", "linear density of plate and MFC"),
    ("E_Al", "plate modulus", "E_Al", "Pa", "GPa", "Young modulus of aluminium"),
    ("k2", "bending stiffness k₂", "k₂", "N m^2", "N mm^2", "bending stiffness of plate and MFC"),
    ("mu", "moment per volt μ", "μ", "N m/V", "N mm/kV", "piezoelectric moment per volt"),
    ("c0", "damping c₀", "c₀", "kg/(m s)", "kg/(m s)", "structural damping per length"),
    ("m_add", "added mass", "m_add", "kg", "g", "mass added in the cylinder"),
    ("L_m", "membrane length", "L_m", "m", "mm", "free length of the membrane"),
    ("b_m", "membrane width", "b_m", "m", "mm", "width of the membrane"),
    ("h_m", "membrane thickness", "h_m", "m", "mm", "thickness of the membrane"),
    ("E_m", "Young modulus E_m", "E_m", "Pa", "MPa", "Young modulus of the membrane", ("Young modulus",)),
    ("c_s_delta", "skin damping per stretch", "c_s^δ", "kg/(m s)", "kg/(m s)", "skin damping gained per unit pre-stretch"),
    ("c_s_0", "skin damping unstretched", "c_s^0", "kg/(m s)", "kg/(m s)", "skin damping without pre-stretch"),
    ("delta", "pre-stretch δ", "δ", "1", "%", "pre-stretch of the membrane, elongation over free length"),
    ("contact_length", "contact length", "l_c", "m", "mm", "length over which the point stiffness is distributed"),
    ("k_s", "skin stiffness k_s", "k_s", "N/m^2", "N/m^2", "distributed stiffness of the skin"),
    ("c_s", "skin damping c_s", "c_s", "kg/(m s)", "kg/(m s)", "distributed damping of the skin"),
    ("asymmetry", "asymmetry", "", "1", "%", "relative excess of deflections on the MFC side, deficit on the other side"),
    ("hysteresis", "hysteresis", "", "1", "%", "late share of the deflection at full drive, in proportion to the drive"),
    ("creep", "creep a decade", "", "1", "%", "share of a deflection gained per decade of time, zero at the time of 100 Hz"),
    ("clamp_flexibility", "flexibility of the clamp", "", "1", "%", "rotation of the clamp, as a share of the bending of the bare plate: equivalent to a longer bare plate"),
    ("mass_fraction", "acting share of the masses", "", "1", "%", "acting share of the masses in the cylinder"),
    ("mass_offset", "mass offset", "", "kg", "g", "mass of cylinder and glue, or an error common to all added masses"),
    ("mass_put_in", "mass put in", "", "kg", "g", "mass in the cylinder during the dwells, which acts as m_add; 0: unknown, m_add is identified by itself"),
    ("load_gain", "load gain error", "", "1", "%", "relative error common to all loads: the balance's scale"),
    ("sensor_gain", "sensor gain error", "", "1", "%", "relative error common to all displacements"),
    ("load_offset", "load offset", "", "N", "mN", "load of pan and hook, or an error common to all loads"),
    ("zero_drift", "zero drift", "", "m", "µm", "drift of the sensor's zero from first to last row"),
    ("stiffening", "stiffening", "", "1", "%", "relative growth of the stiffness up to a deflection of 1 mm, with the square of the deflection"),
    ("gain_below_rest", "amplifier gain error below rest", "", "1", "%", "relative error of the amplifier's slope below rest"),
    ("gain_above_rest", "amplifier gain error above rest", "", "1", "%", "relative error of the amplifier's slope above rest"),
    ("delay", "delay", "", "s", "ms", "uncorrected delay of the displacement in the phases"),
    ("gain_drift", "gain drift", "", "1", "%", "relative growth of the dwells from first to last"),
    ("elongation_offset", "elongation offset", "", "m", "mm", "error common to all elongations of the membrane"),
    ("peak_to_peak_v", "drive, peak to peak", "", "V", "V", "drive at the amplifier's input, peak to peak around rest"),
    ("k2_per_kelvin", "temperature coefficient of k₂", "", "1/K", "1/K", "relative change of k2 per kelvin"),
    ("mu_per_kelvin", "temperature coefficient of μ", "", "1/K", "1/K", "relative change of mu per kelvin"),
    ("c0_per_kelvin", "temperature coefficient of c₀", "", "1/K", "1/K", "relative change of c0 per kelvin"),
    ("elongation_slip", "elongation slip", "", "1", "%", "share of every elongation lost in the membrane's clamps"),
)
"""Parameters of the model, of its extensions and of the instruments' errors."""

RESULTS: Mapping[str, Quantity] = _listed(
    ("natural_frequency", "natural frequency", "f₀", "Hz", "Hz", "undamped natural frequency: of the mode fitted to the response, without its damping", ("resonance frequency",)),
    ("damped_frequency", "damped frequency", "f_d", "Hz", "Hz", "frequency of the free decay of the fitted mode: natural frequency × √(1 − damping ratio²)"),
    ("peak_frequency", "peak frequency", "f_p", "Hz", "Hz", "frequency of the largest response to a sine of constant voltage", ("peak",)),
    ("damping_ratio", "damping ratio", "ζ", "1", "1", "damping of the fitted mode over its critical damping"),
    ("quality_factor", "quality factor Q", "Q", "1", "1", "1 / (2 × damping ratio)", ("Q",)),
    ("decay_time", "decay time", "τ", "s", "ms", "time in which a free decay falls to 1/e: 1 / (2π × natural frequency × damping ratio)"),
    ("lowest_coherence", "lowest coherence", "γ²", "1", "1", "lowest coherence within the resonance's half-power width"),
    ("amplitude_at_resonance", "largest max - min", "y_p", "m", "µm", "largest peak-to-peak displacement under sines, at full drive unless a condition names another", ("largest max - min",)),
    ("square_wave_amplitude", "largest max - min, square wave", "", "m", "µm", "largest peak-to-peak displacement under square waves", ("largest max - min, square wave",)),
    ("largest_twice_fundamental", "largest 2 x fundamental", "", "m", "µm", "largest peak-to-peak displacement of the fundamental alone", ("largest 2 x fundamental",)),
    ("margin_at_resonance", "margin at the largest", "", "1", "1", "largest peak-to-peak displacement over the threshold of perception at its frequency", ("margin at the largest",)),
    ("smallest_margin", "smallest margin", "", "1", "1", "smallest max - min over the threshold, 5 to 250 Hz, free, by the model"),
    ("smallest_margin_on_membrane", "smallest margin on the membrane", "", "1", "1", "smallest max - min over the threshold, 5 to 250 Hz, at the largest measured elongation, by the model"),
    ("usable_from", "usable from", "", "Hz", "Hz", "lowest frequency felt, free, full drive; by the model, from 5 Hz on"),
    ("usable_to", "usable to", "", "Hz", "Hz", "highest frequency felt, free, full drive; by the model, up to 250 Hz"),
    ("latency", "latency", "t_l", "s", "ms", "time from a step, or from the onset of a sine, until the displacement is felt"),
    ("rise_time", "rise time", "t_r", "s", "ms", "time from 10 to 90 % after a step, or from the onset of a sine to 90 % of its peak", ("rise",)),
    ("overshoot", "overshoot", "", "1", "%", "largest displacement after a step over the final value, less one"),
    ("settling_time", "settling time", "t_s", "s", "ms", "time from a step until the displacement stays within a band about its final value", ("settling",)),
    ("threshold_speed", "speed at the threshold", "", "m/s", "m/s", "speed of the displacement when it reaches the threshold of perception"),
    ("bench_latency", "latency of the bench", "", "s", "ms", "delay of the displacement behind a slow sine, less the sensor's configured delay"),
    ("noise_floor", "noise floor", "", "m", "µm", "standard deviation of the displacement at rest", (), 3),
    ("interference_at_rest", "interference at rest", "", "m", "µm", "amplitude of the largest line of the mains or its harmonics in the displacement at rest"),
    ("static_gain_above_rest", "static gain above rest", "", "m/V", "µm/V", "displacement per volt at the amplifier's input, above rest", ("gain above rest", "deflection per volt above rest")),
    ("static_gain_below_rest", "static gain below rest", "", "m/V", "µm/V", "displacement per volt at the amplifier's input, below rest", ("gain below rest", "deflection per volt below rest")),
    ("creep_per_decade", "creep per decade", "", "1", "%", "share of a step's deflection gained per decade of time"),
    ("repeatability", "repeatability", "", "m", "µm", "standard deviation of a deflection from repeat to repeat"),
    ("loop_width", "loop width", "", "m", "µm", "deflection with levels falling minus deflection with levels rising, mean over the levels"),
    ("loop_hysteresis", "hysteresis of the loop", "", "1", "%", "width of the displacement-voltage loop at frequency zero, over its stroke", ("hysteresis",)),
    ("share", "loop width / stroke", "", "1", "%", "width over stroke"),
    ("level", "level at the amplifier's input", "", "V", "V", "voltage held at the amplifier's input"),
    ("loop_width_per_frequency", "loop width per frequency", "", "s", "ms", "growth of the relative loop width with the frequency: damping and delay"),
    ("compliance", "compliance", "", "m/N", "µm/N", "deflection of the centre per newton at the centre"),
    ("side_difference", "difference of the sides", "", "1", "%", "difference of the compliances of both sides over their mean", ("difference of the sides",)),
    ("nonlinearity", "nonlinearity", "", "1", "%", "relative difference of the compliance at the largest load from the compliance without load"),
    ("sag", "sag", "", "m", "mm", "deflection of the middle of the horizontal membrane by its own weight"),
    ("linear_young_modulus", "Young modulus by linear theory", "", "Pa", "MPa", "Young modulus of the membrane by a theory without stretch", ("Young modulus by linear theory",)),
    ("capacitance", "capacitance", "C", "F", "nF", "parallel capacitance under a sine, cable and bending included"),
    ("loss_factor", "loss factor", "tan δ", "1", "1", "in-phase over quadrature current under a sine", (), 3),
    ("energy_per_cycle", "energy per cycle", "", "J", "µJ", "energy lost in a cycle of a sine: area of the loop of charge over voltage"),
    ("leakage_current", "leakage current", "", "A", "nA", "current at a held voltage after the wait, less the reading at rest", (), 3),
    ("insulation_resistance", "insulation resistance", "", "Ω", "GΩ", "voltage held over its leakage current, after the wait", (), 3),
    ("air_temperature", "temperature of the air", "T", "degC", "degC", "mean of a sensor over the recordings of a run or point"),
    ("air_humidity", "humidity of the air", "", "1", "%", "relative humidity, mean of a sensor over the recordings of a run or point"),
    ("free_response_drift", "drift of the free response", "", "1", "%", "relative change of the free response over a membrane series, mean over frequencies", ("drift of the free response",)),
)
"""Results of runs and figures of merit."""
# fmt: on

QUANTITIES: Mapping[str, Quantity] = {**PARAMETERS, **RESULTS}
"""All quantities by identifier."""

_FORMER = {former: each.identifier for each in QUANTITIES.values() for former in each.former} | {
    "latency": "bench_latency"
}
_FORMER_CONDITIONS = {"peak with ": "peak_frequency, ", "latency to ": "latency, ", "speed at ": "threshold_speed, "}


def find_quantity(name: str) -> Quantity | None:
    """Return the quantity of an estimate's name, `compliance, MFC up` or `c_s(1.27 mm)`; None if it is not listed."""
    return QUANTITIES.get(re.split(r", |\(", name, maxsplit=1)[0])


def quantity_label(name: str) -> str:
    """Return an estimate's name for people: `compliance, MFC up`, `natural frequency`, `skin damping c_s(1.27 mm)`."""
    quantity = find_quantity(name)
    return name if quantity is None else quantity.name + name.removeprefix(quantity.identifier)


def current_name(stored: str) -> str:
    """Return the name of an estimate that a run file of any version stores, with `_` for blanks."""
    text = stored.replace("_", " ")
    for former, now in _FORMER_CONDITIONS.items():
        if text.startswith(former):
            return now + text.removeprefix(former)
    if text in _FORMER:
        return _FORMER[text]
    base, comma, condition = text.partition(", ")
    identifier = (_FORMER.get(base) if base != "latency" else base) or base.replace(" ", "_")
    return (identifier if identifier in QUANTITIES else base) + comma + condition


def current_column(stored: str, columns: Container[str]) -> str:
    """Return the present name of a column of points that a file of any version stores beside others."""
    if stored in ("resonance", "resonance_errors") and "damping" in columns:
        return stored.replace("resonance", "natural_frequency")
    return "peak_frequency" if stored == "peak" and "peak_response" in columns else stored


def current_parameter(stored: str, parameters: Container[str]) -> str:
    """Return the present name of a protocol's parameter that a file of any version stores beside others."""
    return "target_relative_uncertainty" if stored == "wanted" and "settle_tolerance" in parameters else stored


def shown_unit(unit: str, name: str = "") -> ShownUnit:
    """Return the display unit of a value in an SI unit: the quantity's, or else the usual one of the SI unit."""
    quantity = find_quantity(name)
    if quantity is not None and quantity.unit == unit:
        return quantity.shown
    bench = BENCH_UNITS.get(unit, unit)
    return ShownUnit(SCALES[bench] if unit in BENCH_UNITS else 1.0, "" if bench == "1" else bench)


@dataclass(frozen=True, slots=True)
class EstimatedQuantity:
    """An identified quantity: value and standard error in `unit`; `source` is its origin or the names of the runs."""

    name: str
    value: float
    standard_error: float
    unit: str
    source: str | tuple[str, ...]

    @classmethod
    def listed(cls, name: str, value: float, standard_error: float, source: str) -> Self:
        """Return the estimate of a listed quantity, `natural_frequency` or `compliance, MFC up`, in its SI unit.

        Raises:
            KeyError: `name` begins with no identifier of `model.quantities`.
        """
        if (quantity := find_quantity(name)) is None:
            raise KeyError(name)
        return cls(name, value, standard_error, quantity.unit, source)


def quality_factor(damping: EstimatedQuantity) -> EstimatedQuantity:
    """Return Q = 1 / (2 ζ) of a damping ratio, with its relative uncertainty."""
    q = 0.5 / damping.value
    error = q * damping.standard_error / damping.value
    return replace(damping, name="quality_factor", value=q, standard_error=error)
