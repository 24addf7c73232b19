"""Pictures of model curves: a figure of the paper, or its panels side by side (matplotlib)."""

import re
import textwrap
from collections.abc import Callable, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

from app.plotting.panels import new_figure
from model import shown_unit
from model.response import ABDOMEN_THRESHOLD, THRESHOLD_M
from model.studies import PaperFigure

MAX_LABELS_INSIDE = 6
"""Largest number of lines with a legend inside the axes."""

TYPESET_UNITS = {"kg^-1/2": "kg$^{-1/2}$", "N/m^2": "N/m²"}
CONVERTED_UNITS = ("m", "s", "kg")
"""Units that are drawn in their display unit."""
LINE_STYLES: Sequence[dict[str, Any]] = (
    {"color": "tab:blue", "ls": "-"},
    {"color": "tab:red", "ls": "--"},
    {"color": "black", "ls": "-."},
    {"color": "saddlebrown", "ls": (0, (1, 1))},
    {"color": "tab:green", "ls": (0, (1, 3))},
    {"color": "tab:purple", "ls": "-"},
    {"color": "tab:orange", "ls": "--"},
    {"color": "tab:cyan", "ls": "-."},
)
"""The paper's colors and dashes for Figs. 10 to 12, and three more."""

SYMBOL_SUBSTITUTIONS: Sequence[tuple[str, str | Callable[[re.Match[str]], str]]] = (
    (r"\b1e\+?(-?)0*(\d+)\b", lambda m: f"$10^{{{m[1]}{m[2]}}}$"),
    (r"\bc_s\^delta\b", r"$c_s^{\\delta}$"),
    (r"\bc_s\^0\b", r"$c_s^0$"),
    (r"\bc_bar\b", r"$\\bar{c}$"),
    (r"\b(delta|eta)\b", lambda m: rf"$\{m[1]}$"),
    (r"\b([EckwL]_[a-z]+|m_add)\b", lambda m: f"${m[1][0]}_{{{m[1][2:]}}}$"),
    (r"\bk([12])(\^2)?", lambda m: f"$k_{m[1]}{m[2] or ''}$"),
    (r"\bL2\b", "$L_2$"),
    (r"\bum\b", "µm"),
    (r"(?<=\d)\.\.(?=\d)", " to "),
)


def draw_figure(panels: Sequence[PaperFigure], path: Path, log: bool = False) -> None:
    """Draw a figure, or the panels of one, with the captions below.

    Raises:
        OSError, ValueError: the file cannot be written, or its suffix is unknown.
    """
    count = len(panels)
    columns = 1 if count == 1 else 3 if count > 2 else 2
    rows = -(-count // columns)
    width = 8.0 if columns == 1 else 4.7 * columns
    height = (5.0 if columns == 1 else 3.7) * rows + 0.9
    sheet = new_figure(figsize=(width, height), dpi=120, layout="constrained")
    alike = len({(p.y_label, p.y_unit, p.x_label) for p in panels}) == 1
    grid = sheet.subplots(rows, columns, squeeze=False, sharey=alike)
    titles, caption = _captions(panels)
    labels = {tuple(curve.label for curve in panel.curves) for panel in panels}
    for i, (axes, panel, title) in enumerate(zip(grid.flat, panels, titles, strict=False)):
        _draw_panel(axes, panel, log)
        if len(axes.lines) > 1 and (len(labels) > 1 or panel is panels[-1]):  # one legend, where it is the same for all
            outside = {"loc": "upper left", "bbox_to_anchor": (1, 1)} if len(axes.lines) > MAX_LABELS_INSIDE else {}
            axes.legend(fontsize=8.5, **outside)
        axes.set_title("\n".join(textwrap.wrap(title, 52)), fontsize=10)
        if alike and i % columns:
            axes.set_ylabel("")
    letters = round(width * 15.5)
    sheet.supxlabel("\n".join(textwrap.wrap(caption, letters)), x=0.01, ha="left", fontsize=8.5, linespacing=1.3)
    sheet.savefig(path)


def _draw_panel(axes: Any, panel: PaperFigure, log: bool) -> None:
    x_scale, x_unit = (1e3, "mm") if panel.x_unit == "m" else _axis_unit(panel.x_unit)
    in_mm = panel.y_unit == "m" and max(float(abs(curve.y).max()) for curve in panel.curves) > 2e-3
    y_scale, y_unit = (1e3, "mm") if in_mm else _axis_unit(panel.y_unit)
    for line, curve in zip(cycle(LINE_STYLES), panel.curves, strict=False):
        axes.plot(curve.x * x_scale, curve.y * y_scale, lw=1.5, label=typeset_symbols(curve.label), **line)
    axes.set(xlabel=_axis_label(panel.x_label, x_unit), ylabel=_axis_label(panel.y_label, y_unit))
    x = [value * x_scale for curve in panel.curves for value in (curve.x.min(), curve.x.max())]
    if max(x) > min(x):
        axes.set_xlim(min(x), max(x))
    if log:
        axes.set_yscale("log")
    elif all((curve.y >= 0).all() for curve in panel.curves):
        axes.set_ylim(0, None)
    if panel.x_unit in ("Hz", "s") and panel.y_unit == "m":
        axes.axhline(THRESHOLD_M * y_scale, color="gray", lw=1, label=ABDOMEN_THRESHOLD.line_label)
    axes.grid(alpha=0.25)


def _axis_unit(unit: str) -> tuple[float, str]:
    return shown_unit(unit) if unit in CONVERTED_UNITS else (1.0, TYPESET_UNITS.get(unit, unit))


def _axis_label(text: str, unit: str) -> str:
    return typeset_symbols(text) + (f" ({unit})" if unit else "")


def _captions(panels: Sequence[PaperFigure]) -> tuple[list[str], str]:
    """Return the panel titles and one caption: sentences common to all panels first, then sentences of single panels."""
    if len(panels) == 1:
        return [""], typeset_symbols(panels[0].caption)
    sentences = [re.split(r"(?<=\.) (?=[A-Z])", panel.caption) for panel in panels]
    titles, rest = [s[0].rstrip(".") for s in sentences], [s[1:] for s in sentences]
    start = _common_prefix(titles)
    common = [sentence for sentence in rest[0] if all(sentence in r for r in rest)]
    letters = [f"({'abcdefgh'[i]})" for i in range(len(panels))]
    alone = [
        f"{letter} {' '.join(sentence for sentence in r if sentence not in common)}"
        for letter, r in zip(letters, rest, strict=True)
        if set(r) - set(common)
    ]
    heading = [f"{start.rstrip(', ')}."] if start else []
    return (
        [f"{letter} {typeset_symbols(title[len(start) :])}" for letter, title in zip(letters, titles, strict=True)],
        typeset_symbols(" ".join((*heading, *common, *alone))),
    )


def _common_prefix(titles: Sequence[str]) -> str:
    """Return the common start of all titles, up to a comma."""
    start = titles[0].rpartition(", ")[0]
    return f"{start}, " if start and all(title.startswith(f"{start}, ") for title in titles) else ""


def typeset_symbols(text: str) -> str:
    """Return text with symbols and powers of ten as matplotlib math text."""
    for pattern, symbol in SYMBOL_SUBSTITUTIONS:
        text = re.sub(pattern, symbol, text)
    return text
