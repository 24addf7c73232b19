"""The paper's Figs. 4, 5, 6, 8 and 9 of one specimen: its points on the model, with bands and residuals."""

from collections.abc import Callable, Iterable, Sequence
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from app.report.blocks import Dots, Panel, Plot
from app.report.responses import BARS, line_of, responses, when
from app.report.specimen import NORMAL, Specimen
from model.identification.curves import resonances
from model.identification.observations import (
    Campaign,
    MassResonance,
    StaticLoading,
    VoltageSteps,
)
from model.statics import load_compliance, voltage_gain

Array = NDArray[np.float64]
Kind = TypeVar("Kind", bound=np.generic)


def plots_of(known: Specimen, campaign: Campaign) -> list[Plot]:
    """Every figure of the paper that these runs can fill, in the paper's order."""
    drawn = (
        loading(known, campaign.of(StaticLoading)),
        resonance(known, campaign.of(MassResonance)),
        steps(known, campaign.of(VoltageSteps)),
        damping(known),
        responses(known, campaign),
    )
    return [plot for plot in drawn if plot is not None]


def loading(known: Specimen, runs: Sequence[StaticLoading]) -> Plot | None:
    """Fig. 4: deflection under a load, each side by itself; the model has one stiffness for both."""
    if not runs:
        return None
    load = np.linspace(0, 1.05 * max(float(run.load_n.max()) for run in runs), 40)
    band = known.band(lambda t, _: load_compliance(t) * load)
    per_newton = load_compliance(known.tactor)
    looks = {"mfc": ("o", "MFC side"), "aluminium": ("s", "aluminium side"), "both": ("D", "both sides")}
    dots = tuple(
        Dots(
            looks[side][1],
            *_joined((r.load_n, 1e6 * r.deflection_m, 1e6 * NORMAL * r.errors_m) for r in runs if r.side == side),
            _stack(r.use for r in runs if r.side == side),
            looks[side][0],
            1e6 * per_newton * _stack(r.load_n for r in runs if r.side == side),
        )
        for side in looks
        if any(r.side == side for r in runs)
    )
    panel = Panel(
        "",
        "load at the centre (N)",
        "deflection (µm)",
        (line_of(known, load, band, 1e6),),
        dots,
        unit="µm",
    )
    caption = f"Static loading, electrodes shorted; positive in the direction of the push; every reading. {BARS}"
    return Plot("Fig. 4: deflection under a load", (panel,), caption)


def resonance(known: Specimen, runs: Sequence[MassResonance]) -> Plot | None:
    """Fig. 5: resonance frequency against the added mass, where the model's response is largest."""
    if not runs:
        return None
    masses = np.concatenate([run.mass_kg for run in runs])
    grid = np.linspace(masses.min(), masses.max(), 40) if np.ptp(masses) else masses[:1] * np.array([0.95, 1, 1.05])
    damped = {run.label: np.full(run.mass_kg.size, run.meaning == "peak") for run in runs}
    peaks = np.full(grid.size, runs[0].meaning == "peak")
    band = known.band(lambda t, _: resonances(t, grid, peaks, known.n)[0])
    dots = tuple(
        Dots(
            "measured" if len(runs) == 1 else when(run.label),
            1e3 * run.mass_kg,
            run.frequency_hz,
            NORMAL * run.errors_hz,
            run.use,
            "os^Dv"[i % 5],
            resonances(known.tactor, run.mass_kg, damped[run.label], known.n)[0],
        )
        for i, run in enumerate(runs)
    )
    panel = Panel(
        "",
        "added mass (g)",
        "resonance (Hz)",
        (line_of(known, 1e3 * grid, band),),
        dots,
        from_zero=False,
        unit="Hz",
    )
    what = "peak of the displacement's spectrum" if runs[0].meaning == "peak" else "natural frequency"
    return Plot("Fig. 5: resonance against added mass", (panel,), f"Frequency of the {what}. {BARS}")


def steps(known: Specimen, runs: Sequence[VoltageSteps]) -> Plot | None:
    """Fig. 6: deflection under a held voltage, against rest."""
    if not runs:
        return None
    map_ = known.amplifier
    volts = np.linspace(map_.low_v, map_.high_v, 51)
    band = known.band(lambda t, _: voltage_gain(t) * map_.specimen_v(volts))

    def chosen(pick: Callable[[VoltageSteps], NDArray[np.bool_]], label: str, marker: str) -> Iterable[Dots]:
        at = [pick(run) for run in runs]
        if any(each.any() for each in at):
            x, y, half = _joined(
                (r.input_v[a], 1e6 * r.deflection_m[a], 1e6 * NORMAL * r.errors_m[a])
                for r, a in zip(runs, at, strict=True)
            )
            model = 1e6 * voltage_gain(known.tactor) * map_.specimen_v(x)
            yield Dots(label, x, y, half, _stack(r.use[a] for r, a in zip(runs, at, strict=True)), marker, model)

    def none(run: VoltageSteps) -> NDArray[np.bool_]:
        return np.full(run.input_v.size, run.rising is None)

    def rising(run: VoltageSteps) -> NDArray[np.bool_]:
        return ~none(run) if run.rising is None else run.rising & ~none(run)

    def falling(run: VoltageSteps) -> NDArray[np.bool_]:
        return np.zeros(run.input_v.size, bool) if run.rising is None else ~run.rising

    dots = (*chosen(none, "measured", "o"), *chosen(rising, "rising", "^"), *chosen(falling, "falling", "v"))
    panel = Panel(
        "",
        "voltage at the amplifier's input (V)",
        "deflection (µm)",
        (line_of(known, volts, band, 1e6),),
        dots,
        from_zero=False,
        unit="µm",
    )
    caption = (
        f"Deflection against rest at {map_.rest_v:g} V (0 V on the specimen). The kink is the amplifier's: "
        f"{map_.slope_below:g} V/V below rest, {map_.slope_above:g} V/V above. {BARS}"
    )
    return Plot("Fig. 6: deflection under a voltage", (panel,), caption)


def damping(known: Specimen) -> Plot | None:
    """Fig. 8: damping by the skin against pre-stretch: every elongation by itself, and the line that was fitted to all."""
    if known.each is None:
        return None
    elongation = np.array(sorted(known.each))
    values, errors = np.array([known.each[e] for e in elongation]).T
    delta = 100 * elongation / known.membrane.L_m
    grid = np.linspace(0.0, 1.05 * float(delta.max()), 30)
    band = known.band(lambda _, m: m.c_s_delta * grid / 100 + m.c_s_0)
    line = known.membrane.c_s_delta * delta / 100 + known.membrane.c_s_0
    dots = Dots("each by itself", delta, values, NORMAL * errors, np.ones(delta.size, bool), "o", line)
    panel = Panel(
        "",
        "pre-stretch δ (%)",
        "c$_s$ (kg/(m s))",
        (line_of(known, grid, band, label="line fitted to all runs at once"),),
        (dots,),
        unit="kg/(m s)",
    )
    caption = (
        "Points: fits in which every elongation has its own damping. Line: c_s = c_s_delta δ + c_s_0, as fitted to all runs; its "
        "intercept is free here, fixed in the paper. Bars and band: 95 %."
    )
    return Plot("Fig. 8: damping by the skin", (panel,), caption)


def _stack(parts: Iterable[NDArray[Kind]]) -> NDArray[Kind]:
    return np.concatenate(list(parts))


def _joined(rows: Iterable[tuple[Array, Array, Array]]) -> tuple[Array, Array, Array]:
    x, y, half = (np.concatenate(column) for column in zip(*rows, strict=True))
    return x, y, half
