"""The parsers of `tactor-bench model`, `study` and `figures`. Cheap to import: what they run is imported when it runs.

What `tactor-bench model TOPIC` does: one function a topic, from the parsed options to an answer.
"""

import argparse
import re
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from annotated_types import Interval

from app.cli.model_options import (
    VOLTAGE,
    describe_specimen,
    read_load,
    read_specimen,
    read_values,
    translate_model_errors,
)
from app.cli.model_response import frequency_response, membrane, step
from app.cli.output import CommandResult, ResultColumn, ResultTable, check_output_files, progress_bar, render
from app.common.errors import UsageError
from app.common.inputs import path_argument
from app.common.units import read_number
from model.parameter_spec import ParameterSpec, parameter_specs
from model.parameters import Membrane, Tactor
from model.response.closed_form import exact_response
from model.response.frequency_response import FREQUENCY_SPEC, poles
from model.response.modes import damping_ratios, mode_shapes, natural_frequencies
from model.response.statics import deflection, load_compliance, voltage_gain
from model.specimen import Specimen, specimen_record, variable_specs
from model.studies.paper_figures import FigureCurve, PaperFigure

SET_HELP = (
    "a parameter with its value, unit understood, e.g. 'L=22 mm'; may be given often. "
    "'tactor-bench model parameters' lists them. @FILE takes many from a TOML or JSON file, as the Explore page copies them"
)


NEGATIVE_NUMBER = re.compile(r"-\.?\d")
"""What argparse takes for a negative number and not an option; before Python 3.14 it does not know `-500V` or `-5e2`."""


def add_model_commands(subparsers: Any) -> None:
    """Register `model`, `study` and `figures` with the subparsers of the command."""
    _add_model(subparsers)
    _add_study(subparsers)
    _add_figures(subparsers)


def _run_model(options: argparse.Namespace) -> int:

    return model(options)


def _run_study(options: argparse.Namespace) -> int:
    from app.cli.study import study

    return study(options)


def _run_figures(options: argparse.Namespace) -> int:
    from app.cli.study import write_figures

    return write_figures(options)


def _add_model(subparsers: Any) -> None:
    model = subparsers.add_parser(
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
        _add_settings_option(parser)
        return parser

    one = topic(
        "parameters",
        "every parameter with value, unit, limits and meaning, and what follows from them",
        "model parameters --set 'E_Al=69 GPa' --elongation '1.27 mm'",
    )
    _add_pre_stretch_option(one)

    one = topic(
        "modes",
        "natural frequencies, poles and damping ratios, free and on the membrane",
        "model modes --set m_add=0 --pre-stretch 0.0075 --picture modes.png",
    )
    _add_pre_stretch_option(one)
    _add_shapes_option(one)
    one.add_argument("--count", type=int, default=3, help="how many modes to tell (default: %(default)s)")
    _add_file_options(one, "the mode shapes")

    one = topic(
        "static",
        "deflection under a load and a voltage, Eqs. (7, corrected) and (8), and its shape",
        "model static --load '200 g' --voltage '1500 V' --csv shape.csv",
    )
    _add_pre_stretch_option(one)
    one.add_argument(
        "--load", default="1 N", help="force at the centre, or a mass for its weight (default: %(default)s)"
    )
    one.add_argument("--voltage", default="1500 V", help="voltage on the specimen (default: %(default)s)")
    _add_file_options(one, "the shape w(x)")

    one = topic(
        "frequency-response",
        "amplitude against frequency under the drive as the amplifier delivers it: 2 x fundamental and max - min",
        "model frequency-response --frequencies 1:500:500 --elongation '1.27 mm' --csv response.csv",
    )
    _add_pre_stretch_option(one)
    _add_shapes_option(one)
    _add_drive_options(one)
    one.add_argument(
        "--frequencies",
        metavar="LIST",
        help="e.g. '25,50,75 Hz', '1:500:500' or '1:1000:100:log' (default: the paper's 18 from 25 to 250 Hz; "
        "1:250:250 where a file is written)",
    )
    one.add_argument("--waveform", choices=("sine", "square"), default="sine", help="drive (default: %(default)s)")
    one.add_argument("--at", metavar="X", help="distance from the clamp, e.g. '8 mm' (default: the centre)")
    one.add_argument("--exact", action="store_true", help="the closed-form solution beside the n shape functions")
    _add_file_options(one, "the response")

    one = topic(
        "step",
        "latency of a voltage step and of a sine's onset: time to 50 µm, rise, overshoot, settling",
        "model step --voltage '1500 V' --frequency '160 Hz' --picture step.png",
    )
    _add_pre_stretch_option(one)
    _add_shapes_option(one)
    _add_drive_options(one)
    one.add_argument("--voltage", default="1500 V", help="step on the specimen (default: %(default)s)")
    one.add_argument("--frequency", default="160 Hz", help="of the sine that begins (default: %(default)s)")
    one.add_argument("--threshold", default="50 um", help="deflection that is felt (default: %(default)s)")
    one.add_argument("--tolerance", default="2 %", help="settling band (default: %(default)s)")
    one.add_argument("--duration", help="of the curves (default: until both have settled)")
    _add_file_options(one, "both curves")

    one = topic(
        "membrane",
        "sag of the membrane by von Karman with linear theory beside it, skin stiffness and damping, by pre-stretch",
        "model membrane --elongation '0:6.35 mm:6' --set 'E_m=6.95 MPa'",
    )
    _add_pre_stretch_option(one, multiple=True)
    one.add_argument("--density", default="1000", help="of the membrane, kg/m^3 (default: %(default)s)")
    one.add_argument("--load", help="weight per length in its place, e.g. '0.906 N/m'")
    _add_file_options(one, "the table")

    one = topic(
        "convergence",
        "error of n shape functions against the closed form",
        "model convergence --shapes 3,5,7,10,20,40 --frequencies 1:500:500",
    )
    _add_pre_stretch_option(one)
    one.add_argument(
        "--shapes", default="3,5,7,10,14,20,28,40", metavar="LIST", help="values of n (default: %(default)s)"
    )
    one.add_argument("--frequencies", default="1:500:500", metavar="LIST", help="(default: %(default)s)")
    _add_file_options(one, "the table")


def _add_study(subparsers: Any) -> None:
    study = subparsers.add_parser(
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
    _add_drive_options(study)
    _add_shapes_option(study, default=None)
    _add_settings_option(study)
    _add_pre_stretch_option(study)
    study.add_argument(
        "--out", type=path_argument, default=argparse.SUPPRESS, metavar="FILE.h5", help="HDF5 (NeXus) file to write"
    )
    _add_file_options(study, "the result")
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


def _add_figures(subparsers: Any) -> None:
    figures = subparsers.add_parser(
        "figures",
        help="the theory curves of the paper's Figs. 4, 5, 6, 8, 9, 10, 11, 12 as pictures and CSV",
        description="The theory curves of the paper's figures. Where the text's claim and the equations differ, the "
        "caption in the picture says so.",
        epilog="example: tactor-bench figures --out figures --only fig9 --pdf",
    )
    figures.add_argument(
        "--out", type=path_argument, default=argparse.SUPPRESS, help="folder to write to (default: figures)"
    )
    figures.add_argument("--only", action="append", metavar="FIG", help="one of them, e.g. fig9; may be given often")
    figures.add_argument("--pdf", action="store_true", help="PDF beside PNG")
    _add_settings_option(figures)
    figures.set_defaults(command=_run_figures)


def _add_settings_option(parser: argparse.ArgumentParser) -> None:
    parser._negative_number_matcher = NEGATIVE_NUMBER  # noqa: SLF001 - see there
    parser.add_argument("--set", dest="settings", action="append", default=[], metavar="NAME=VALUE", help=SET_HELP)
    parser.add_argument("--json", action="store_true", help="one JSON object on standard output, SI units")


def _add_pre_stretch_option(parser: argparse.ArgumentParser, multiple: bool = False) -> None:
    which = ", one or a list" if multiple else "; puts the tactor on the membrane"
    parser.add_argument("--pre-stretch", metavar="DELTA", help=f"of the membrane, e.g. 0.0075 or '0.75 %%'{which}")
    parser.add_argument("--elongation", metavar="LENGTH", help=f"of the membrane, e.g. '1.27 mm'{which}")


def _add_shapes_option(parser: argparse.ArgumentParser, default: int | None = 7) -> None:
    parser.add_argument("-n", type=int, default=default, help="number of shape functions, 3 to 300 (default: 7)")


def _add_drive_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--peak-to-peak", default="5 V", metavar="VOLTS", help="at the amplifier's input (default: 5 V)"
    )
    parser.add_argument("--offset", default="2.5 V", metavar="VOLTS", help="at the amplifier's input (default: 2.5 V)")


def _add_file_options(parser: argparse.ArgumentParser, description: str) -> None:
    parser.add_argument("--csv", type=path_argument, metavar="FILE", help=f"write {description} as CSV, SI units")
    parser.add_argument("--picture", type=path_argument, metavar="PNG", help=f"draw {description}")


SHAPE_COUNT = ParameterSpec("n", "", Interval(), "number of shape functions", 7)
CURVE_POINTS = 201


def model(options: argparse.Namespace) -> int:
    """`tactor-bench model TOPIC`."""
    check_output_files(options)
    with translate_model_errors():
        answer = TOPICS[options.topic](options)
    return render(answer, options)


def parameters(options: argparse.Namespace) -> CommandResult:
    """Every parameter with unit and meaning, and what follows from them."""
    specimen = read_specimen(options, on_membrane=True)
    t, values = specimen.tactor, specimen_record(specimen)
    known = variable_specs()

    def listed(name: str, title: str, names: list[str]) -> ResultTable:
        facts = (
            ResultColumn(n, known[n].unit, [values[n]], description=f"{known[n].description}; {known[n].limits}")
            for n in names
        )
        return ResultTable(name, title, tuple(facts), vertical=True)

    derived = (
        ResultColumn("I_Al", "m^4", [t.I_Al], description="second moment of area of the plate"),
        ResultColumn("k1", "N m^2", [t.k1], description="bending stiffness of the bare plate"),
        ResultColumn(
            "eta", "kg/m", [t.eta], description="added mass per length of the third segment, m_add / (2 (L - L2))"
        ),
        ResultColumn("tau", "s", [t.tau], description="characteristic time sqrt(rho1 L^4 / k1)"),
        ResultColumn("c_bar", "kg/(m s)", [t.c_bar], description="characteristic damping k1 tau / L^4"),
        ResultColumn("k_s", "N/m^2", [values["k_s"]], description="distributed stiffness of the skin"),
        ResultColumn("c_s", "kg/(m s)", [values["c_s"]], description="distributed damping of the skin"),
    )
    tables = (
        listed("tactor", "Tactor", [q.name for q in parameter_specs(Tactor)]),
        listed("skin", "Membrane and skin", [*(q.name for q in parameter_specs(Membrane)), "delta", "contact_length"]),
        ResultTable("derived", "What follows", derived, vertical=True),
    )
    note = "Change one with --set, for example --set 'L=22 mm'; k_s and c_s too, in place of the membrane's."
    return CommandResult("model parameters", values, tables, (note,))


def modes(options: argparse.Namespace) -> CommandResult:
    """Undamped frequencies, poles and damping ratios, free and on the skin."""
    on = read_specimen(options, on_membrane=True)
    free = Specimen(on.tactor)
    count = min(options.count, options.n)
    if count < 1:
        raise UsageError(f"--count {options.count}: ask for at least one mode")
    x = np.linspace(0, on.tactor.L, CURVE_POINTS)
    columns, panels, curve = [ResultColumn("mode", "", range(1, count + 1))], [], [ResultColumn("x", "m", x)]
    tables = []
    for key, head, specimen in (("free", "free", free), ("on_skin", "on the skin", on)):
        f = natural_frequencies(on.tactor, specimen.skin, options.n)[:count]
        columns.append(ResultColumn(f"{key}_frequency", "Hz", f, f"{head}, undamped", format_spec=".2f"))
        s = poles(on.tactor, specimen.skin, options.n)
        s = s[s.imag >= 0][:count]
        tables.append(
            ResultTable(
                f"{key}_poles",
                f"Poles, {describe_specimen(specimen)}",
                (
                    ResultColumn("frequency", "Hz", np.abs(s) / (2 * np.pi), "frequency |s|/2π", format_spec=".2f"),
                    ResultColumn("damping_ratio", "", damping_ratios(s), "damping ratio", format_spec=".4f"),
                    ResultColumn("pole_re", "1/s", s.real, "real part", format_spec=".2f"),
                    ResultColumn("pole_im", "rad/s", s.imag, "imaginary part", format_spec=".2f"),
                ),
            )
        )
        shapes = mode_shapes(on.tactor, x, specimen.skin, options.n, count)
        curve += [ResultColumn(f"{head}, mode {i}", "kg^-1/2", shape) for i, shape in enumerate(shapes, 1)]
        lines = tuple(
            FigureCurve(f"mode {i}, {hz:.1f} Hz", x, w) for i, (hz, w) in enumerate(zip(f, shapes, strict=True), 1)
        )
        caption = f"Undamped mode shapes of the half beam, {describe_specimen(specimen)}."
        panels.append(PaperFigure(f"modes_{key}", "x, clamp to centre", "m", "mode shape", "kg^-1/2", lines, caption))
    first = ResultTable("undamped", "Natural frequencies without damping", tuple(columns))
    return CommandResult(
        "model modes",
        specimen_record(on),
        (first, *tables),
        csv_table=ResultTable("shapes", "", tuple(curve)),
        figures=tuple(panels),
    )


def static(options: argparse.Namespace) -> CommandResult:
    """Compliance, voltage gain, and the shape under a load and a voltage together."""
    specimen = read_specimen(options)
    t, volts, load_n = specimen.tactor, read_number(options.voltage, VOLTAGE), read_load(options.load)
    x = np.linspace(0, t.L, CURVE_POINTS)
    if specimen.membrane is None and specimen.skin.k_s == 0:
        compliance, gain, w = load_compliance(t), voltage_gain(t), deflection(t, x, volts, load_n)
    else:  # Eqs. (7) and (8) know no skin; the closed form at 0 Hz does
        unit = [exact_response(t, 0.0, specimen.skin, x, source)[:, 0].real for source in ("load", "voltage")]
        compliance, gain, w = unit[0][-1], unit[1][-1], load_n * unit[0] + volts * unit[1]
    facts = ResultTable(
        "static",
        f"Static deflection of the centre, {describe_specimen(specimen)}",
        (
            ResultColumn("compliance", "m/N", [compliance], "per newton at the centre, Eq. (7) corrected", "µm/N"),
            ResultColumn("voltage_gain", "m/V", [gain], "per volt on the specimen, Eq. (8)", "nm/V", ".6g"),
            ResultColumn("load", "N", [load_n], "load"),
            ResultColumn("voltage", "V", [volts], "voltage"),
            ResultColumn("by_load", "m", [compliance * load_n], "deflection by the load", "µm"),
            ResultColumn("by_voltage", "m", [gain * volts], "deflection by the voltage", "µm"),
            ResultColumn("deflection", "m", [w[-1]], "both", "µm"),
        ),
        vertical=True,
    )
    caption = f"Static deflection under {load_n:.4g} N and {volts:.4g} V, {describe_specimen(specimen)}."
    figure = PaperFigure("static", "x, clamp to centre", "m", "deflection", "m", (FigureCurve("w(x)", x, w),), caption)
    curve = ResultTable("shape", "", (ResultColumn("x", "m", x), ResultColumn("deflection", "m", w)))
    return CommandResult("model static", specimen_record(specimen), (facts,), csv_table=curve, figures=(figure,))


def convergence(options: argparse.Namespace) -> CommandResult:
    """Error of n shape functions against the closed form, for several n."""
    from model.studies.convergence import convergence as study

    specimen = read_specimen(options)
    n: list[Any] = [int(v) if v == int(v) else v for v in read_values(options.shapes, SHAPE_COUNT)]
    f = read_values(options.frequencies, FREQUENCY_SPEC)
    got = [study(specimen.tactor, specimen.skin, f, [k]) for k in progress_bar(n, "shape functions")]
    worst, worst_amplitude, first = (
        np.concatenate(column)
        for column in zip(*((c.max_error, c.max_amplitude_error, c.first_frequency_hz) for c in got), strict=True)
    )
    table = ResultTable(
        "convergence",
        f"Worst deviation from the closed form over {min(f):g} to {max(f):g} Hz, {describe_specimen(specimen)}",
        (
            ResultColumn("n", "", n, format_spec="g"),
            ResultColumn("error", "", worst, "complex", "%", ".3g"),
            ResultColumn("amplitude_error", "", worst_amplitude, "amplitude", "%", ".3g"),
            ResultColumn("first_frequency", "Hz", first, "first frequency, undamped", format_spec=".4f"),
        ),
    )
    shapes = np.array(n, float)
    lines = (FigureCurve("complex", shapes, worst), FigureCurve("amplitude", shapes, worst_amplitude))
    figure = PaperFigure(
        "convergence", "number of shape functions n", "", "worst relative error", "", lines, f"{table.title}."
    )
    return CommandResult("model convergence", specimen_record(specimen), (table,), figures=(figure,), log_scale=True)


TOPICS: Mapping[str, Callable[[argparse.Namespace], CommandResult]] = {
    "parameters": parameters,
    "modes": modes,
    "static": static,
    "frequency-response": frequency_response,
    "step": step,
    "membrane": membrane,
    "convergence": convergence,
}
