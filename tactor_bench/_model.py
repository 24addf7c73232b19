"""Frequency response of a tactor on skin or membrane, with the band of a calibration."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import ArrayLike

from app.identification import PAPER_MODEL, ActiveModel
from model import AmplifierMap, Array, Complex, Membrane, ParameterError, Skin, Specimen, Tactor, replace_variables
from model.identification import Calibration
from model.response import (
    PeriodicResponse,
    Waveform,
    amplifier_response,
    check_frequency,
    choose_shapes,
    frequency_response,
    with_lag,
)
from model.studies import EstimateSet, UncertaintyBand, linear_band

if TYPE_CHECKING:
    from tactor_bench._identification import Identification

__all__ = ["AmplifierMap", "Membrane", "ParameterError", "Response", "Skin", "Tactor", "response"]

SHAPES = 7

PARTS_HZ = (15.0, 60.0)
"""Divisions of the frequencies of a band: the lowest frequency of a part defines its number of harmonics, so that parts take a
seventh of the time. They agree with the whole within 2e-5, enough for derivatives."""


@dataclass(frozen=True, slots=True, eq=False)
class Response(PeriodicResponse):
    """Steady response of the tactor to a periodic drive at the amplifier's input.

    Attributes:
        frequency_hz: (F,).
        peak_to_peak: max - min of the displacement, all harmonics superposed, m, (F,): the paper's measured amplitude.
        fundamental: complex amplitude of the fundamental, m, (F,): peak amplitude, phase against the input sine.
        receptance: complex displacement per volt on the specimen, m/V, (F,).
        peak_to_peak_band, fundamental_band: bands of `peak_to_peak` and of `abs(fundamental)`, None without errors. `.lower`,
            `.upper` and `.standard_error` are in m, (F,).
        specimen: computed tactor, membrane and skin.
    """

    receptance: Complex
    peak_to_peak_band: UncertaintyBand | None
    fundamental_band: UncertaintyBand | None
    specimen: Specimen


def response(
    frequencies_hz: ArrayLike,
    tactor: Tactor | None = None,
    *,
    skin: Skin | None = None,
    membrane: Membrane | None = None,
    elongation_m: float | None = None,
    pre_stretch: float | None = None,
    peak_to_peak_v: float = 5.0,
    offset_v: float = 2.5,
    waveform: Waveform = "sine",
    amplifier: AmplifierMap | None = None,
    position_m: float | None = None,
    shapes: int | None = None,
    calibration: "Calibration | Identification | None" = None,
    coverage: float = 0.95,
) -> Response:
    """Compute the frequency response of a tactor under the amplifier's drive, like `tactor-bench model frequency-response`.

    Args:
        frequencies_hz: greater than 0, (F,).
        tactor: default: from `calibration`, or the paper's Table I.
        skin: a given distributed stiffness and damping under the cylinder; default: the free tactor.
        membrane: the membrane that represents skin; default for a stretched membrane: from `calibration` or Table I.
        elongation_m: elongation of the membrane, m.
        pre_stretch: elongation as a share of the membrane's free length.
        peak_to_peak_v: drive at the amplifier's input, V, for example `run.parameters["peak_to_peak_v"]`.
        offset_v: mean of the drive, V.
        waveform: `sine` or `square`.
        amplifier: the amplifier's map from input to specimen volts.
        position_m: distance from the clamp, m; default: the centre.
        shapes: number of shape functions, 3 to 300; default: as in the identification, 7 with a calibration, else the number that
            keeps the response within 0.1 % of the closed form.
        calibration: source of values and errors: a `calibration(...)`, or the result of `identify(...)`.
        coverage: probability of the bands.

    Raises:
        ParameterError: a value is not physical, or the drive is outside the amplifier's range.
        ValueError: the tactor or the skin is given twice.

    Example:
        >>> import tactor_bench as tb
        >>> model = tb.response([100.0, 160.0], tb.Tactor(m_add=7e-3), peak_to_peak_v=4.0)
        >>> model.peak_to_peak.shape, model.peak_to_peak_band is None
        ((2,), True)
    """
    if tactor is not None and calibration is not None:
        raise ValueError("the tactor is given twice, by tactor and by calibration; leave one out")
    model = PAPER_MODEL if calibration is None else _model_of(calibration)
    specimen = _make_specimen(model, tactor, skin, membrane, elongation_m, pre_stretch)
    if shapes is None and calibration is None:
        highest_hz = float(np.max(check_frequency(frequencies_hz)))
        shapes = choose_shapes(specimen.tactor, specimen.skin, highest_hz=highest_hz).n
    identified = None if calibration is None or isinstance(calibration, Calibration) else calibration.shapes
    n = shapes or identified or SHAPES
    amplifier = amplifier or AmplifierMap()

    def driven(specimen: Specimen, f: ArrayLike) -> PeriodicResponse:
        beam = amplifier_response(
            specimen.acting_tactor, f, peak_to_peak_v / 2, offset_v, amplifier, specimen.skin, waveform, n, position_m
        )
        return with_lag(beam, specimen, peak_to_peak_v / 2, offset_v, amplifier)

    got = driven(specimen, frequencies_hz)
    bands: tuple[UncertaintyBand | None, UncertaintyBand | None] = (None, None)
    if (estimates := model.estimates_for(specimen)) is not None:
        bands = _bands(driven, got, specimen, estimates, coverage)
    return Response(
        got.frequency_hz,
        got.harmonics,
        got.peak_to_peak,
        frequency_response(specimen.acting_tactor, frequencies_hz, specimen.skin, n, position_m),
        *bands,
        specimen,
    )


def _make_specimen(
    model: ActiveModel,
    tactor: Tactor | None,
    skin: Skin | None,
    membrane: Membrane | None,
    elongation_m: float | None,
    pre_stretch: float | None,
) -> Specimen:
    """Return the specimen; values not given are the model's.

    Raises:
        ValueError: the skin is given twice.
    """
    if sum(given is not None for given in (skin, elongation_m, pre_stretch)) > 1:
        raise ValueError("the skin is given twice; leave all but one of skin, elongation_m and pre_stretch out")
    if skin is not None and membrane is not None:
        raise ValueError("the skin is given twice, by skin and by membrane; leave one out")
    tactor = tactor or model.tactor
    if skin is not None:
        return replace_variables(Specimen(tactor, k_s=skin.k_s, c_s=skin.c_s), model.nonideal)
    if membrane is None and (elongation_m is not None or pre_stretch is not None):
        membrane = model.membrane
    own_damping = model.skin_damping(elongation_m) if elongation_m is not None else None
    stretch = elongation_m / membrane.L_m if membrane and elongation_m is not None else pre_stretch or 0.0
    return replace_variables(Specimen(tactor, membrane, stretch, c_s=own_damping), model.nonideal)


def _model_of(source: "Calibration | Identification") -> ActiveModel:
    """Return values and errors of one specimen, from a calibration or an identification."""
    if isinstance(source, Calibration):
        return ActiveModel.from_estimates(source.tactor(), source.membrane(), source.estimates, source.covariance)
    return ActiveModel.from_estimates(source.tactor, source.membrane, source.result.estimates, source.covariance)


def _bands(
    driven: Callable[[Specimen, Array], PeriodicResponse],
    got: PeriodicResponse,
    specimen: Specimen,
    estimates: EstimateSet,
    coverage: float,
) -> tuple[UncertaintyBand, UncertaintyBand]:
    """Return the bands of peak to peak and fundamental around `got`."""
    f = got.frequency_hz
    parts = [
        part for part in (np.flatnonzero(np.digitize(f, PARTS_HZ) == i) for i in range(len(PARTS_HZ) + 1)) if part.size
    ]

    def curves(values: Mapping[str, Array]) -> Array:
        rows = [dict(zip(values, row, strict=True)) for row in zip(*values.values(), strict=True)]
        both = np.empty((len(rows), 2, f.size))
        for row, given in enumerate(rows):
            moved = replace_variables(specimen, {name: float(value) for name, value in given.items()})
            for part in parts:
                one = driven(moved, f[part])
                both[row, :, part] = np.stack((one.peak_to_peak, np.abs(one.fundamental)), axis=1)
        return both.reshape(len(rows), -1)

    band = linear_band(curves, estimates, coverage)
    errors, reaches = (each.reshape(2, -1) for each in (band.standard_error, band.upper - band.centre))
    first, second = (
        UncertaintyBand(centre, error, centre - reach, centre + reach)
        for centre, error, reach in zip((got.peak_to_peak, np.abs(got.fundamental)), errors, reaches, strict=True)
    )
    return first, second
