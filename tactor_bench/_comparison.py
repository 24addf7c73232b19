"""Comparison of runs: curves in one relation to a reference, peaks, differences, picture and export."""

from collections.abc import Sequence
from pathlib import Path

from app.archive import Format
from app.comparison import (
    Comparison,
    ComparisonError,
    compare_files,
    draw_comparison,
    export_comparison,
    save_view,
)
from tactor_bench._run import MeasuredRun

__all__ = ["Comparison", "ComparisonError", "compare"]


def compare(
    runs: Sequence[str | Path | MeasuredRun] | str | Path,
    *,
    save: str | Path | None = None,
    picture: str | Path | None = None,
    export: tuple[Format, str | Path] | None = None,
    **view: object,
) -> Comparison:
    """Compare up to 20 runs.

    Args:
        runs: runs of a kind, or the file of a saved view.
        save: file in which the view is saved, `NAME.compare.json` beside the runs.
        picture: PNG, SVG or PDF file with the curves.
        export: format and folder for the shown values.
        **view: fields of the view: `quantity` (axes of the curves, such as `response over frequency`), `relation` (`values`, `normalised`,
            `difference`, `ratio`), `reference` (file name of a run; default the first), `over` (waterfall over `time`, `mass`,
            `elongation` or `amplitude`), `hidden` (file names), `model` (whether to add the model's curve).

    Returns:
        The comparison: `layers` with `series` in SI and total uncertainties, `peaks`, `differences`, `to_pandas()`.

    Raises:
        RunReadError: a run cannot be read.
        ComparisonError: they are too many, have no such quantity, a field of the view is wrong, or a file cannot be written.

    Example:
        >>> c = compare(["a.h5", "b.h5"], relation="ratio")  # doctest: +SKIP
        >>> c.layers[1].series.y, c.layers[1].series.total_errors  # doctest: +SKIP
        (array([0.98, 0.99]), array([0.004, 0.005]))
    """
    given = [runs] if isinstance(runs, str | Path) else runs
    comparison = compare_files([each.path if isinstance(each, MeasuredRun) else Path(each) for each in given], **view)
    if save is not None:
        save_view(comparison.view, Path(save))
    if picture is not None:
        draw_comparison(comparison, Path(picture))
    if export is not None:
        export_comparison(comparison, Path(export[1]), export[0])
    return comparison
