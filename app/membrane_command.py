"""What `tactor-bench model membrane` does: the sag of the rubber that stands for skin, and the skin it makes."""

import argparse
from dataclasses import replace

import numpy as np

from app.answer import Answer, Column, Table
from app.exits import UsageError
from app.model_inputs import DENSITY, ELONGATION, read_settings, read_values
from app.units import read_number
from model.figures import Curve, Figure
from model.membrane import LOAD as WEIGHT
from model.membrane import Sag, sag, weight
from model.parameters import Membrane
from model.quantity import ParameterError
from model.skin import PRE_STRETCH, point_stiffness
from model.specimen import Specimen, changed, specimen_record

ELONGATIONS = "0,1.27,2.54,3.81,5.08,6.35 mm"
"""The paper's membrane elongations."""
ELONGATION_CURVE = "0:6.35 mm:64"


def membrane(options: argparse.Namespace) -> Answer:
    """Sag under its own weight and the skin it makes, at each pre-stretch asked for."""
    values = read_settings(options.settings)
    if "delta" in values:
        raise UsageError("--set delta: the membrane is told at several pre-stretches; write --pre-stretch 0.0075")
    if options.pre_stretch is not None and options.elongation is not None:
        raise UsageError("the pre-stretch is given twice, by --pre-stretch and --elongation; leave one out")
    specimen = changed(Specimen(membrane=Membrane()), values)
    m = specimen.membrane or Membrane()
    if options.pre_stretch is not None:
        delta = np.array(read_values(options.pre_stretch, PRE_STRETCH))
    else:
        usual = ELONGATION_CURVE if options.csv or options.picture else ELONGATIONS
        wanted = usual if options.elongation is None else options.elongation
        delta = np.array(read_values(wanted, ELONGATION)) / m.L_m
    q = weight(m, read_number(options.density, DENSITY)) if options.load is None else read_number(options.load, WEIGHT)
    sags = [_sag(m, q, float(d)) for d in delta]
    skins = [replace(specimen, delta=float(d)).skin for d in delta]
    table = Table(
        "membrane",
        f"Membrane, E_m = {m.E_m / 1e6:.4g} MPa, under {q:.4g} N/m of its own weight",
        (
            Column("elongation", "m", delta * m.L_m, shown="mm", form=".2f"),
            Column("pre_stretch", "", delta, "pre-stretch", form=".5f"),
            Column("sag", "m", [s.centre_m for s in sags], "sag", "mm", ".3f"),
            Column("linear_sag", "m", [s.linear_m for s in sags], "linear theory", "mm", ".3f"),
            Column("tension", "N", [s.tension_n for s in sags], "tension", form=".4g"),
            Column("stretch", "", [s.stretch for s in sags], form=".5f"),
            Column("k_point", "N/m", point_stiffness(m.L_m, m.b_m, m.h_m, m.E_m, delta), form=".5g"),
            Column("k_s", "N/m^2", [s.k_s for s in skins]),
            Column("c_s", "kg/(m s)", [s.c_s for s in skins]),
        ),
    )
    note = (
        "Sag: bending with the tension that the deflection itself makes (von Karman) and the pre-stretch; linear theory leaves "
        "the former out. k_s and c_s are those of the weightless membrane at its pre-stretch."
    )
    lines = {c.name: c for c in table.columns}
    panels = tuple(
        Figure(name, "elongation of the membrane", "m", words, lines[names[0]].unit, curves, words.capitalize() + ".")
        for name, words, names in (
            ("sag", "sag of the centre", ("sag", "linear_sag")),
            ("k_s", "skin stiffness k_s", ("k_s",)),
            ("c_s", "skin damping c_s", ("c_s",)),
        )
        for curves in [tuple(Curve(lines[n].head or n, delta * m.L_m, np.asarray(lines[n].values)) for n in names)]
    )
    return Answer("model membrane", specimen_record(specimen), (table,), (note,), pictures=panels)


def _sag(m: Membrane, q: float, delta: float) -> Sag:
    try:
        return sag(m, q, delta)
    except ParameterError:
        raise
    except (ValueError, RuntimeError) as error:  # the search for the tension found none
        raise UsageError(
            f"the sag under {q:g} N/m at pre-stretch {delta:g} cannot be computed ({error}); "
            "give a load that stretches the membrane noticeably, or less pre-stretch"
        ) from error
