"""What `tactor-bench figures` does: the paper's figures as PNG, PDF and CSV."""

import argparse
import json
from collections.abc import Sequence
from itertools import groupby
from pathlib import Path

from app.answer import Column, Table, say, tracked, writing
from app.drawing import draw
from app.exits import DONE, UsageError
from app.model_inputs import read_settings, read_specimen, refusing
from model.figures import Figure


def figures(options: argparse.Namespace) -> int:
    """`tactor-bench figures`."""
    from model.figures import figures as theory

    folder = options.out or Path("figures")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UsageError(f"the folder {folder} cannot be made: {error.strerror}; choose another") from None
    with refusing():
        specimen = read_specimen(options, on_membrane=True)
        if own := [
            name for name in ("delta", "contact_length", "k_s", "c_s") if name in read_settings(options.settings)
        ]:
            raise UsageError(f"--set {own[0]}: the figures choose their own skin; vary it with 'tactor-bench study'")
        everything = theory(specimen.tactor, specimen.membrane)
    chosen = _chosen(everything, options.only)
    suffixes = (".png", ".pdf") if options.pdf else (".png",)
    written = []
    for name, panels in tracked(list(chosen.items()), "drawing"):
        paths = [folder / f"{name}{suffix}" for suffix in suffixes]
        for path in paths:
            with writing(path):
                draw(panels, path)
        sheet = folder / f"{name}.csv"
        with writing(sheet):
            curves_table(panels).to_csv(sheet)
        files = [str(path) for path in (*paths, sheet)]
        written.append({"name": name, "files": files, "captions": {p.name: p.caption for p in panels}})
    if options.json:
        say(json.dumps({"command": "figures", "figures": written}))
    return DONE


def _chosen(everything: Sequence[Figure], only: Sequence[str] | None) -> dict[str, list[Figure]]:
    """Panels by the figure they belong to; one panel alone where its own name is asked for."""
    groups = {name: list(panels) for name, panels in groupby(everything, lambda figure: figure.name.rstrip("abcdef"))}
    if not only:
        return groups
    known = groups | {figure.name: [figure] for figure in everything}
    for name in only:
        if name not in known:
            raise UsageError(f"there is no figure '{name}'; there are: {', '.join(known)}")
    return {name: known[name] for name in only}


def curves_table(panels: Sequence[Figure]) -> Table:
    """All curves of a figure as columns over its x, SI."""
    first = panels[0]
    columns = [Column(first.x_label, first.x_unit, first.curves[0].x)]
    for panel in panels:
        before = f"{panel.name} " if len(panels) > 1 else ""
        columns += [Column(before + curve.label, panel.y_unit, curve.y) for curve in panel.curves]
    return Table(first.name, first.name, tuple(columns))
