"""What `tactor-bench model TOPIC` does: one function a topic, from the parsed options to an answer."""

import argparse
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from annotated_types import Interval

from app.answer import Answer, Column, Table, check_files, deliver, tracked
from app.exits import UsageError
from app.membrane_command import membrane
from app.model_inputs import VOLTAGE, read_load, read_specimen, read_values, refusing, specimen_words
from app.response_commands import frequency_response, step
from app.units import read_number
from model.closed_form import exact_response
from model.figures import Curve, Figure
from model.modes import damping_ratios, mode_shapes, natural_frequencies
from model.parameters import Membrane, Tactor
from model.quantity import Quantity, quantities
from model.response import FREQUENCY, poles
from model.specimen import Specimen, specimen_record, variables
from model.statics import deflection, load_compliance, voltage_gain

SHAPES = Quantity("n", "", Interval(), "number of shape functions", 7)
POINTS = 201


def model(options: argparse.Namespace) -> int:
    """`tactor-bench model TOPIC`."""
    check_files(options)
    with refusing():
        answer = TOPICS[options.topic](options)
    return deliver(answer, options)


def parameters(options: argparse.Namespace) -> Answer:
    """Every parameter with unit and meaning, and what follows from them."""
    specimen = read_specimen(options, on_membrane=True)
    t, values = specimen.tactor, specimen_record(specimen)
    known = variables()

    def listed(name: str, title: str, names: list[str]) -> Table:
        facts = (Column(n, known[n].unit, [values[n]], meaning=f"{known[n].words}; {known[n].limits}") for n in names)
        return Table(name, title, tuple(facts), upright=True)

    derived = (
        Column("I_Al", "m^4", [t.I_Al], meaning="second moment of area of the plate"),
        Column("k1", "N m^2", [t.k1], meaning="bending stiffness of the bare plate"),
        Column("eta", "kg/m", [t.eta], meaning="added mass per length of the third segment, m_add / (2 (L - L2))"),
        Column("tau", "s", [t.tau], meaning="characteristic time sqrt(rho1 L^4 / k1)"),
        Column("c_bar", "kg/(m s)", [t.c_bar], meaning="characteristic damping k1 tau / L^4"),
        Column("k_s", "N/m^2", [values["k_s"]], meaning="distributed stiffness of the skin"),
        Column("c_s", "kg/(m s)", [values["c_s"]], meaning="distributed damping of the skin"),
    )
    tables = (
        listed("tactor", "Tactor", [q.name for q in quantities(Tactor)]),
        listed("skin", "Membrane and skin", [*(q.name for q in quantities(Membrane)), "delta", "contact_length"]),
        Table("derived", "What follows", derived, upright=True),
    )
    note = "Change one with --set, for example --set 'L=22 mm'; k_s and c_s too, in place of the membrane's."
    return Answer("model parameters", values, tables, (note,))


def modes(options: argparse.Namespace) -> Answer:
    """Undamped frequencies, poles and damping ratios, free and on the skin."""
    on = read_specimen(options, on_membrane=True)
    free = Specimen(on.tactor)
    count = min(options.count, options.n)
    if count < 1:
        raise UsageError(f"--count {options.count}: ask for at least one mode")
    x = np.linspace(0, on.tactor.L, POINTS)
    columns, panels, curve = [Column("mode", "", range(1, count + 1))], [], [Column("x", "m", x)]
    tables = []
    for key, head, specimen in (("free", "free", free), ("on_skin", "on the skin", on)):
        f = natural_frequencies(on.tactor, specimen.skin, options.n)[:count]
        columns.append(Column(f"{key}_frequency", "Hz", f, f"{head}, undamped", form=".2f"))
        s = poles(on.tactor, specimen.skin, options.n)
        s = s[s.imag >= 0][:count]
        tables.append(
            Table(
                f"{key}_poles",
                f"Poles, {specimen_words(specimen)}",
                (
                    Column("frequency", "Hz", np.abs(s) / (2 * np.pi), "frequency |s|/2π", form=".2f"),
                    Column("damping_ratio", "", damping_ratios(s), "damping ratio", form=".4f"),
                    Column("pole_re", "1/s", s.real, "real part", form=".2f"),
                    Column("pole_im", "rad/s", s.imag, "imaginary part", form=".2f"),
                ),
            )
        )
        shapes = mode_shapes(on.tactor, x, specimen.skin, options.n, count)
        curve += [Column(f"{head}, mode {i}", "kg^-1/2", shape) for i, shape in enumerate(shapes, 1)]
        lines = tuple(Curve(f"mode {i}, {hz:.1f} Hz", x, w) for i, (hz, w) in enumerate(zip(f, shapes, strict=True), 1))
        caption = f"Undamped mode shapes of the half beam, {specimen_words(specimen)}."
        panels.append(Figure(f"modes_{key}", "x, clamp to centre", "m", "mode shape", "kg^-1/2", lines, caption))
    first = Table("undamped", "Natural frequencies without damping", tuple(columns))
    return Answer(
        "model modes",
        specimen_record(on),
        (first, *tables),
        curve=Table("shapes", "", tuple(curve)),
        pictures=tuple(panels),
    )


def static(options: argparse.Namespace) -> Answer:
    """Compliance, voltage gain, and the shape under a load and a voltage together."""
    specimen = read_specimen(options)
    t, volts, load_n = specimen.tactor, read_number(options.voltage, VOLTAGE), read_load(options.load)
    x = np.linspace(0, t.L, POINTS)
    if specimen.membrane is None and specimen.skin.k_s == 0:
        compliance, gain, w = load_compliance(t), voltage_gain(t), deflection(t, x, volts, load_n)
    else:  # Eqs. (7) and (8) know no skin; the closed form at 0 Hz does
        unit = [exact_response(t, 0.0, specimen.skin, x, source)[:, 0].real for source in ("load", "voltage")]
        compliance, gain, w = unit[0][-1], unit[1][-1], load_n * unit[0] + volts * unit[1]
    facts = Table(
        "static",
        f"Static deflection of the centre, {specimen_words(specimen)}",
        (
            Column("compliance", "m/N", [compliance], "per newton at the centre, Eq. (7) corrected", "µm/N"),
            Column("voltage_gain", "m/V", [gain], "per volt on the specimen, Eq. (8)", "nm/V", ".6g"),
            Column("load", "N", [load_n], "load"),
            Column("voltage", "V", [volts], "voltage"),
            Column("by_load", "m", [compliance * load_n], "deflection by the load", "µm"),
            Column("by_voltage", "m", [gain * volts], "deflection by the voltage", "µm"),
            Column("deflection", "m", [w[-1]], "both", "µm"),
        ),
        upright=True,
    )
    caption = f"Static deflection under {load_n:.4g} N and {volts:.4g} V, {specimen_words(specimen)}."
    figure = Figure("static", "x, clamp to centre", "m", "deflection", "m", (Curve("w(x)", x, w),), caption)
    curve = Table("shape", "", (Column("x", "m", x), Column("deflection", "m", w)))
    return Answer("model static", specimen_record(specimen), (facts,), curve=curve, pictures=(figure,))


def convergence(options: argparse.Namespace) -> Answer:
    """Error of n shape functions against the closed form, for several n."""
    from model.convergence import convergence as study

    specimen = read_specimen(options)
    n: list[Any] = [int(v) if v == int(v) else v for v in read_values(options.shapes, SHAPES)]
    f = read_values(options.frequencies, FREQUENCY)
    got = [study(specimen.tactor, specimen.skin, f, [k]) for k in tracked(n, "shape functions")]
    worst, worst_amplitude, first = (
        np.concatenate(column)
        for column in zip(*((c.worst, c.worst_amplitude, c.first_frequency_hz) for c in got), strict=True)
    )
    table = Table(
        "convergence",
        f"Worst deviation from the closed form over {min(f):g} to {max(f):g} Hz, {specimen_words(specimen)}",
        (
            Column("n", "", n, form="g"),
            Column("error", "", worst, "complex", "%", ".3g"),
            Column("amplitude_error", "", worst_amplitude, "amplitude", "%", ".3g"),
            Column("first_frequency", "Hz", first, "first frequency, undamped", form=".4f"),
        ),
    )
    shapes = np.array(n, float)
    lines = (Curve("complex", shapes, worst), Curve("amplitude", shapes, worst_amplitude))
    figure = Figure(
        "convergence", "number of shape functions n", "", "worst relative error", "", lines, f"{table.title}."
    )
    return Answer("model convergence", specimen_record(specimen), (table,), pictures=(figure,), log=True)


TOPICS: Mapping[str, Callable[[argparse.Namespace], Answer]] = {
    "parameters": parameters,
    "modes": modes,
    "static": static,
    "frequency-response": frequency_response,
    "step": step,
    "membrane": membrane,
    "convergence": convergence,
}
