"""The parser of `tactor-bench import`. What it runs is imported when it runs."""

import argparse
from pathlib import Path
from typing import Any

from app.arguments import path, specimen


def add_import_command(known: Any) -> None:
    """Register `import` with the subparsers of the command."""
    command = known.add_parser(
        "import",
        help="old tables and time series as run files: CSV or MAT",
        description="Tables of frequency and amplitude, load and deflection, voltage and deflection, mass and frequency, or time series "
        "under a sine, as run files that are listed, identified, exported and reported like measured ones. Each says that it was "
        "imported, from which file and which columns, and has no raw samples. Units stand in the header ('frequency [Hz]', "
        "'amplitude_um', 'Load (g)') or in --unit.",
        epilog="example: tactor-bench import fig4.csv --as sine-dwell --specimen T7 --set 'peak_to_peak_v=5 V' --column peak_to_peak=amplitude_um "
        "--uncertainty 'peak_to_peak=1 %'",
    )
    command.add_argument(
        "files", nargs="+", type=path, metavar="FILE", help="CSV (any delimiter, decimal comma or point) or MAT files"
    )
    command.add_argument(
        "--as",
        dest="kind",
        metavar="KIND",
        help="sine-dwell, static-loading, voltage-steps, mass-resonance, raw (time series, a file a frequency), or another protocol; "
        "(default: what the columns say)",
    )
    for option, name, words in (
        (
            "--column",
            "QUANTITY=HEAD",
            "which column is which quantity, e.g. peak_to_peak=A; where its name does not tell",
        ),
        ("--unit", "COLUMN=UNIT", "the unit of a column, e.g. A=um; instead of what its head says"),
        (
            "--uncertainty",
            "QUANTITY=SIZE",
            "standard uncertainty of every value, e.g. 'deflection=2 um' or 'peak_to_peak=1 %%'",
        ),
        ("--set", "NAME=VALUE", "a parameter of the protocol that is known, e.g. 'peak_to_peak_v=5 V'"),
    ):
        command.add_argument(
            option,
            dest={"--set": "settings"}.get(option, option[2:]),
            action="append",
            default=[],
            metavar=name,
            help=f"{words}; may be given often",
        )
    command.add_argument("--specimen", type=specimen, default="unnamed", help="name of the specimen (default: unnamed)")
    command.add_argument(
        "--membrane-elongation",
        metavar="LENGTH",
        help="by how much the membrane was stretched, e.g. '1.27 mm'; free without it",
    )
    command.add_argument(
        "--sensor",
        default="",
        metavar="NAME",
        help="the displacement sensor's name and serial number; runs of one sensor share its gain's error",
    )
    command.add_argument(
        "--gain-error",
        metavar="SHARE",
        help="standard uncertainty of the sensor's gain, common to all values, e.g. '0.5 %%'",
    )
    command.add_argument(
        "--sensor-delay", metavar="TIME", help="how late the sensor's output was, e.g. '100 us'; for time series"
    )
    command.add_argument(
        "--bench",
        default="sim",
        metavar="FILE",
        help="bench file of the amplifier it was driven with (default: AMT2012-CE3, 2.5 V is rest)",
    )
    command.add_argument(
        "--measured",
        metavar="WHEN",
        help="when it was measured: 2019-05-04, or 2019-05-04T15:30 (default: now, and the run says it is not told)",
    )
    command.add_argument(
        "--simulated", action="store_true", help="these values come from a simulation; the run will say so"
    )
    command.add_argument(
        "--out", type=path, default=Path("runs"), metavar="FOLDER", help="folder for the run files (default: runs)"
    )
    command.add_argument("--dry-run", action="store_true", help="tell what would be read, and write nothing")
    command.add_argument("--json", action="store_true", help="as one JSON object, SI units")
    command.set_defaults(command=_import)


def _import(options: argparse.Namespace) -> int:
    from app.import_command import import_tables

    return import_tables(options)
