"""Named view of a comparison: a small JSON file beside the runs."""

import json
import re
from pathlib import Path
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from app.comparison.compared_run import MAX_RUNS, ComparisonError
from drivers import open_regular
from model import Relation
from protocols.base import replacing

VIEW_SUFFIX = ".compare.json"
Order = Literal["", "time", "mass", "elongation", "amplitude"]
ORDERS: tuple[Order, ...] = ("", "time", "mass", "elongation", "amplitude")


class ComparisonView(BaseModel):
    """What a comparison shows, and how; the file of a view holds exactly this."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    format: Literal["tactor-bench-comparison"] = "tactor-bench-comparison"
    runs: tuple[str, ...] = Field((), max_length=MAX_RUNS)
    """Run files in their order, relative to the folder of the view."""
    quantity: str = ""
    """Axes of the curves, such as `response over frequency`; empty: those that most runs have."""
    relation: Relation = Relation.VALUES
    reference: str = ""
    """Run file of the reference; empty: the first one."""
    over: Order = ""
    """Setting over which the curves stand above each other (waterfall); empty: all on one axis."""
    hidden: tuple[str, ...] = ()
    """Run files whose curves are not shown."""
    model: bool = False
    """Whether the model's curve with its band is shown."""
    cursors: tuple[float, ...] = Field((), max_length=2)
    """Places of the cursors, in the unit of the plot."""


def view_path(folder: Path, name: str) -> Path:
    """Return the file of a view.

    Raises:
        ComparisonError: the name has no letter or digit.
    """
    plain = re.sub(r"[^\w.+-]+", "-", name.removesuffix(VIEW_SUFFIX)).strip("-.")
    if not plain:
        raise ComparisonError(f"'{name}' is no name for a view; use letters and digits")
    return folder / f"{plain}{VIEW_SUFFIX}"


def views_in(folder: Path) -> list[str]:
    """Return the names of the views of a folder."""
    return sorted(path.name.removesuffix(VIEW_SUFFIX) for path in folder.glob(f"*{VIEW_SUFFIX}"))


def save_view(view: ComparisonView, path: Path) -> None:
    """Write a view; a view of the same name is replaced.

    Raises:
        ComparisonError: it cannot be written.
    """
    try:
        with replacing(path) as working:
            working.write_text(json.dumps(view.model_dump(mode="json"), indent=1, ensure_ascii=False), encoding="utf-8")
    except OSError as error:
        raise ComparisonError(f"{path} cannot be written: {error.strerror or error}; choose another folder") from None


def read_view(path: Path) -> ComparisonView:
    """Read a view.

    Raises:
        ComparisonError: it is missing, or not a view.
    """
    try:
        with open_regular(path) as file:
            return ComparisonView.model_validate_json(file.read())
    except OSError as error:
        there = ", ".join(views_in(path.parent)) or "none"
        raise ComparisonError(f"there is no view {path}: {error.strerror or error}; views there: {there}") from None
    except ValidationError as error:
        raise ComparisonError(f"{path} is not a view of a comparison: {view_problem(error)}; save it again") from None


def view_problem(error: ValidationError) -> str:
    """Return the first invalid field of a view and the reason."""
    first = error.errors()[0]
    given = "" if first["type"] in ("missing", "extra_forbidden") else f", not {first['input']!r}"
    return f"{'.'.join(map(str, first['loc'])) or 'the file'}: {first['msg']}{given}"
