"""Answer column of the Explore page: the model's largest response, large, and what a change does against a pinned curve."""

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QLabel, QWidget

from app.common import number_text, typeset
from app.explore import ExploreRequest, ExploreResult
from app.gui.results import rich_table
from app.gui.widgets import Item, column, make_label, make_panel, row
from model import Array
from model.response import PeriodicResponse


class AnswerColumn(QWidget):
    """Shows the answer of every result, and below it other parts.

    Args:
        site: chooses the place on the body.
        parts: below the answer.
    """

    def __init__(self, site: QWidget, *parts: Item) -> None:
        super().__init__()
        self.figure, self.natural, self.felt = (
            make_label(kind=kind, wrap=False, name=f"explore.answer.{name}")
            for name, kind in (("largest", "answer"), ("natural", "present"), ("felt", "present"))
        )
        self.about, self.times = make_label(kind="note"), make_label(kind="note")
        self.changes = make_label(name="explore.answer.changes", textFormat=Qt.TextFormat.RichText)
        self.changes_panel = make_panel(make_label("What the change does", "heading"), self.changes)
        answer = make_panel(
            row(make_label("Model, not measured", "pill", wrap=False), None),
            4,
            make_label("Largest response", "large"),
            _with_unit(self.figure, "µm"),
            self.about,
            8,
            make_label("Natural frequency", "large"),
            _with_unit(self.natural, "Hz"),
            8,
            row(make_label("Felt on", "large", wrap=False), site, None),
            _with_unit(self.felt, "Hz"),
            self.times,
            spacing=2,
        )
        column(answer, self.changes_panel, *parts, None, parent=self, spacing=12)

    def show_result(self, request: ExploreRequest, result: ExploreResult) -> None:
        """Show the answer; differences only with the pinned curves, which come later."""
        (_, um), (_, hz), (_, natural_hz), _ = _figures(request, result.curve, result.natural_hz[0])
        setting, bands = request.setting, result.felt_bands
        self.figure.setText(f"{um:.0f}")
        skin = "on skin" if setting.on_skin else "free"
        self.about.setText(f"at {hz:.0f} Hz, {skin}, {setting.peak_to_peak_v:.3g} V peak to peak")
        self.natural.setText(f"{natural_hz:.1f}")
        felt = ", ".join(f"{low:.0f} … {high:.0f}" for low, high in bands)
        self.felt.setText(felt or "nowhere")
        times = um / (1e6 * result.threshold_m[result.curve.peak_to_peak.argmax()])
        self.times.setText(f"{times:.1f} times the threshold at {hz:.0f} Hz")
        kept = result.kept_curves or ()
        self.changes_panel.setVisible(bool(request.kept_curves))
        if not kept:
            return
        before = _figures(request, kept[-1], result.natural_hz[len(kept)])
        rows = []
        for (name, now), (_, was) in zip(_figures(request, result.curve, natural_hz), before, strict=True):
            change = typeset(f"{100 * (now / was - 1):+.0f} %") if was else "–"
            rows.append((name, number_text(now, 4), number_text(was, 4), change))
        self.changes.setText(rich_table(rows, ("", "Now", request.kept_curves[-1].label, "")))


def _figures(request: ExploreRequest, curve: PeriodicResponse, natural_hz: float) -> tuple[tuple[str, float], ...]:
    """Return the compared quantities by name, in µm and Hz."""
    um: Array = 1e6 * curve.peak_to_peak
    top = int(um.argmax())
    at = int(abs(curve.frequency_hz - request.cursor_hz).argmin())
    return (
        ("Largest, µm", float(um[top])),
        ("Its frequency, Hz", float(curve.frequency_hz[top])),
        ("Natural frequency, Hz", natural_hz),
        (f"At {request.cursor_hz:.4g} Hz, µm", float(um[at])),
    )


def _with_unit(figure: QLabel, unit: str) -> Item:
    bottom = Qt.AlignmentFlag.AlignBottom
    return row((figure, 0, bottom), (make_label(unit, "unit", wrap=False), 0, bottom), None, spacing=8)
