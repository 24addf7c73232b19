"""Vector drawings: a matplotlib figure drawn once, kept as SVG for HTML and as operations of reportlab for a PDF page.

Drawing the ticks and texts of a figure takes matplotlib far longer than writing them to a file. All lengths are in points.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache, lru_cache
from importlib.util import find_spec
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from model import Array

CAPS, JOINS = {"butt": 0, "round": 1, "projecting": 2}, {"miter": 0, "round": 1, "bevel": 2}
"""Numbers of line ends and corners in PDF by their names in matplotlib."""

Operation = tuple[Any, ...]
"""Name and arguments of a method of reportlab's canvas; `setFont` has the file of a TrueType font."""


@dataclass(frozen=True, slots=True)
class VectorDrawing:
    """A drawn figure: the SVG element, and the operations that draw it; the origin is the lower left corner."""

    width: float
    height: float
    svg: str
    operations: tuple[Operation, ...]

    def paint(self, canvas: Any) -> None:
        """Draw on a canvas of reportlab, with the lower left corner at its origin."""
        for name, *arguments in self.operations:
            if name == "setFont":
                arguments[0] = embedded_font(arguments[0])
            getattr(canvas, name)(*arguments)


@cache
def matplotlib_folder() -> Path:
    """Return the folder of matplotlib without loading it, which is slow."""
    spec = find_spec("matplotlib")
    assert spec is not None
    assert spec.origin is not None
    return Path(spec.origin).parent


@lru_cache
def embedded_font(file: str) -> str:
    """Return reportlab's name of a TrueType font, which is embedded, so that texts can be searched and copied."""
    from reportlab.pdfbase.pdfmetrics import registerFont
    from reportlab.pdfbase.ttfonts import TTFont

    name = Path(file).stem
    registerFont(TTFont(name, file))
    return name


def _text_operations(text: str, place: tuple[float, float], angle_deg: float, font: Any, color: Any) -> list[Operation]:
    """Return the operations for a text whose baseline begins at a place."""
    from matplotlib.font_manager import findfont

    return [
        ("saveState",),
        ("setFillColorRGB", *map(float, color)),
        ("setFont", str(findfont(font)), float(font.get_size_in_points())),
        ("translate", *map(float, place)),
        *([("rotate", float(angle_deg))] if angle_deg else []),
        ("drawString", 0, 0, text),
        ("restoreState",),
    ]


def _path_operations(gc: Any, path: Any, places: Array, face: Any) -> Iterator[Operation]:
    """Yield the operations for a path, repeated at every one of `places`, shifts (N, 2); `gc` is its look in matplotlib."""
    from reportlab.pdfgen.pathobject import PDFPathObject

    *rgb, alpha = map(float, gc.get_rgb())
    whole = gc.get_alpha() if gc.get_forced_alpha() else None
    width = float(gc.get_linewidth())
    stroke = width > 0 and alpha > 0
    yield ("saveState",)
    if (clip := gc.get_clip_rectangle()) is not None:
        seen = PDFPathObject()
        seen.rect(*map(float, clip.bounds))
        yield "clipPath", seen, 0, 0
    if face is not None:
        fill_alpha = (face[3] if len(face) > 3 else 1.0) if whole is None else whole
        yield "setFillColorRGB", *map(float, face[:3]), float(fill_alpha)
    if stroke:
        yield "setStrokeColorRGB", *rgb, float(alpha if whole is None else whole)
        yield "setLineWidth", width
        yield "setLineCap", CAPS[gc.get_capstyle()]
        yield "setLineJoin", JOINS[gc.get_joinstyle()]
        offset, lengths = gc.get_dashes()
        if lengths:
            yield "setDash", [*map(float, lengths)], float(offset or 0)
    drawn = PDFPathObject()
    for place in places:
        _add_to_path(drawn, (path.vertices + place).tolist(), path.codes.tolist())
    yield "drawPath", drawn, stroke, face is not None
    yield ("restoreState",)


def _add_to_path(path: Any, vertices: list[list[float]], codes: list[int]) -> None:
    from matplotlib.path import Path as Outline

    i, here = 0, [0.0, 0.0]
    while i < len(codes):
        match codes[i]:
            case Outline.MOVETO:
                path.moveTo(*vertices[i])
            case Outline.LINETO:
                path.lineTo(*vertices[i])
            case Outline.CURVE3:  # as the cubic curve that it is
                middle, end = vertices[i], vertices[i + 1]
                first, second = ([a + 2 / 3 * (m - a) for a, m in zip(at, middle, strict=True)] for at in (here, end))
                path.curveTo(*first, *second, *end)
                i += 1
            case Outline.CURVE4:
                path.curveTo(*vertices[i], *vertices[i + 1], *vertices[i + 2])
                i += 2
            case Outline.CLOSEPOLY:
                path.close()
            case _:
                break
        here = vertices[i]
        i += 1


def draw_vectors(figure: Any, label: str) -> VectorDrawing:
    """Draw a figure once; `label` names it for screen readers."""
    import matplotlib as mpl

    figure.dpi = 72
    width, height = 72 * figure.get_size_inches()
    store = StringIO()
    with mpl.rc_context({"svg.hashsalt": "tactor-bench", "svg.fonttype": "none"}):
        renderer = _renderer_class()(width, height, store, metadata={"Date": None, "Creator": None})
        figure.draw(renderer)
        renderer.finalize()
    from html import escape

    text = store.getvalue()
    svg = text[text.index("<svg") :].replace("<svg ", f'<svg role="img" aria-label="{escape(label)}" ', 1)
    return VectorDrawing(float(width), float(height), svg, tuple(renderer.operations))


@lru_cache
def _renderer_class() -> Any:
    """Return the class of a renderer that writes SVG and records its drawing; made late, because matplotlib loads slowly."""
    from matplotlib.backend_bases import RendererBase
    from matplotlib.backends.backend_svg import RendererSVG
    from matplotlib.path import Path as Outline
    from matplotlib.transforms import Affine2D

    origin = np.zeros((1, 2))

    class Renderer(RendererSVG):  # type: ignore[misc, no-any-unimported, unused-ignore]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            plain: Any = super()
            plain.__init__(*arguments, **options)
            self.operations: list[Operation] = []

        def draw_path(self, gc: Any, path: Any, transform: Any, rgbFace: Any = None) -> None:
            plain: Any = super()
            plain.draw_path(gc, path, transform, rgbFace)
            seen = (0.0, 0.0, self.width, self.height) if rgbFace is None else None
            self.operations += _path_operations(gc, path.cleaned(transform, True, seen, simplify=path.should_simplify and rgbFace is None, curves=True), origin, rgbFace)  # fmt: skip

        def draw_markers(self, gc: Any, marker: Any, marker_transform: Any, path: Any, transform: Any, rgbFace: Any = None) -> None:  # fmt: skip
            plain: Any = super()
            plain.draw_markers(gc, marker, marker_transform, path, transform, rgbFace)
            places = transform.transform(path.vertices)
            self.operations += _path_operations(gc, marker.cleaned(marker_transform, curves=True), places[np.isfinite(places).all(axis=1)], rgbFace)  # fmt: skip

        def draw_path_collection(self, *arguments: Any, **options: Any) -> None:
            RendererBase.draw_path_collection(self, *arguments, **options)  # path by path

        def draw_text(self, gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False, mtext: Any = None) -> None:  # fmt: skip
            plain: Any = super()
            plain.draw_text(gc, x, y, s, prop, angle, ismath, mtext)
            below = self.height - y
            if ismath:
                vertices, codes = self._text2path.get_text_path(prop, s, ismath=ismath)
                outline = Outline(vertices, codes)
                place = (
                    Affine2D()
                    .scale(prop.get_size_in_points() / self._text2path.FONT_SCALE)
                    .rotate_deg(angle)
                    .translate(x, below)
                )
                gc.set_linewidth(0.0)
                self.operations += _path_operations(gc, outline.cleaned(place, curves=True), origin, gc.get_rgb())
                return
            self.operations += _text_operations(s, (x, below), angle, prop, gc.get_rgb())

    return Renderer
