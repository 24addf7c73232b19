"""The commands `study` and `figures`: parameter studies, and the theory curves of the paper's figures."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import replace
from itertools import groupby
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.cli.model_options import (
    DriveOptions,
    ParameterOptions,
    ShapeOptions,
    SpecimenOptions,
    read_settings,
    read_specimen,
    read_values,
    read_vary,
    translate_model_errors,
)
from app.cli.options import CLUSTER, FileOptions, argument, command, group, option
from app.cli.output import CommandResult, check_output_files, print_json, render, writing_output
from app.common import Column, ExitCode, Table, UsageError, print_message, terminal_progress, track, usage_errors
from app.plotting import draw_figure
from app.services import ClusterError, CountingExecutor, cluster_executor
from model import Array, Series, replace_variables, shown_unit
from model.response import FREQUENCY_SPEC, ShapeChoice
from model.studies import MEASURE_UNITS, STUDY_PRESETS, Measure, PaperFigure, Study, StudyResult, paper_figures
from protocols.runfile import StorageError, StudyFileWriter, StudyHeader, check_output_path

MAX_CURVES = 8
"""Combinations that a picture shows."""


PAPER_ACCURACY = "1 %"
"""Of the paper's seven shape functions: 0.81 % from 1 to 500 Hz."""


def study_record(result: StudyResult) -> dict[str, Any]:
    """Return the result for JSON: nested lists; a complex number is a pair."""
    v = result.values
    lists = (np.stack((v.real, v.imag), -1) if np.iscomplexobj(v) else v).tolist()
    axes = [{"name": a.name, "unit": a.unit, "values": a.values} for a in result.axes]
    return {"axes": axes, result.measure: {"unit": result.unit, "values": lists}}


def study_summary(study: Study, amplitude: Array) -> tuple[Column, ...]:
    """Return a table of the combinations with their peaks."""
    f, peak = np.asarray(study.frequency_hz), amplitude.argmax(1)
    index = np.unravel_index(np.arange(len(amplitude)), study.shape or (1,))
    varied = (
        Column(axis.name, axis.unit, np.asarray(axis.values)[i])
        for axis, i in zip(study.axes[:-1], index, strict=False)
    )
    unit = MEASURE_UNITS[study.measure]
    shown = "nm/V" if unit == "m/V" else shown_unit(unit)[1]
    ends = (
        (f"at_{f[0]:g}_hz", amplitude[:, 0], f"at {f[0]:g} Hz"),
        (f"at_{f[-1]:g}_hz", amplitude[:, -1], f"at {f[-1]:g} Hz"),
    )
    return (
        *varied,
        Column("peak", unit, amplitude.max(1), "highest", shown, ".1f"),
        Column("peak_frequency", "Hz", f[peak], "at frequency", format_spec="g"),
        *(Column(name, unit, values, head, shown, ".1f") for name, values, head in ends),
    )


def study_figure(study: Study, values: NDArray[Any]) -> PaperFigure:
    """Return a figure of up to MAX_CURVES curves over frequency."""
    f = np.asarray(study.frequency_hz)
    curves = []
    for k in np.unique(np.linspace(0, len(values) - 1, min(len(values), MAX_CURVES)).astype(int)):
        index = np.unravel_index(k, study.shape or (1,))
        label = ", ".join(
            f"{a.name} = {a.values[i]:.4g} {a.unit}".rstrip() for a, i in zip(study.axes, index, strict=False)
        )
        curves.append(Series(f, np.abs(values[k]), label=label))
    some = f" {len(curves)} of {len(values)} combinations." if len(curves) < len(values) else ""
    where = "Free tactor" if study.specimen.membrane is None else "Tactor on the membrane"
    caption = f"{where}: {study.title}.{some}"
    return PaperFigure(
        "study", "frequency", "Hz", "amplitude of the centre", MEASURE_UNITS[study.measure], tuple(curves), caption
    )


CURVE_HZ = "1:250:250"
MAX_SETS = 30
"""Combinations that are listed on a terminal."""
MAX_NUMBERS = 50_000_000
"""Most numbers held in memory for CSV, JSON or a picture; HDF5 is written chunk by chunk."""


@command(
    "examples: tactor-bench study fig10 --csv fig10.csv;  "
    "tactor-bench study --vary E_m=1e3:1e9:25:log --vary delta=0:0.04:9 --out skin.h5;  "
    "tactor-bench study --sensitivity --vary k2=6e-3,8e-3 --vary 'm_add=6,9 g'",
    negative_values=True,
)
class StudyCommand:
    """Compute the response for every combination of the given values, or one of the paper's studies."""

    preset: str | None = argument("fig10, fig11 or fig12: a study of the paper", nargs="?", metavar="PRESET")
    vary: Sequence[str] = option(
        "a parameter and its values: a list, START:STOP:COUNT, or START:STOP:COUNT:log; may be repeated",
        metavar="NAME=VALUES",
    )
    frequencies: str | None = option("(default: 1:250:250)", metavar="LIST")
    quantity: Measure | None = option(
        "result: twice the fundamental (default), max - min, or the complex deflection per volt on the specimen"
    )
    drive: DriveOptions = group(DriveOptions)
    shapes: ShapeOptions = group(ShapeOptions)
    specimen: SpecimenOptions = group(SpecimenOptions)
    out: Path | None = option("HDF5 (NeXus) file to write", inherited=True, metavar="FILE.h5")
    files: FileOptions = group(FileOptions, "the result")
    sensitivity: bool = option(
        "compute Sobol indices instead: share of the variance that each parameter explains between its lowest and highest value"
    )
    samples: int = option("sample size of the indices, a power of two (default: %(default)s)", 1024)
    seed: int = option("seed of the indices (default: 1)", 1, inherited=True)
    cluster: str | None = CLUSTER

    def execute(self) -> int:
        with translate_model_errors():
            request, choice = read_study(self)
        check_output_files(self.files)
        with usage_errors(StorageError):
            if self.out is not None:
                check_output_path(self.out)
        try:
            with translate_model_errors():
                result = _sensitivity(request, self) if self.sensitivity else _compute_study(request, self)
            result = replace(result, notes=(*result.notes, choice.describe()))
        except (StorageError, ClusterError) as error:
            print_message(f"tactor-bench: {error}")
            return ExitCode.FAILED
        except KeyboardInterrupt:
            print_message("tactor-bench: stopped; nothing was written")
            return ExitCode.FAILED
        return render(result, self.specimen.json, self.files)


def read_study(options: StudyCommand) -> tuple[Study, ShapeChoice]:
    """Return the study that the options describe, and its number of shape functions with their accuracy.

    Raises:
        UsageError, ParameterError: it cannot be computed.
    """
    vary, frequencies = dict(map(read_vary, options.vary)), options.frequencies
    if options.preset is None and not vary:
        raise UsageError(
            f"name the study: a preset ({', '.join(STUDY_PRESETS)}), or --vary NAME=VALUES, for example --vary delta=0:0.04:9"
        )
    if options.preset is not None and vary:
        raise UsageError(f"{options.preset} defines the varied parameters; leave out --vary, or the preset")
    if options.preset is None:
        values = {name: v[0] for name, v in vary.items()}
        on_membrane = replace_variables(read_specimen(options.specimen), values).membrane is not None
        base = Study(vary, (1.0,), read_specimen(options.specimen, on_membrane=on_membrane))
        frequencies = CURVE_HZ if frequencies is None else frequencies
    elif options.preset in STUDY_PRESETS:
        base = STUDY_PRESETS[options.preset]()
        base = replace(base, specimen=replace_variables(base.specimen, read_settings(options.specimen.settings)))
    else:
        raise UsageError(f"there is no study '{options.preset}'; the presets are: {', '.join(STUDY_PRESETS)}")
    _check_overlap(base, options)
    amplitude_v, offset_v = options.drive.read()
    study = replace(
        base,
        frequency_hz=read_values(frequencies, FREQUENCY_SPEC) if frequencies is not None else base.frequency_hz,
        measure=options.quantity or base.measure,
        amplitude_v=amplitude_v,
        offset_v=offset_v,
    )
    shapes = options.shapes
    if options.preset is not None and shapes == ShapeOptions():
        # A preset is the paper's figure, with the paper's shape functions.
        shapes = replace(shapes, n=base.n, accuracy=PAPER_ACCURACY)
    choice = _choose_shapes(study, shapes)
    return replace(study, n=choice.n, hermite=choice.hermite), choice


def _choose_shapes(study: Study, options: ShapeOptions) -> ShapeChoice:
    """Return the number of shape functions that is accurate for the lowest and the highest values of the varied parameters.

    All variables are at their first value but one, which is at its lowest or highest; and all at their lowest, all at their highest.
    """
    first = {name: values[0] for name, values in study.vary.items()}
    corners = [{name: pick(values) for name, values in study.vary.items()} for pick in (min, max)]
    corners += [{**first, name: pick(values)} for name, values in study.vary.items() for pick in (min, max)]
    highest_hz = max(study.frequency_hz)
    different = {tuple(corner.items()): corner for corner in corners}.values()
    choices = [
        options.choose(replace_variables(study.specimen, corner), highest_hz, hermite=True) for corner in different
    ]
    return max(choices, key=lambda choice: (not choice.accurate, choice.n, choice.error))


def _check_overlap(base: Study, options: StudyCommand) -> None:
    """Raise UsageError for a value of a varied parameter: it would have no effect."""
    given = {f"--set {name}": name for name in read_settings(options.specimen.settings)}
    given |= dict.fromkeys(options.specimen.stretch_flags, "delta")
    for source, name in given.items():
        if name in base.vary:
            raise UsageError(f"{name} is varied by the study; leave out {source}")
    if options.preset is not None and "delta" in given.values():
        raise UsageError(f"{options.preset} has its own pre-stretch; leave it out, or write the study with --vary")


def _compute_study(request: Study, options: StudyCommand) -> CommandResult:
    sets, points = prod(request.shape), len(request.frequency_hz)
    keep = options.files.csv is not None or options.files.picture is not None or options.specimen.json
    if keep and sets * points > MAX_NUMBERS:
        raise UsageError(
            f"the study has {sets * points:g} numbers, more than the {MAX_NUMBERS:g} that --csv, --picture and --json hold; "
            "write it with --out alone, or vary less"
        )
    rows = sets if keep else min(sets, MAX_SETS)
    kept: NDArray[Any] = np.empty((rows, points), complex if request.measure == "receptance" else float)
    running: Any = request.chunks
    with (
        _open_study_file(request, options.out) as write,
        cluster_executor(options.cluster) as pool,
        _set_progress(sets) as advance,
        closing(running(pool)) as blocks,
    ):
        for start, block in blocks:
            write(start, block)
            part = kept[start : start + len(block)]
            part[:] = block[: len(part)]
            advance(len(block))
    summary = Table("summary", request.title, study_summary(request, np.abs(kept[:MAX_SETS])))
    notes = [f"the first {MAX_SETS} of {sets} combinations; all of them with --out or --csv"] if sets > MAX_SETS else []
    result = None
    if keep:
        values = kept.reshape(*request.shape, points)
        result = StudyResult(request.measure, MEASURE_UNITS[request.measure], request.axes, values)
    return CommandResult(
        "study",
        request.fixed,
        (summary,),
        tuple(notes),
        write_csv=result.to_csv if result else None,
        figures=(study_figure(request, kept),) if options.files.picture is not None else (),
        extra=study_record(result) if result and options.specimen.json else {},
    )


@contextmanager
def _open_study_file(request: Study, path: Path | None) -> Iterator[Callable[[int, NDArray[Any]], None]]:
    """Yield the function that stores blocks in an HDF5 file, or ignores them without a path."""
    if path is None:
        yield lambda *_: None
        return
    with StudyFileWriter(path, StudyHeader.of(request)) as file:
        yield file.write
    print_message(f"wrote {path}")


@contextmanager
def _set_progress(total: int) -> Iterator[Callable[[int], None]]:
    """Show a bar on a terminal that counts parameter sets."""
    done = 0
    with terminal_progress("parameter sets") as progress:

        def advance(count: int) -> None:
            nonlocal done
            done += count
            progress.update(done / max(total, 1), f"parameter sets {done}/{total}")

        yield advance


def _sensitivity(request: Study, options: StudyCommand) -> CommandResult:
    """Return Sobol indices over the range of each variable's values."""
    from model.studies import sobol_indices_of

    if options.out is not None or options.files.picture is not None:
        raise UsageError(
            "--sensitivity gives a table of indices; write it with --csv or --json, not --out or --picture"
        )
    if options.seed < 0:
        raise UsageError(f"--seed {options.seed}: give a number from 0 on")
    ranges = {name: (min(values), max(values)) for name, values in request.vary.items()}
    with (
        cluster_executor(options.cluster) as pool,
        _set_progress(max(options.samples, 0) * (len(ranges) + 2)) as advance,
    ):
        sobol = sobol_indices_of(
            request, ranges, options.samples, options.seed, CountingExecutor(pool, lambda sets: advance(len(sets)))
        )
    columns = [Column("output", "", sobol.outputs)]
    for order, indices in (("first", sobol.first_order), ("total", sobol.total_order)):
        columns += [
            Column(f"{order}_{v}", "", i, f"{order}, {v}", format_spec=".3f")
            for v, i in zip(sobol.variables, indices.T, strict=True)
        ]
    title = f"Sobol indices over {', '.join(f'{n} {a:g} to {b:g}' for n, (a, b) in ranges.items())} (SI)"
    note = "first: share of the variance the parameter explains alone; total: share that would vanish with a known parameter."
    return CommandResult(
        "study --sensitivity",
        request.fixed,
        (Table("sobol", title, tuple(columns), max_rows=20, leading_rows=2),),
        (note,),
    )


@command("example: tactor-bench figures --out figures --only fig9 --pdf", negative_values=True)
class FiguresCommand:
    """Draw the theory curves of the paper's figures. Where the claim of the text and the equations differ, the caption
    states it.
    """

    out: Path = option("folder to write to (default: figures)", Path("figures"), inherited=True)
    only: Sequence[str] = option("figure to draw, e.g. fig9; may be repeated", metavar="FIG")
    pdf: bool = option("PDF in addition to PNG")
    parameters: ParameterOptions = group(ParameterOptions)

    def execute(self) -> int:
        folder = self.out
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise UsageError(f"the folder {folder} cannot be made: {error.strerror}; choose another") from None
        with translate_model_errors():
            settings = self.parameters.settings
            specimen = read_specimen(SpecimenOptions(settings), on_membrane=True)
            if own := [name for name in ("delta", "contact_length", "k_s", "c_s") if name in read_settings(settings)]:
                raise UsageError(
                    f"--set {own[0]}: the figures define their own skin; vary it with 'tactor-bench study'"
                )
            everything = paper_figures(specimen.tactor, specimen.membrane)
        chosen = _select_panels(everything, self.only)
        suffixes = (".png", ".pdf") if self.pdf else (".png",)
        written = []
        for name, panels in track(list(chosen.items()), "drawing"):
            paths = [folder / f"{name}{suffix}" for suffix in suffixes]
            for path in paths:
                with writing_output(path):
                    draw_figure(panels, path)
            sheet = folder / f"{name}.csv"
            with writing_output(sheet):
                curves_table(panels).to_csv(sheet)
            files = [str(path) for path in (*paths, sheet)]
            written.append({"name": name, "files": files, "captions": {p.name: p.caption for p in panels}})
        if self.parameters.json:
            print_json({"command": "figures", "figures": written})
        return ExitCode.DONE


def _select_panels(all_panels: Sequence[PaperFigure], names: Sequence[str]) -> dict[str, list[PaperFigure]]:
    """Return the panels by figure, or single panels for the names of panels."""
    groups = {name: list(panels) for name, panels in groupby(all_panels, lambda figure: figure.name.rstrip("abcdef"))}
    if not names:
        return groups
    available = groups | {figure.name: [figure] for figure in all_panels}
    for name in names:
        if name not in available:
            raise UsageError(f"there is no figure '{name}'; there are: {', '.join(available)}")
    return {name: available[name] for name in names}


def curves_table(panels: Sequence[PaperFigure]) -> Table:
    """Return all curves of a figure as columns over its x, SI."""
    first = panels[0]
    columns = [Column(first.x_label, first.x_unit, first.curves[0].x)]
    for panel in panels:
        before = f"{panel.name} " if len(panels) > 1 else ""
        columns += [Column(before + curve.label, panel.y_unit, curve.y) for curve in panel.curves]
    return Table(first.name, first.name, tuple(columns))
