"""Perception threshold that is chosen by a body site's name, an amplitude, a CSV file, or the laboratory file of a folder."""

from pathlib import Path

from app.common import UnitError, UsageError, read_number
from drivers import open_regular
from model.response import ABDOMEN_THRESHOLD, SITES, THRESHOLD_SPEC, PerceptionThreshold

MAX_LINES = 10_000


def chosen_threshold(folder: Path, text: str | None = None) -> PerceptionThreshold:
    """Return the threshold of an option, or else of the laboratory file in the folder of the runs, or else the abdomen's 50 µm.

    Raises:
        UsageError, ParameterError: as `read_threshold` and `read_laboratory`.
    """
    if text is not None:
        return read_threshold(text)
    from app.config import LABORATORY_FILE_NAME, read_laboratory  # slow to import, and needed without an option alone

    given = read_laboratory(folder).threshold
    if not given:
        return ABDOMEN_THRESHOLD
    try:
        return read_threshold(given)
    except UsageError as error:
        raise UsageError(f"{folder / LABORATORY_FILE_NAME}: {error}") from None


def read_threshold(text: str) -> PerceptionThreshold:
    """Return the perception threshold of a site, an amplitude such as `20 um` (max - min), or a CSV file.

    Raises:
        UsageError: none of these.
        ParameterError: a value is not positive, or the frequencies do not rise.
    """
    if text in SITES:
        return SITES[text]
    if text.lower().endswith(".csv"):
        return _read_curve(Path(text))
    try:
        amplitude_m = read_number(text, THRESHOLD_SPEC)
    except UnitError:
        raise UsageError(
            f"threshold '{text}': neither a site ({', '.join(SITES)}) nor an amplitude such as '20 um' nor a CSV file"
        ) from None
    return PerceptionThreshold((1.0,), (amplitude_m,), f"{1e6 * amplitude_m:g} µm", "given by hand")


def _read_curve(path: Path) -> PerceptionThreshold:
    """Return the curve of a file: frequency in Hz and threshold in µm, max - min, per line; a head and `#` lines are skipped."""
    try:
        with open_regular(path, "r", encoding="utf-8-sig") as file:
            lines = file.read(100 * MAX_LINES).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"threshold {path}: the file cannot be read: {error}") from None
    rows = [line.replace(";", ",").split(",") for line in lines if line.strip() and not line.startswith("#")]
    if rows and not _numbers(rows[0]):
        rows = rows[1:]  # the names of the columns
    pairs = [_numbers(row) for row in rows]
    if not pairs or any(len(pair) != 2 for pair in pairs):
        raise UsageError(
            f"threshold {path}: each line needs two numbers, the frequency in Hz and the threshold in µm, max - min"
        )
    frequency_hz, amplitude_um = zip(*pairs, strict=True)
    return PerceptionThreshold(frequency_hz, tuple(1e-6 * um for um in amplitude_um), path.stem, f"file {path.name}")


def _numbers(row: list[str]) -> tuple[float, ...]:
    try:
        return tuple(float(cell) for cell in row)
    except ValueError:
        return ()
