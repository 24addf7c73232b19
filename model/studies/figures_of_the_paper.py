"""The theory curves of the paper's Figs. 4, 5, 6, 8, 9, 10, 11 and 12 as data.

Their captions state differences of text and equations; plots and exports add nothing to them.
"""

from dataclasses import dataclass, fields, replace

import numpy as np

from model import (
    GRAVITY,
    NONIDEAL_NAMES,
    AmplifierMap,
    Membrane,
    Series,
    Specimen,
    Tactor,
    beams,
    replace_variables,
    shown_unit,
)
from model.response import load_compliance, natural_frequencies_of, voltage_gain
from model.studies.parameter_study import FIGURE_FREQUENCIES_HZ, Study, fig10_study, fig11_study, fig12_study


@dataclass(frozen=True, slots=True)
class PaperFigure:
    """One figure, or one panel of it: curves over one x, SI units."""

    name: str
    x_label: str
    x_unit: str
    y_label: str
    y_unit: str
    curves: tuple[Series, ...]
    caption: str


def figure4(t: Tactor) -> PaperFigure:
    """Static deflection under a load at the centre, Eq. (7)."""
    load = np.linspace(0, 0.5, 51) * GRAVITY
    w = load_compliance(t) * load
    axes = "load at the centre", "N", "deflection of the centre", "m"
    return PaperFigure(
        "fig4",
        *axes,
        (Series(load, w, label="Eq. (7), corrected"), Series(load, w * t.k2 / t.k1, label="Eq. (7) as printed")),
        "Static deflection under a load. The printed denominator of Eq. (7), 24 k1^2 [...], does not follow from Eqs. (1)-(6) "
        "and makes the tactor 7.6 times too soft: 500 g would exceed the 0.77 mm gap. It must read 24 k1 k2 [...].",
    )


def figure5(t: Tactor) -> PaperFigure:
    """First undamped natural frequency against the added mass."""
    mass = np.linspace(1.75e-3, 9.75e-3, 81)
    f = natural_frequencies_of(beams(t, {"m_add": mass}))[:, 0]
    literal = natural_frequencies_of(beams(t, {"m_add": 2 * mass}))[:, 0]
    axes = "added mass", "kg", "fundamental frequency", "Hz"
    return PaperFigure(
        "fig5",
        *axes,
        (
            Series(mass, f, label="eta = m_add / (2 (L - L2))"),
            Series(mass, literal, label="eta = m_add / (L - L2), the text's words"),
        ),
        "Fundamental frequency without damping. The text takes eta as added mass over the length of the third segment; only with "
        "half of it, since the cylinder sits on both halves of the beam, does 7.73 g resonate near 160 Hz as the text states.",
    )


def figure6(t: Tactor) -> PaperFigure:
    """Static deflection against the voltage at the amplifier's input, Eq. (8)."""
    volts = np.linspace(0, 5, 51)
    w = voltage_gain(t) * AmplifierMap().specimen_v(volts)
    axes = "voltage at the amplifier's input", "V", "deflection of the centre", "m"
    return PaperFigure(
        "fig6",
        *axes,
        (Series(volts, w, label="Eq. (8)"),),
        "Static deflection under a voltage, zero at 2.5 V. The kink is the amplifier's: 200 V/V below 2.5 V, 600 V/V above.",
    )


def figure8(m: Membrane) -> PaperFigure:
    """Skin damping against pre-stretch."""
    delta = np.linspace(0, 6.35e-3, 51) / m.L_m
    c_s = m.c_s_delta * delta + m.c_s_0
    axes = "pre-stretch", "", "skin damping", "kg/(m s)"
    return PaperFigure(
        "fig8",
        *axes,
        (Series(delta, c_s, label="c_s = c_s^delta delta + c_s^0"),),
        "Skin damping against pre-stretch, the paper's line through its fixed intercept.",
    )


ELONGATIONS_M = (None, 0.0, 1.27e-3, 2.54e-3, 3.81e-3, 6.35e-3)


def figure9(t: Tactor, m: Membrane) -> tuple[PaperFigure, ...]:
    """Six panels: free, and on the membrane at five elongations."""
    return tuple(_panel(letter, e, t, m) for letter, e in zip("abcdef", ELONGATIONS_M, strict=True))


def _panel(letter: str, elongation_m: float | None, t: Tactor, m: Membrane) -> PaperFigure:
    if elongation_m is None:
        on, where = Specimen(t), "vibrating freely"
    else:
        on = Specimen(t, m, delta=elongation_m / m.L_m)
        where = f"on the membrane at {elongation_m * 1e3:g} mm elongation"
    f = np.array(FIGURE_FREQUENCIES_HZ)
    fundamental = Study({}, FIGURE_FREQUENCIES_HZ, on).run().values
    whole = Study({}, FIGURE_FREQUENCIES_HZ, on, measure="peak_to_peak").run().values
    curves = (Series(f, fundamental, label="2 x fundamental"), Series(f, whole, label="max - min"))
    return _frequency_figure(
        f"fig9{letter}",
        curves,
        f"Response to a 0..5 V sine, {where}. {HARMONICS_CAPTION} {PANEL_CAPTIONS.get(letter, '')}",
    )


HARMONICS_CAPTION = (
    "The amplifier's two slopes add even harmonics, so that the measured max - min exceeds the fundamental "
    "near half the resonance."
)
PANEL_CAPTIONS = {
    "a": "The text speaks of a zero before the resonance; Eqs. (1)-(6) with Table I have none: the fundamental rises "
    "monotonically to its peak at 151 Hz.",
    "b": "The text speaks of a higher amplitude at low frequencies and a higher resonance frequency than in (a); the equations give "
    "a slightly lower amplitude and, through the damping, a peak at the lower frequency of 137 Hz. They have no zero.",
}


def figure10(t: Tactor, m: Membrane) -> PaperFigure:
    """Effect of skin stiffness."""
    return _study_figure(
        "fig10",
        fig10_study(t, m),
        "E_m = {:.0e} Pa",
        "Effect of the membrane's Young modulus at 1 mm elongation without skin damping. The text speaks of a zero, and of a higher "
        "amplitude at low frequencies for 1e7 Pa; the equations have no zero and give a lower one (by 3.5 % at 1 Hz). For 1e9 Pa the "
        f"resonance is not suppressed: it lies at {_stiffest_hz(t, m):.0f} Hz, beyond the figure.",
    )


def _stiffest_hz(t: Tactor, m: Membrane) -> float:
    beam, k_s, _ = fig10_study(t, m).specimen.coefficients({"E_m": 1e9})
    return float(natural_frequencies_of(beam, k_s)[0])


def figure11(t: Tactor, m: Membrane) -> PaperFigure:
    """Effect of skin damping."""
    return _study_figure(
        "fig11",
        fig11_study(t, m),
        "c_s = {:.3g} kg/(m s)",
        "Effect of skin damping, 0.001, 1, 10, 25 and 50 times c_bar = 6.66 kg/(m s), without pre-stretch. The text speaks of a zero "
        "that shifts; the equations have none. The loss of amplitude with 25 and 50 c_bar is largest at the resonance, not above it.",
    )


def figure12(t: Tactor, m: Membrane) -> PaperFigure:
    """Effect of pre-stretch."""
    return _study_figure(
        "fig12",
        fig12_study(t, m),
        "delta = {:.0e}",
        "Effect of pre-stretch on stiffness and damping together. The text has the response at 10 % flatten out above the one at 1 %; by "
        "the equations it stays below it at every frequency and falls under 50 um from 150 Hz on. Neither has a plateau or a zero.",
    )


def _study_figure(name: str, study: Study, label: str, caption: str) -> PaperFigure:
    result = study.run()
    f = np.array(study.frequency_hz)
    curves = (Series(f, y, label=label.format(v)) for v, y in zip(result.axes[0].values, result.values, strict=True))
    return _frequency_figure(name, tuple(curves), f"{caption} Twice the fundamental.")


def _frequency_figure(name: str, curves: tuple[Series, ...], caption: str) -> PaperFigure:
    return PaperFigure(name, "frequency", "Hz", "amplitude of the centre, peak to peak", "m", curves, caption.strip())


def paper_figures(tactor: Tactor | None = None, membrane: Membrane | None = None) -> tuple[PaperFigure, ...]:
    """All figures; Fig. 9 as six panels. Captions state parameters that differ from Table I."""
    t, m = tactor or Tactor(), membrane or Membrane()
    drawn = (
        figure4(t),
        figure5(t),
        figure6(t),
        figure8(m),
        *figure9(t, m),
        figure10(t, m),
        figure11(t, m),
        figure12(t, m),
    )
    changed = ", ".join(_changed_parameters(t, Tactor()) + _changed_parameters(m, Membrane()))
    if not changed:
        return drawn
    note = f"Drawn with {changed}; statements on the text and on single numbers hold for Table I."
    return tuple(replace(figure, caption=f"{figure.caption} {note}") for figure in drawn)


def skin_figures(specimen: Specimen) -> tuple[PaperFigure, ...]:
    """Figs. 10 to 12 of a specimen with a membrane, with the effects outside the paper's beam model."""
    t, m = specimen.tactor, specimen.membrane or Membrane()
    nonideal = {name: specimen.value(name) for name in NONIDEAL_NAMES}
    drawn = (
        ("fig10", fig10_study(t, m), "Pa", "E_m"),
        ("fig11", fig11_study(t, m), "kg/(m s)", "c_s"),
        ("fig12", fig12_study(t, m), "1", "delta"),
    )
    figures = []
    for name, study, unit, quantity in drawn:
        factor, shown = shown_unit(unit, quantity)
        figure = _study_figure(
            name, replace(study, specimen=replace_variables(study.specimen, nonideal)), "{:.17g}", ""
        )
        curves = (replace(c, label=f"{factor * float(c.label):.4g} {shown}") for c in figure.curves)
        figures.append(replace(figure, curves=tuple(curves)))
    return tuple(figures)


def _changed_parameters(parameters: Tactor | Membrane, reference: Tactor | Membrane) -> list[str]:
    values = ((f.name, getattr(parameters, f.name), getattr(reference, f.name)) for f in fields(parameters))
    return [f"{name} = {value:g}" for name, value, usual in values if value != usual]
