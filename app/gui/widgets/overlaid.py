"""Widget with a message over its top that does not move what is below."""

from PySide6.QtCore import QEvent, QObject, QSize
from PySide6.QtGui import QResizeEvent
from PySide6.QtWidgets import QWidget

from app.gui.widgets.fitted_scroll_area import FittedScrollArea

MARGIN = 10


class Overlaid(QWidget):
    """Shows `base`, and `message` over its top while the message is visible."""

    def __init__(self, base: QWidget, message: QWidget) -> None:
        super().__init__()
        self._base, self._message = base, message
        base.setParent(self)
        self._area = FittedScrollArea(message, self)
        self._area.setVisible(not message.isHidden())
        message.installEventFilter(self)

    def sizeHint(self) -> QSize:
        return self._base.sizeHint()

    def minimumSizeHint(self) -> QSize:
        return self._base.minimumSizeHint()

    def resizeEvent(self, event: QResizeEvent) -> None:
        super().resizeEvent(event)
        self._base.setGeometry(self.rect())
        self._place_message()

    def eventFilter(self, watched: QObject, event: QEvent) -> bool:
        if event.type() in (QEvent.Type.ShowToParent, QEvent.Type.HideToParent, QEvent.Type.LayoutRequest):
            self._place_message()
        return super().eventFilter(watched, event)

    def _place_message(self) -> None:
        self._area.setVisible(not self._message.isHidden())
        width = self.width() - 2 * MARGIN
        self._area.setGeometry(MARGIN, 0, width, min(self._area.heightForWidth(width), self.height()))
        self._area.raise_()
