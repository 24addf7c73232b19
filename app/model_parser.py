"""The parsers of `tactor-bench model`, `study` and `figures`. Cheap to import: what they run is imported when it runs."""

import argparse
import re
from typing import Any

from app.arguments import path

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
    from app.model_commands import model

    return model(options)


def _run_study(options: argparse.Namespace) -> int:
    from app.study_commands import study

    return study(options)


def _run_figures(options: argparse.Namespace) -> int:
    from app.figures import figures

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
