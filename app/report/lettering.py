"""How wide text is, where its lines break, and how wide the columns of a table must be; in inches."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

from app.report.blocks import Grid

LINE = 1.32
"""Line height over letter size."""
GAP = 0.12
"""Between two columns."""
STEP = 0.05
LARGEST, SMALLEST = 8.0, 6.0


@dataclass(frozen=True, slots=True)
class Row:
    """A table's row: the lines of each cell."""

    cells: tuple[tuple[str, ...], ...]
    height: float


@dataclass(frozen=True, slots=True)
class Set:
    """A table as it is set."""

    size: float
    left: tuple[float, ...]
    rows: tuple[Row, ...]

    @property
    def height(self) -> float:
        return sum(row.height for row in self.rows)


@lru_cache(maxsize=20_000)
def width_of(text: str, size: float, weight: str = "normal", family: str = "sans-serif") -> float:
    """Inches."""
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import text_to_path

    if not text:
        return 0.0
    prop = FontProperties(family=family, weight=weight, size=size)
    return float(text_to_path.get_text_width_height_descent(text, prop, False)[0]) / 72


def height_of(size: float) -> float:
    """Of one line, inches."""
    return LINE * size / 72


def wrapped(text: str, width: float, size: float, weight: str = "normal", family: str = "sans-serif") -> list[str]:
    """The lines of a text; a word that is wider than a line is broken anywhere."""
    lines, line = [], ""
    for each in text.split(" "):
        word = each
        longer = f"{line} {word}" if line else word
        if width_of(longer, size, weight, family) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        while width_of(word, size, weight, family) > width:
            cut = next((n for n in range(len(word) - 1, 1, -1) if width_of(word[:n], size, weight, family) <= width), 1)
            lines.append(word[:cut])
            word = word[cut:]
        line = word
    return [*lines, line]


def table_of(grid: Grid, width: float) -> Set:
    """Columns as wide as what stands in them; letters shrink a little and then words break where that is too wide."""
    every = (grid.heads, *grid.rows)
    family = "monospace" if grid.code else "sans-serif"
    columns = range(len(grid.heads))
    size = LARGEST
    while True:
        natural = [max(width_of(row[i], size, "bold", family) for row in every) for i in columns]
        if sum(natural) + GAP * (len(natural) - 1) <= width or size <= SMALLEST:
            break
        size -= 0.5
    least = [max(width_of(word, size, "bold", family) for row in every for word in row[i].split(" ")) for i in columns]
    widths = _squeezed(natural, least, width - GAP * (len(natural) - 1))
    rows = []
    for row in every:
        cells = tuple(
            tuple(wrapped(cell, w + 0.005, size, "bold", family)) for cell, w in zip(row, widths, strict=True)
        )
        rows.append(Row(cells, height_of(size) * max(map(len, cells)) + 0.05))
    left, x = [], 0.0
    for w in widths:
        left.append(x)
        x += w + GAP
    return Set(size, tuple(left), tuple(rows))


def _squeezed(natural: Sequence[float], least: Sequence[float], room: float) -> list[float]:
    """The widest columns give way until all fit, none below its longest word; where that is not enough, all alike."""
    widths = list(natural)
    while (over := sum(widths) - room) > 1e-9:
        free = [i for i, (w, low) in enumerate(zip(widths, least, strict=True)) if w > low + 1e-9]
        if not free:
            return [w * room / sum(widths) for w in widths]
        widest = max(free, key=lambda i: widths[i])
        widths[widest] = max(widths[widest] - min(over, STEP), least[widest])
    return widths
