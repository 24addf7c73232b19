"""Order of Tab: through the visible controls as the layouts show them, not as they were made."""

from collections.abc import Iterator
from typing import cast

from PySide6.QtCore import Qt
from PySide6.QtWidgets import QGridLayout, QLayout, QScrollArea, QSplitter, QWidget


class TabOrder(QWidget):
    """Content of a window in which Tab leads through the visible controls as the layouts show them, and brings them into view."""

    def focusNextPrevChild(self, forward: bool) -> bool:
        focused = self.focusWidget()
        order = [each for each in _in_order(self) if each is focused or _is_stop(each)]
        if not forward:
            order.reverse()
        at = order.index(focused) + 1 if focused in order else 0
        reached = next((each for each in order[at:] + order[:at] if each is not focused and _is_stop(each)), None)
        if reached is None:
            return False
        reached.setFocus(Qt.FocusReason.TabFocusReason if forward else Qt.FocusReason.BacktabFocusReason)
        above = reached.parentWidget()
        while above is not None:
            if isinstance(above, QScrollArea):
                above.ensureWidgetVisible(reached)
            above = above.parentWidget()
        return True


def _is_stop(widget: QWidget) -> bool:
    takes_tab = widget.focusPolicy() & Qt.FocusPolicy.TabFocus
    return bool(takes_tab) and widget.isEnabled() and widget.isVisible() and widget.focusProxy() is None


def _in_order(widget: QWidget) -> Iterator[QWidget]:
    """Yield a widget and the visible ones in it; of those in no layout, such as overlays, the topmost comes last."""
    yield widget
    within = [each for each in widget.children() if isinstance(each, QWidget) and not each.isHidden()]
    layout = widget.layout()
    at = {} if layout is None else {each: place for place, each in enumerate(_placed(layout))}
    if isinstance(widget, QSplitter):
        within.sort(key=widget.indexOf)
    for each in sorted(within, key=lambda each: at.get(each, len(at))):
        if not each.isWindow():
            yield from _in_order(each)


def _placed(layout: QLayout) -> Iterator[QWidget]:
    places = list(range(layout.count()))
    if isinstance(layout, QGridLayout):
        places.sort(key=lambda at: cast(tuple[int, ...], layout.getItemPosition(at)))  # row, column, spans
    for item in filter(None, map(layout.itemAt, places)):
        inner, widget = item.layout(), item.widget()
        if widget is not None:
            yield widget
        elif inner is not None:
            yield from _placed(inner)
