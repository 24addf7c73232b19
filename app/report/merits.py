"""Names, units and meanings of the figures of merit that limits can be set on."""

from annotated_types import Interval

from model import EstimatedQuantity, ParameterSpec
from model.identification import SPECIMEN_PARAMETERS

PARAMETER_MERITS = ("k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta")
_SPECIMEN_MERITS = (
    ("resonance", "Hz", "frequency of the largest fundamental as measured, free, full drive"),
    ("amplitude_at_resonance", "m", "largest max - min as measured, free, full drive"),
    ("usable_from", "Hz", "lowest frequency felt, free, full drive; by the model, from 5 Hz on"),
    ("usable_to", "Hz", "highest frequency felt, free, full drive; by the model, up to 250 Hz"),
    ("smallest_margin", "1", "smallest max - min over the threshold, 5 to 250 Hz, free, by the model"),
    ("smallest_margin_on_membrane", "1", "the same at the largest elongation that was measured"),
    ("latency", "s", "from a step to the highest voltage until it is felt, by the model"),
    ("rise_time", "s", "10 to 90 % after that step, by the model"),
)
FIGURES_OF_MERIT = {
    name: ParameterSpec(name, unit, Interval(gt=0), words, None) for name, unit, words in _SPECIMEN_MERITS
} | {name: SPECIMEN_PARAMETERS[name] for name in PARAMETER_MERITS}
"""Quantities that limits can be set on: name, unit, description."""


def figure_of_merit(name: str, value: float, standard_error: float) -> EstimatedQuantity:
    """Return a quantity that limits can be set on, SI."""
    return EstimatedQuantity(name, float(value), float(standard_error), FIGURES_OF_MERIT[name].unit, "")
