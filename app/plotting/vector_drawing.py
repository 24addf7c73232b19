"""Vector drawings: a matplotlib figure drawn once, kept as SVG for HTML and as paths and texts for a PDF page (reportlab).

Drawing the ticks and texts of a figure takes matplotlib far longer than writing them to a file. All lengths are in points.
"""

from dataclasses import dataclass
from functools import lru_cache
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

from model import Array

Color = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class DrawnPath:
    """A path, repeated at every one of `places`; `codes` as in `matplotlib.path.Path`."""

    vertices: Array
    codes: Array
    places: Array
    """Shifts, (N, 2)."""
    stroke: Color | None
    fill: Color | None
    stroke_alpha: float
    fill_alpha: float
    width: float
    dashes: tuple[float, tuple[float, ...]]
    """Offset and lengths; no lengths for a solid line."""
    cap: int
    join: int
    clip: tuple[float, float, float, float] | None
    """Left, bottom, width and height of the rectangle that is seen."""


@dataclass(frozen=True, slots=True)
class DrawnText:
    """A text at the left end of its baseline; `font` is the file of a TrueType font."""

    text: str
    x: float
    y: float
    angle_deg: float
    font: str
    size: float
    color: Color
    alpha: float


@dataclass(frozen=True, slots=True)
class VectorDrawing:
    """A drawn figure: the SVG element, and its parts in drawing order; the origin is the lower left corner."""

    width: float
    height: float
    svg: str
    parts: tuple[DrawnPath | DrawnText, ...]

    def paint(self, canvas: Any) -> None:
        """Draw on a canvas of reportlab, with the lower left corner at its origin."""
        for part in self.parts:
            canvas.saveState()
            if isinstance(part, DrawnText):
                _paint_text(canvas, part)
            else:
                _paint_path(canvas, part)
            canvas.restoreState()


@lru_cache
def embedded_font(file: str) -> str:
    """Return reportlab's name of a TrueType font, which is embedded, so that texts can be searched and copied."""
    from reportlab.pdfbase.pdfmetrics import registerFont
    from reportlab.pdfbase.ttfonts import TTFont

    name = Path(file).stem
    registerFont(TTFont(name, file))
    return name


def _paint_text(canvas: Any, part: DrawnText) -> None:
    canvas.setFillColorRGB(*part.color, alpha=part.alpha)
    canvas.setFont(embedded_font(part.font), part.size)
    canvas.translate(part.x, part.y)
    if part.angle_deg:
        canvas.rotate(part.angle_deg)
    canvas.drawString(0, 0, part.text)


def _paint_path(canvas: Any, part: DrawnPath) -> None:
    if part.clip is not None:
        seen = canvas.beginPath()
        seen.rect(*part.clip)
        canvas.clipPath(seen, stroke=0, fill=0)
    if part.fill is not None:
        canvas.setFillColorRGB(*part.fill, alpha=part.fill_alpha)
    if part.stroke is not None:
        canvas.setStrokeColorRGB(*part.stroke, alpha=part.stroke_alpha)
        canvas.setLineWidth(part.width)
        canvas.setLineCap(part.cap)
        canvas.setLineJoin(part.join)
        if part.dashes[1]:
            canvas.setDash(list(part.dashes[1]), part.dashes[0])
    path = canvas.beginPath()
    for place in part.places:
        _add_to_path(path, (part.vertices + place).tolist(), part.codes.tolist())
    canvas.drawPath(path, stroke=part.stroke is not None, fill=part.fill is not None)


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
    return VectorDrawing(float(width), float(height), svg, tuple(renderer.parts))


@lru_cache
def _renderer_class() -> Any:
    """Return the class of a renderer that writes SVG and keeps what it was asked to draw; made late, as matplotlib loads slowly."""
    from matplotlib.backend_bases import RendererBase
    from matplotlib.backends.backend_svg import RendererSVG
    from matplotlib.font_manager import findfont
    from matplotlib.path import Path as Outline
    from matplotlib.transforms import Affine2D

    origin = np.zeros((1, 2))
    caps, joins = {"butt": 0, "round": 1, "projecting": 2}, {"miter": 0, "round": 1, "bevel": 2}

    class Renderer(RendererSVG):  # type: ignore[misc, no-any-unimported, unused-ignore]
        def __init__(self, *arguments: Any, **options: Any) -> None:
            plain: Any = super()
            plain.__init__(*arguments, **options)
            self.parts: list[DrawnPath | DrawnText] = []

        def draw_path(self, gc: Any, path: Any, transform: Any, rgbFace: Any = None) -> None:
            plain: Any = super()
            plain.draw_path(gc, path, transform, rgbFace)
            seen = (0.0, 0.0, self.width, self.height) if rgbFace is None else None
            self._keep(gc, path.cleaned(transform, True, seen, simplify=path.should_simplify and rgbFace is None, curves=True), origin, rgbFace)  # fmt: skip

        def draw_markers(self, gc: Any, marker: Any, marker_transform: Any, path: Any, transform: Any, rgbFace: Any = None) -> None:  # fmt: skip
            plain: Any = super()
            plain.draw_markers(gc, marker, marker_transform, path, transform, rgbFace)
            places = transform.transform(path.vertices)
            self._keep(gc, marker.cleaned(marker_transform, curves=True), places[np.isfinite(places).all(axis=1)], rgbFace)  # fmt: skip

        def draw_path_collection(self, *arguments: Any, **options: Any) -> None:
            RendererBase.draw_path_collection(self, *arguments, **options)  # path by path

        def draw_text(self, gc: Any, x: float, y: float, s: str, prop: Any, angle: float, ismath: Any = False, mtext: Any = None) -> None:  # fmt: skip
            plain: Any = super()
            plain.draw_text(gc, x, y, s, prop, angle, ismath, mtext)
            size, below = prop.get_size_in_points(), self.height - y
            if ismath:
                vertices, codes = self._text2path.get_text_path(prop, s, ismath=ismath)
                outline = Outline(vertices, codes)
                place = Affine2D().scale(size / self._text2path.FONT_SCALE).rotate_deg(angle).translate(x, below)
                gc.set_linewidth(0.0)
                self._keep(gc, outline.cleaned(place, curves=True), origin, gc.get_rgb())
                return
            *rgb, alpha = gc.get_rgb()
            self.parts.append(DrawnText(s, float(x), float(below), float(angle), str(findfont(prop)), float(size), tuple(rgb), float(alpha)))  # fmt: skip

        def _keep(self, gc: Any, path: Any, places: Array, face: Any) -> None:
            red, green, blue, alpha = gc.get_rgb()
            whole = gc.get_alpha() if gc.get_forced_alpha() else None
            clip = gc.get_clip_rectangle()
            offset, lengths = gc.get_dashes()
            width = float(gc.get_linewidth())
            self.parts.append(
                DrawnPath(
                    path.vertices,
                    np.asarray(path.codes),
                    places,
                    (red, green, blue) if width > 0 and alpha > 0 else None,
                    None if face is None else (float(face[0]), float(face[1]), float(face[2])),
                    float(alpha if whole is None else whole),
                    float((face[3] if face is not None and len(face) > 3 else 1.0) if whole is None else whole),
                    width,
                    (float(offset or 0), () if lengths is None else tuple(map(float, lengths))),
                    caps[gc.get_capstyle()],
                    joins[gc.get_joinstyle()],
                    None if clip is None else tuple(map(float, clip.bounds)),  # type: ignore[arg-type]
                )
            )

    return Renderer
