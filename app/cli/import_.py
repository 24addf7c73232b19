"""The command `import`: tables and time series as run files."""

from collections.abc import Sequence
from pathlib import Path

from app.archive.importing import ImportedPoints, ImportOptions, import_files, read_time
from app.cli.options import JSON_OBJECT, argument, command, option, specimen_argument, split_setting
from app.cli.output import CommandResult, render
from app.common import (
    Column,
    Table,
    UnitError,
    UsageError,
    terminal_progress,
    to_number,
    usage_errors,
)
from app.config import ConfigError, SensorTable, load_bench


@command(
    "example: tactor-bench import fig4.csv --as sine-dwell --specimen T7 --set 'peak_to_peak_v=5 V' --column peak_to_peak=amplitude_um "
    "--uncertainty 'peak_to_peak=1 %'"
)
class ImportCommand:
    """Import tables of frequency and amplitude, load and deflection, voltage and deflection, mass and frequency, or time
    series under a sine or a sweep as run files, which are listed, identified, exported and reported like measured
    ones. Each states its source file and columns, and has no raw samples. Units are in
    the header ('frequency [Hz]', 'amplitude_um', 'Load (g)') or in --unit.
    """

    files: Sequence[Path] = argument(
        "CSV (any delimiter, decimal comma or point), MATLAB, TDMS or Universal File", nargs="+", metavar="FILE"
    )
    kind: str | None = option(
        "sine-dwell, static-loading, voltage-steps, mass-resonance, raw (time series, one file per frequency or sweep), another protocol, or "
        "the file of a lab's own (default: by the columns)",
        flag="--as",
        metavar="KIND",
    )
    column: Sequence[str] = option(
        "column of a quantity, e.g. peak_to_peak=A, where its name is ambiguous; may be repeated",
        metavar="QUANTITY=HEAD",
    )
    unit: Sequence[str] = option(
        "unit of a column, e.g. A=um, instead of the unit in its header; may be repeated", metavar="COLUMN=UNIT"
    )
    uncertainty: Sequence[str] = option(
        "standard uncertainty of every value, e.g. 'deflection=2 um' or 'peak_to_peak=1 %%'; may be repeated",
        metavar="QUANTITY=SIZE",
    )
    settings: Sequence[str] = option(
        "value of a parameter of the protocol, e.g. 'peak_to_peak_v=5 V'; may be repeated",
        flag="--set",
        metavar="NAME=VALUE",
    )
    specimen: str = option("name of the specimen (default: unnamed)", "unnamed", type=specimen_argument)
    membrane_elongation: str | None = option(
        "elongation of the membrane, e.g. '1.27 mm'; without it the tactor is free", metavar="LENGTH"
    )
    sensor: str = option(
        "name and serial number of the displacement sensor; runs of one sensor share the errors of its gain and delay (default: of --bench)",
        metavar="NAME",
    )
    gain_error: str | None = option(
        "standard uncertainty of the sensor's gain, common to all values, e.g. '0.5 %%' (default: of --bench)",
        metavar="SHARE",
    )
    sensor_delay: str | None = option("delay of the sensor's output, e.g. '100 us'; for time series", metavar="TIME")
    delay_error: str | None = option(
        "standard uncertainty of the sensor's delay, common to all phases, e.g. '3 us' (default: of --bench)",
        metavar="TIME",
    )
    bench: str = option(
        "bench file with amplifier and sensor of the measurement (default: AMT2012-CE3, 2.5 V is rest; a sensor without stated errors)",
        metavar="FILE",
    )
    measured: str | None = option(
        "date of the measurement: 2019-05-04, or 2019-05-04T15:30 (default: now, and the run states that the date is not recorded)",
        metavar="WHEN",
    )
    simulated: bool = option("mark the run as simulated, for values from a simulation")
    out: Path = option("folder for the run files (default: runs)", Path("runs"), metavar="FOLDER")
    dry_run: bool = option("print the run that would be imported, and write nothing")
    json: bool = JSON_OBJECT

    @usage_errors(ConfigError)
    def execute(self) -> int:
        description = self.files[0].name if len(self.files) == 1 else f"{len(self.files)} files"
        bench = load_bench(self.bench or "ideal")
        options = _options(self, bench.sensor if self.bench else SensorTable(name=""))
        with terminal_progress(description, self.json) as progress:
            taken, written = import_files(options, bench.amplifier, progress)
        return render(_import_result(taken, written), self.json)


def _options(options: ImportCommand, sensor: SensorTable) -> ImportOptions:
    """Return the options of an import; `sensor` has the errors that no option states."""
    gain_error = _parse_number("--gain-error", options.gain_error, "1")
    delay_error = _parse_number("--delay-error", options.delay_error, "s")
    elongation = _parse_number("--membrane-elongation", options.membrane_elongation, "m")
    if elongation is not None and not 0 <= elongation <= 0.05:
        raise UsageError(f"--membrane-elongation {options.membrane_elongation}: it must lie between 0 and 50 mm")
    return ImportOptions(
        files=tuple(options.files),
        folder=options.out,
        kind=options.kind,
        specimen=options.specimen,
        columns=dict(split_setting(text, "--column", "peak_to_peak=A") for text in options.column),
        units=dict(split_setting(text, "--unit", "A=um") for text in options.unit),
        uncertainties=dict(split_setting(text, "--uncertainty", "'deflection=2 um'") for text in options.uncertainty),
        settings=dict(split_setting(text, "--set", "'peak_to_peak_v=5 V'") for text in options.settings),
        elongation_m=elongation,
        sensor=options.sensor or f"{sensor.name} {sensor.serial}".strip(),
        gain_error=sensor.gain_relative_uncertainty if gain_error is None else gain_error,
        delay_error_s=sensor.delay_uncertainty_s if delay_error is None else delay_error,
        delay_s=_parse_number("--sensor-delay", options.sensor_delay, "s"),
        simulated=options.simulated,
        measured=read_time(options.measured) if options.measured else None,
        dry_run=options.dry_run,
    )


def _parse_number(option: str, text: str | None, unit: str) -> float | None:
    if text is None:
        return None
    with usage_errors(UnitError, about=f"{option} {text}"):
        share = unit == "1" and text.strip().endswith("%")
        number = to_number(text.strip().removesuffix("%"), "1") / 100 if share else to_number(text, unit)
    if not 0 <= number < float("inf"):
        raise UsageError(f"{option} {text}: it must not be negative")
    return number


def _import_result(runs: Sequence[ImportedPoints], written: Sequence[Path]) -> CommandResult:
    tables, notes = [], list[str]()
    for taken in runs:
        names = ", ".join(name for name, _ in taken.files)
        read, unused = list(taken.mapping.read()), [cells.heading for cells in taken.mapping.unused]
        title = f"{taken.protocol.title} from {names}: {len(taken.points)} points{', SIMULATED' * taken.simulated}"
        columns = (
            Column("quantity", "", [spec.name for spec, _ in read]),
            Column("column", "", [cells.heading for _, cells in read]),
            Column("unit", "", [cells.unit or spec.unit for spec, cells in read]),
            Column("meaning", "", [spec.description for spec, _ in read]),
        )
        tables.append(Table(f"columns of {names}", title, columns, max_rows=200))
        notes += [f"caution: {text}" for text in taken.warnings]
        if unused:
            notes.append(f"left out: {', '.join(map(repr, unused))}")
    notes += [f"wrote {path}" for path in written] or ["nothing was written (--dry-run)"]
    more = {
        "written": [str(path) for path in written],
        "points": sum(len(taken.points) for taken in runs),
        "cautions": [text for taken in runs for text in taken.warnings],
        "left_out": [cells.heading for taken in runs for cells in taken.mapping.unused],
    }
    return CommandResult("import", {}, tuple(tables), tuple(notes), extra=more)
