"""Look of the main window: light or dark, and the text size; both are stored and apply at once."""

from PySide6.QtCore import QObject, QSettings, QSize, Signal
from PySide6.QtGui import QGuiApplication
from PySide6.QtWidgets import QAbstractButton, QApplication, QLabel, QMainWindow

from app.gui.face import LEAST_WINDOW, TEXT_SIZES, install_fonts, px, rescale, style_sheet, tokens_for
from app.gui.widgets import show_key

FRAME_SIZE = QSize(4, 32)
"""Of the frame that a desktop draws around a window."""


class WindowLook(QObject):
    """Applies palette, style sheet and fonts.

    Args:
        window: whose look it is.
        settings: where the choices are stored.
    """

    text_size_changed = Signal()

    def __init__(self, window: QMainWindow, settings: QSettings) -> None:
        super().__init__(window)
        self._window, self._settings = window, settings
        self.appearance = str(settings.value("window/appearance", "system"))
        self.text_size = str(settings.value("window/text-size", "automatic"))
        install_fonts(TEXT_SIZES.get(self.text_size, 0))
        self._apply_colors()
        self._fit_least_size()
        QGuiApplication.styleHints().colorSchemeChanged.connect(self._apply_colors)

    def set_appearance(self, appearance: str) -> None:
        """Choose one of `APPEARANCES`, now and for later starts."""
        self.appearance = appearance
        self._settings.setValue("window/appearance", appearance)
        self._apply_colors()

    def set_text_size(self, choice: str) -> None:
        """Choose one of `TEXT_SIZES`, now and for later starts."""
        self.text_size = choice
        self._settings.setValue("window/text-size", choice)
        install_fonts(TEXT_SIZES[choice])
        for button in self._window.findChildren(QAbstractButton):
            if key := button.property("cap"):
                show_key(button, key)
        rescale(self._window)
        self._fit_least_size()
        self.text_size_changed.emit()

    def _apply_colors(self) -> None:
        colors = tokens_for(self.appearance)
        QApplication.setPalette(colors.palette())
        self._window.setStyleSheet(style_sheet(colors))
        for label in self._window.findChildren(QLabel):
            if "<a " in (text := label.text()):  # a link keeps the colour that it was read with
                label.clear()
                label.setText(text)

    def _fit_least_size(self) -> None:
        least = QSize(px(LEAST_WINDOW.width()), px(LEAST_WINDOW.height()))
        self._window.setMinimumSize(least.boundedTo(self._window.screen().availableSize() - FRAME_SIZE))
