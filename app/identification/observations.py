"""Observations for an identification from run files: each protocol's aspects make them from its points."""

from collections.abc import Callable, Iterable, Sequence
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

from app.common import kept_table
from app.identification.duplicates import DuplicateFinder
from model import AmplifierMap, Mask, ParameterError
from model.identification import FitOptions, Observation, ObservationSet
from protocols import aspects_of, protocol_of_run
from protocols.aspects import RunPoints
from protocols.base import usable_mask
from protocols.runfile import CHECKED_FILES, Run, RunReadError, translate_read_errors

SIMULATED_SHAPE_COUNT = 7
"""Shape functions of a simulated tactor whose bench file states no number."""


class ObservationError(Exception):
    """Runs cannot be identified together; the message gives runs and reason."""


class _Head(NamedTuple):
    amplifier_map: AmplifierMap
    shape_count: int
    is_continuation: bool


def _head(path: Path) -> _Head:
    """Return what a fit needs of a run before its points; a file is opened once for it while it is unchanged."""
    try:
        stat = path.stat()
    except (OSError, ValueError):
        return _read_head(path, None)
    return _read_head(path, (stat.st_dev, stat.st_ino, stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns))


@lru_cache(maxsize=2000)
def _read_head(path: Path, _state: tuple[int, ...] | None) -> _Head:
    with Run(path) as run, translate_read_errors(path):
        return _Head(run.bench_record.amplifier_map, shape_count_of_run(run), run.resumed_from is not None)


def read_observations(
    paths: Sequence[Path],
    open_run: Callable[[Path], Run] = Run,
    track: Callable[[Sequence[Path]], Iterable[Path]] = iter,
) -> tuple[str, ObservationSet, list[str]]:
    """Return the specimen, its observations, and a message for each run without any; `open_run` may correct a run.

    `track` yields the paths and reports the progress.

    Raises:
        ObservationError: a file is not a run, the runs are of several specimens, or no point is usable.
    """
    with kept_table("files-in-order", CHECKED_FILES):
        return _read_observations(tuple(paths), open_run, track)


def _read_observations(
    paths: Sequence[Path], open_run: Callable[[Path], Run], track: Callable[[Sequence[Path]], Iterable[Path]]
) -> tuple[str, ObservationSet, list[str]]:
    """Return the result of `read_observations`."""
    specimens: dict[str, Path] = {}
    observations: list[Observation] = []
    left_out: list[str] = []
    finder = DuplicateFinder()
    for path in paths:
        with suppress(RunReadError):
            if _head(path).is_continuation:
                with open_run(path) as run, translate_read_errors(path):
                    finder.add_continuation(run)
    for path in track(paths):
        try:
            with open_run(path) as run:
                specimens.setdefault(run.setup.specimen, path)
                with translate_read_errors(run.path):
                    duplicate, message = finder.duplicates(run)
                taken = _read_run_observations(run, duplicate)
        except ParameterError as error:
            raise ObservationError(f"{path}: {error}") from error
        except RunReadError as error:
            raise ObservationError(str(error) if str(path) in str(error) else f"{path}: {error}") from error
        usable = [run for run in taken if run.usable.any()]
        observations += usable
        if message:
            left_out.append(message)
        elif not usable:
            left_out.append(f"{path.name} has no information on the model and is left out")
    if len(specimens) > 1:
        names = " and ".join(f"{name!r} ({path.name})" for name, path in specimens.items())
        raise ObservationError(f"these runs are of several specimens, {names}: identify one at a time")
    if not observations:
        raise ObservationError("none of these runs has a usable point with information on the model")
    try:
        return next(iter(specimens)), ObservationSet(tuple(observations)), left_out
    except ParameterError as error:
        raise ObservationError(str(error)) from error


def _read_run_observations(run: Run, duplicate: Mask) -> tuple[Observation, ...]:
    """Return the observations of a run without its duplicates; a value that is not physical is a ParameterError."""
    unphysical: ParameterError | None = None
    with translate_read_errors(run.path):
        try:
            return run_observations(run, duplicate)
        except ParameterError as error:
            unphysical = error
    raise unphysical


def amplifier_of(paths: Iterable[Path]) -> AmplifierMap:
    """Return the amplifier's map as it was in these runs: it is copied into every run file.

    Raises:
        RunReadError: a file is not a run.
        ObservationError: the runs were made with different maps.
    """
    with kept_table("files-in-order", CHECKED_FILES):
        maps = [_head(path).amplifier_map for path in paths]
    if any(each != maps[0] for each in maps):
        raise ObservationError(
            "these runs were made with differently configured amplifiers: identify them by themselves"
        )
    return maps[0] if maps else AmplifierMap()


def shape_count_of_file(path: Path) -> int:
    """Return the number of shape functions for a run: the simulation's, or enough for a real tactor."""
    return _head(path).shape_count


def shape_count_of_run(run: Run) -> int:
    """Return the number of shape functions for an open run."""
    record = run.bench_record
    if not record.simulated:
        return FitOptions.n
    return int(record.configuration.get("simulation", {}).get("modes", SIMULATED_SHAPE_COUNT))


def run_observations(run: Run, duplicate: Mask | None = None) -> tuple[Observation, ...]:
    """Return the observations of a run; none for protocols that do not concern the model.

    Args:
        run: an open run.
        duplicate: points that another run has, too, which are not usable; see `DuplicateFinder`.
    """
    points = points_of_run(run, duplicate)
    if not points.good.size:
        return ()
    aspects = aspects_of(run.setup.protocol)
    return tuple(each for part in points.by_temperature() for each in aspects.observations(part))


def points_of_run(run: Run, duplicate: Mask | None = None) -> RunPoints:
    """Return the points of an open run as the aspects of its protocol take them; arguments as in `run_observations`."""
    columns = run.points()
    good = usable_mask(columns["quality"])
    return RunPoints(
        run, columns, good if duplicate is None else good & ~duplicate, lambda: protocol_of_run(run, run.path.name)
    )


def short_run_name(label: str) -> str:
    """Return the protocol of the run of a label in short: `20261121T091502Z_T7_static-loading mfc` as `loading`."""
    protocol = label.rpartition("_")[2].split(" ")[0]
    return aspects_of(protocol).short_name or protocol
