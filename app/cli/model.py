"""The parsers of `tactor-bench model`, `study` and `figures`. Cheap to import: what they run is imported when it runs.

What `tactor-bench model TOPIC` does: one function a topic, from the parsed options to an answer.
"""

import argparse
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from annotated_types import Interval

from app.cli.model_options import VOLTAGE, read_load, read_specimen, read_values, refusing, specimen_words
from app.cli.model_response import frequency_response, membrane, step
from app.cli.output import Answer, Column, Table, check_files, deliver, tracked
from app.common.errors import UsageError
from app.common.inputs import path
from app.common.units import read_number
from model.parameter_spec import Quantity, quantities
from model.parameters import Membrane, Tactor
from model.response.closed_form import exact_response
from model.response.frequency_response import FREQUENCY, poles
from model.response.modes import damping_ratios, mode_shapes, natural_frequencies
from model.response.statics import deflection, load_compliance, voltage_gain
from model.specimen import Specimen, specimen_record, variables
from model.studies.paper_figures import Curve, Figure

SET_HELP = (
    "a parameter with its value, unit understood, e.g. 'L=22 mm'; may be given often. "
    "'tactor-bench model parameters' lists them. @FILE takes many from a TOML or JSON file, as the Explore page copies them"
)


NEGATIVE = re.compile(r"-\.?\d")
"""What argparse takes for a negative number and not an option; before Python 3.14 it does not know `-500V` or `-5e2`."""


def add_model_commands(known: Any) -> None:
    """Register `model`, `study` and `figures` with the subparsers of the command."""
    _add_model(known)
    _add_study(known)
    _add_figures(known)


def _run_model(options: argparse.Namespace) -> int:

    return model(options)


def _run_study(options: argparse.Namespace) -> int:
    from app.cli.study import study

    return study(options)


def _run_figures(options: argparse.Namespace) -> int:
    from app.cli.study import figures

    return figures(options)


def _add_model(known: Any) -> None:
    model = known.add_parser(
        "model",
        help="ask the model: parameters, modes, statics, frequency response, step, membrane, convergence",
        description="The theory on its own: every number of the model, for any parameters.",
        epilog="example: tactor-bench model modes --set 'm_add=5 g' --pre-stretch 0.0075",
    )
    topics = model.add_subparsers(title="topics", metavar="TOPIC", required=True, dest="topic")

    def topic(name: str, words: str, example: str) -> argparse.ArgumentParser:
        parser: argparse.ArgumentParser = topics.add_parser(
            name, help=words, description=words[:1].upper() + words[1:] + ".", epilog=f"example: tactor-bench {example}"
        )
        parser.set_defaults(command=_run_model, topic=name)
        _settings(parser)
        return parser

    one = topic(
        "parameters",
        "every parameter with value, unit, limits and meaning, and what follows from them",
        "model parameters --set 'E_Al=69 GPa' --elongation '1.27 mm'",
    )
    _pre_stretch(one)

    one = topic(
        "modes",
        "natural frequencies, poles and damping ratios, free and on the membrane",
        "model modes --set m_add=0 --pre-stretch 0.0075 --picture modes.png",
    )
    _pre_stretch(one)
    _shapes(one)
    one.add_argument("--count", type=int, default=3, help="how many modes to tell (default: %(default)s)")
    _files(one, "the mode shapes")

    one = topic(
        "static",
        "deflection under a load and a voltage, Eqs. (7, corrected) and (8), and its shape",
        "model static --load '200 g' --voltage '1500 V' --csv shape.csv",
    )
    _pre_stretch(one)
    one.add_argument(
        "--load", default="1 N", help="force at the centre, or a mass for its weight (default: %(default)s)"
    )
    one.add_argument("--voltage", default="1500 V", help="voltage on the specimen (default: %(default)s)")
    _files(one, "the shape w(x)")

    one = topic(
        "frequency-response",
        "amplitude against frequency under the drive as the amplifier delivers it: 2 x fundamental and max - min",
        "model frequency-response --frequencies 1:500:500 --elongation '1.27 mm' --csv response.csv",
    )
    _pre_stretch(one)
    _shapes(one)
    _drive(one)
    one.add_argument(
        "--frequencies",
        metavar="LIST",
        help="e.g. '25,50,75 Hz', '1:500:500' or '1:1000:100:log' (default: the paper's 18 from 25 to 250 Hz; "
        "1:250:250 where a file is written)",
    )
    one.add_argument("--waveform", choices=("sine", "square"), default="sine", help="drive (default: %(default)s)")
    one.add_argument("--at", metavar="X", help="distance from the clamp, e.g. '8 mm' (default: the centre)")
    one.add_argument("--exact", action="store_true", help="the closed-form solution beside the n shape functions")
    _files(one, "the response")

    one = topic(
        "step",
        "latency of a voltage step and of a sine's onset: time to 50 µm, rise, overshoot, settling",
        "model step --voltage '1500 V' --frequency '160 Hz' --picture step.png",
    )
    _pre_stretch(one)
    _shapes(one)
    _drive(one)
    one.add_argument("--voltage", default="1500 V", help="step on the specimen (default: %(default)s)")
    one.add_argument("--frequency", default="160 Hz", help="of the sine that begins (default: %(default)s)")
    one.add_argument("--threshold", default="50 um", help="deflection that is felt (default: %(default)s)")
    one.add_argument("--tolerance", default="2 %", help="settling band (default: %(default)s)")
    one.add_argument("--duration", help="of the curves (default: until both have settled)")
    _files(one, "both curves")

    one = topic(
        "membrane",
        "sag of the membrane by von Karman with linear theory beside it, skin stiffness and damping, by pre-stretch",
        "model membrane --elongation '0:6.35 mm:6' --set 'E_m=6.95 MPa'",
    )
    _pre_stretch(one, many=True)
    one.add_argument("--density", default="1000", help="of the membrane, kg/m^3 (default: %(default)s)")
    one.add_argument("--load", help="weight per length in its place, e.g. '0.906 N/m'")
    _files(one, "the table")

    one = topic(
        "convergence",
        "error of n shape functions against the closed form",
        "model convergence --shapes 3,5,7,10,20,40 --frequencies 1:500:500",
    )
    _pre_stretch(one)
    one.add_argument(
        "--shapes", default="3,5,7,10,14,20,28,40", metavar="LIST", help="values of n (default: %(default)s)"
    )
    one.add_argument("--frequencies", default="1:500:500", metavar="LIST", help="(default: %(default)s)")
    _files(one, "the table")


def _add_study(known: Any) -> None:
    study = known.add_parser(
        "study",
        help="vary any parameters over any values: curves, HDF5 and CSV files, sensitivity",
        description="The response for every combination of the values given, or one of the paper's studies.",
        epilog="examples: tactor-bench study fig10 --csv fig10.csv;  "
        "tactor-bench study --vary E_m=1e3:1e9:25:log --vary delta=0:0.04:9 --out skin.h5;  "
        "tactor-bench study --sensitivity --vary k2=6e-3,8e-3 --vary 'm_add=6,9 g'",
    )
    study.add_argument("preset", nargs="?", metavar="PRESET", help="fig10, fig11 or fig12: a study of the paper")
    study.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="NAME=VALUES",
        help="a parameter and its values: a list, START:STOP:COUNT, or START:STOP:COUNT:log; may be given often",
    )
    study.add_argument("--frequencies", metavar="LIST", help="(default: 1:250:250)")
    study.add_argument(
        "--quantity",
        choices=("fundamental", "peak_to_peak", "receptance"),
        help="twice the fundamental (default), max - min, or the complex deflection per volt on the specimen",
    )
    _drive(study)
    _shapes(study, default=None)
    _settings(study)
    _pre_stretch(study)
    study.add_argument(
        "--out", type=path, default=argparse.SUPPRESS, metavar="FILE.h5", help="HDF5 (NeXus) file to write"
    )
    _files(study, "the result")
    study.add_argument(
        "--sensitivity",
        action="store_true",
        help="Sobol indices instead: what share of the variance each parameter explains between its lowest and highest value",
    )
    study.add_argument(
        "--samples", type=int, default=1024, help="for the indices, a power of two (default: %(default)s)"
    )
    study.add_argument("--seed", type=int, default=argparse.SUPPRESS, help="for the indices (default: 1)")
    study.add_argument("--cluster", metavar="ADDRESS|local", help="compute on a Dask cluster, or on one started here")
    study.set_defaults(command=_run_study)


def _add_figures(known: Any) -> None:
    figures = known.add_parser(
        "figures",
        help="the theory curves of the paper's Figs. 4, 5, 6, 8, 9, 10, 11, 12 as pictures and CSV",
        description="The theory curves of the paper's figures. Where the text's claim and the equations differ, the "
        "caption in the picture says so.",
        epilog="example: tactor-bench figures --out figures --only fig9 --pdf",
    )
    figures.add_argument("--out", type=path, default=argparse.SUPPRESS, help="folder to write to (default: figures)")
    figures.add_argument("--only", action="append", metavar="FIG", help="one of them, e.g. fig9; may be given often")
    figures.add_argument("--pdf", action="store_true", help="PDF beside PNG")
    _settings(figures)
    figures.set_defaults(command=_run_figures)


def _settings(parser: argparse.ArgumentParser) -> None:
    parser._negative_number_matcher = NEGATIVE  # noqa: SLF001 - see there
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="NAME=VALUE", help=SET_HELP)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, SI units")


def _pre_stretch(parser: argparse.ArgumentParser, many: bool = False) -> None:
    which = ", one or a list" if many else "; puts the tactor on the membrane"
    parser.add_argument("--pre-stretch", metavar="DELTA", help=f"of the membrane, e.g. 0.0075 or '0.75 %%'{which}")
    parser.add_argument("--elongation", metavar="LENGTH", help=f"of the membrane, e.g. '1.27 mm'{which}")


def _shapes(parser: argparse.ArgumentParser, default: int | None = 7) -> None:
    parser.add_argument("-n", type=int, default=default, help="number of shape functions, 3 to 300 (default: 7)")


def _drive(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--peak-to-peak", default="5 V", metavar="VOLTS", help="at the amplifier's input (default: 5 V)"
    )
    parser.add_argument("--offset", default="2.5 V", metavar="VOLTS", help="at the amplifier's input (default: 2.5 V)")


def _files(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--csv", type=path, metavar="FILE", help=f"write {what} as CSV, SI units")
    parser.add_argument("--picture", type=path, metavar="PNG", help=f"draw {what}")


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
    from model.studies.convergence import convergence as study

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
