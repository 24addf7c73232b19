"""`tactor-bench study`: the response for every combination of values, on this computer or a cluster; and what matters most."""

import argparse
import sys
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import replace
from math import prod
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.answer import Answer, Column, Table, check_files, deliver
from app.exits import FAILED, UsageError
from app.model_inputs import OFFSET, read_settings, read_specimen, read_values, read_vary, refusing
from app.study_answer import picture, record, result, summary
from app.units import PEAK_TO_PEAK, read_number
from app.workers import Counting, workers
from model.response import FREQUENCY
from model.specimen import changed
from model.study import PRESETS, Study
from protocols.storing import StoreError
from protocols.studyfile import StudyFile, StudyHeader, check_place

CURVE_HZ = "1:250:250"
MOST_SETS = 30
"""Combinations that are told on a terminal."""
MOST_NUMBERS = 50_000_000
"""Numbers that are held in memory for CSV, JSON or a picture; HDF5 is written chunk by chunk."""


def study(options: argparse.Namespace) -> int:
    """`tactor-bench study`."""
    with refusing():
        wanted = read_study(options)
        _check_places(options)
    try:
        with refusing():
            answer = _sensitivity(wanted, options) if options.sensitivity else _computed(wanted, options)
    except StoreError as error:
        sys.stderr.write(f"tactor-bench: {error}\n")
        return FAILED
    except KeyboardInterrupt:
        sys.stderr.write("tactor-bench: stopped; nothing was written\n")
        return FAILED
    return deliver(answer, options)


def read_study(options: argparse.Namespace) -> Study:
    """The study the options describe.

    Raises:
        UsageError, ParameterError: it cannot be computed.
    """
    vary = dict(map(read_vary, options.vary))
    if options.preset is None and not vary:
        raise UsageError(
            f"say what to study: a preset ({', '.join(PRESETS)}), or --vary NAME=VALUES, for example --vary delta=0:0.04:9"
        )
    if options.preset is not None and vary:
        raise UsageError(f"{options.preset} says itself what is varied; leave out --vary, or the preset")
    if options.preset is None:
        values = {name: v[0] for name, v in vary.items()}
        on_membrane = changed(read_specimen(options), values).membrane is not None
        base = Study(vary, (1.0,), read_specimen(options, on_membrane=on_membrane))
        frequencies = CURVE_HZ if options.frequencies is None else options.frequencies
    elif options.preset in PRESETS:
        base, frequencies = PRESETS[options.preset](), options.frequencies
        base = replace(base, specimen=changed(base.specimen, read_settings(options.settings)))
    else:
        raise UsageError(f"there is no study '{options.preset}'; the presets are: {', '.join(PRESETS)}")
    _check_overlap(base, options)
    return replace(
        base,
        frequency_hz=read_values(frequencies, FREQUENCY) if frequencies is not None else base.frequency_hz,
        measure=options.quantity or base.measure,
        amplitude_v=read_number(options.peak_to_peak, PEAK_TO_PEAK) / 2,
        offset_v=read_number(options.offset, OFFSET),
        n=base.n if options.n is None else options.n,
    )


def _check_overlap(base: Study, options: argparse.Namespace) -> None:
    """Refuse a value for what is varied: it would have no effect."""
    given = {f"--set {name}": name for name in read_settings(options.settings)}
    given |= {
        f"--{o}": "delta" for o in ("pre-stretch", "elongation") if getattr(options, o.replace("-", "_")) is not None
    }
    for option, name in given.items():
        if name in base.vary:
            raise UsageError(f"{name} is what the study varies; leave out {option}")
    if options.preset is not None and "delta" in given.values():
        raise UsageError(f"{options.preset} has its own pre-stretch; leave it out, or write the study with --vary")


def _check_places(options: argparse.Namespace) -> None:
    """Refuse now what could not be written in the end."""
    check_files(options)
    if options.out is not None:
        try:
            check_place(options.out)
        except StoreError as error:
            raise UsageError(str(error)) from None


def _computed(wanted: Study, options: argparse.Namespace) -> Answer:
    sets, points = prod(wanted.shape), len(wanted.frequency_hz)
    keep = options.csv is not None or options.picture is not None or options.json
    if keep and sets * points > MOST_NUMBERS:
        raise UsageError(
            f"the study has {sets * points:g} numbers, more than the {MOST_NUMBERS:g} that --csv, --picture and --json hold; "
            "write it with --out alone, or vary less"
        )
    rows = sets if keep else min(sets, MOST_SETS)
    kept: NDArray[Any] = np.empty((rows, points), complex if wanted.measure == "receptance" else float)
    running: Any = wanted.blocks
    with (
        _file(wanted, options.out) as write,
        workers(options.cluster) as pool,
        _progress(sets) as advance,
        closing(running(pool)) as blocks,
    ):
        for start, block in blocks:
            write(start, block)
            part = kept[start : start + len(block)]
            part[:] = block[: len(part)]
            advance(len(block))
    told = Table("summary", wanted.title, summary(wanted, np.abs(kept[:MOST_SETS])))
    notes = (
        [f"the first {MOST_SETS} of {sets} combinations; all of them with --out or --csv"] if sets > MOST_SETS else []
    )
    found = result(wanted, kept) if keep else None
    return Answer(
        "study",
        wanted.fixed,
        (told,),
        tuple(notes),
        curve=found,
        pictures=(picture(wanted, kept),) if options.picture is not None else (),
        more=record(found) if found is not None and options.json else {},
    )


@contextmanager
def _file(wanted: Study, path: Path | None) -> Iterator[Callable[[int, NDArray[Any]], None]]:
    """Where blocks go: into an HDF5 file, or nowhere."""
    if path is None:
        yield lambda *_: None
        return
    with StudyFile(path, StudyHeader.of(wanted)) as file:
        yield file.write
    sys.stderr.write(f"wrote {path}\n")


@contextmanager
def _progress(total: int) -> Iterator[Callable[[int], None]]:
    """A bar on a terminal that counts parameter sets."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    columns = (TextColumn("parameter sets"), BarColumn(None), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, disable=not console.is_terminal, transient=True) as progress:
        task = progress.add_task("", total=total)
        yield lambda done: progress.advance(task, done)


def _sensitivity(wanted: Study, options: argparse.Namespace) -> Answer:
    """Sobol indices over the range of each variable's values."""
    from model.sensitivity import sobol

    if options.out is not None or options.picture is not None:
        raise UsageError(
            "--sensitivity gives a table of indices; write it with --csv or --json, not --out or --picture"
        )
    seed = 1 if options.seed is None else options.seed
    if seed < 0:
        raise UsageError(f"--seed {seed}: give a number from 0 on")
    ranges = {name: (min(values), max(values)) for name, values in wanted.vary.items()}
    with workers(options.cluster) as pool, _progress(max(options.samples, 0) * (len(ranges) + 2)) as advance:
        got = sobol(wanted, ranges, options.samples, seed, Counting(pool, advance))
    columns = [Column("output", "", got.outputs)]
    for order, indices in (("first", got.first_order), ("total", got.total_order)):
        columns += [
            Column(f"{order}_{v}", "", i, f"{order}, {v}", form=".3f")
            for v, i in zip(got.variables, indices.T, strict=True)
        ]
    words = f"Sobol indices over {', '.join(f'{n} {a:g} to {b:g}' for n, (a, b) in ranges.items())} (SI)"
    note = "first: share of the variance the parameter explains alone; total: share that would vanish if it were known."
    return Answer(
        "study --sensitivity", wanted.fixed, (Table("sobol", words, tuple(columns), most=20, lead=2),), (note,)
    )
