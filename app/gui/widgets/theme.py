"""Light and dark colour theme, and the style sheet made from it.

The system or the user chooses the theme. Colour is never the only indication; sizes follow the system's font.
"""

import re
from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QObject, QSize, Qt, Signal
from PySide6.QtGui import QColor, QGuiApplication, QPalette

from app.common import Severity
from app.session import BenchState, Lamp


@dataclass(frozen=True, slots=True)
class Theme:
    """Every colour of the window, as `#rrggbb`."""

    dark: bool
    window: str
    panel: str
    field: str
    line: str
    text: str
    secondary_text: str
    accent: str
    model: str
    """The model's curve."""
    measured: str
    """Peak to peak, measured, and the displacement trace."""
    second: str
    """Twice the fundamental, measured, and the drive trace."""
    threshold: str
    """The 50 um perception threshold."""
    success: str
    warning: str
    error: str
    simulated: str
    """SIMULATED on a plot."""

    def state_colors(self, state: BenchState) -> tuple[str, str]:
        """Background and text colour of the state sign."""
        match state:
            case (
                BenchState.LIVE | BenchState.PAUSING | BenchState.GOING_TO_REST | BenchState.ARMING | BenchState.PAUSED
            ):
                return "#ffc400", "#000000"
            case BenchState.AT_REST:
                return "#1b7a3d", "#ffffff"
            case BenchState.UNSAFE | BenchState.DRIVE_LOST:
                return "#c00018", "#ffffff"
            case _:
                return ("#3c424a", "#ffffff") if self.dark else ("#5b636d", "#ffffff")

    def lamp_color(self, lamp: Lamp) -> str:
        return {
            Lamp.READY: self.success,
            Lamp.WAITING: self.secondary_text,
            Lamp.SUSPECT: self.warning,
            Lamp.MISSING: self.error,
        }[lamp]

    def passed_color(self, passed: bool) -> str:
        """Colour of a check that passed or failed."""
        return self.success if passed else self.error

    def severity_color(self, severity: Severity) -> str:
        return {
            Severity.INFO: self.text,
            Severity.SUCCESS: self.success,
            Severity.WARNING: self.warning,
            Severity.ERROR: self.error,
        }[severity]

    def palette(self) -> QPalette:
        """Return the theme as a Qt palette."""
        roles, palette = QPalette.ColorRole, QPalette()
        for colour, of in (
            (self.window, [roles.Window]),
            (self.field, [roles.Base]),
            (self.panel, [roles.AlternateBase, roles.Button, roles.ToolTipBase, roles.Light]),
            (self.text, [roles.WindowText, roles.Text, roles.ButtonText, roles.ToolTipText]),
            (self.secondary_text, [roles.PlaceholderText]),
            (self.accent, [roles.Highlight, roles.Link]),
            ("#ffffff", [roles.HighlightedText]),
            (self.line, [roles.Midlight, roles.Mid, roles.Dark]),
            (self.error, [roles.BrightText]),
        ):
            for role in of:
                palette.setColor(role, QColor(colour))
        for role in (roles.WindowText, roles.Text, roles.ButtonText):
            palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(self.secondary_text))
        return palette


COLORS = {
    "window": ("#f2f3f5", "#15181c"),
    "panel": ("#ffffff", "#1e2227"),
    "field": ("#ffffff", "#23282e"),
    "line": ("#c9cdd3", "#414851"),
    "text": ("#16191d", "#e8eaed"),
    "secondary_text": ("#5d6570", "#9aa3ad"),
    "accent": ("#1f5fbf", "#3d78d0"),
    "model": ("#1f5fbf", "#6ea8ff"),
    "measured": ("#b3261e", "#ff8a80"),
    "second": ("#22262b", "#f4f5f6"),
    "threshold": ("#1b7a3d", "#6fd08c"),
    "success": ("#146c34", "#6fd08c"),
    "warning": ("#8a5a00", "#ffc46b"),
    "error": ("#b00020", "#ff6b6b"),
    "simulated": ("#d0021b", "#ff5a5a"),
}
"""Every colour in the light and in the dark theme."""

LIGHT, DARK = (Theme(bool(at), **{name: pair[at] for name, pair in COLORS.items()}) for at in (0, 1))


class WindowTheme(QObject):
    """The theme in use in a window; widgets with colours of their own follow it."""

    changed = Signal(Theme)

    def __init__(self, colors: Theme = LIGHT, parent: QObject | None = None) -> None:
        super().__init__(parent)
        self.colors = colors

    def set_colors(self, colors: Theme) -> None:
        """Use other colours."""
        self.colors = colors
        self.changed.emit(colors)

    def follow(self, apply: Callable[[Theme], None]) -> None:
        """Call a method of a `QObject` with the colours, now and after every change."""
        apply(self.colors)
        self.changed.connect(apply)


APPEARANCES = {"system": "like the system", "light": "light", "dark": "dark"}
"""Choices of the theme, as they are stored in the settings."""


def theme_for(appearance: str) -> Theme:
    """Return the theme of a choice of `APPEARANCES`; the system's for anything else, and light if it has none."""
    is_dark = QGuiApplication.styleHints().colorScheme() is Qt.ColorScheme.Dark
    return {"light": LIGHT, "dark": DARK}.get(appearance, DARK if is_dark else LIGHT)


LARGE_WINDOW = QSize(1900, 1200)
LARGE_TEXT = 1.2


def text_scale(window: QSize) -> float:
    """Return by how much text is larger than usual in a window of a size: 1, or more on a large screen."""
    large = window.width() >= LARGE_WINDOW.width() and window.height() >= LARGE_WINDOW.height()
    return LARGE_TEXT if large else 1.0


def style_sheet(theme: Theme, scale: float = 1.0) -> str:
    """Return the style sheet; `scale` enlarges the text that is read at a desk, not the signs."""
    sheet = _style_sheet(theme)
    if scale == 1.0:
        return sheet
    base = f"QWidget {{ font-size: {scale * QGuiApplication.font().pointSizeF():.3g}pt; }}"
    return base + re.sub(r"([\d.]+)pt", lambda m: f"{scale * float(m[1]):.3g}pt", sheet)


def _style_sheet(theme: Theme) -> str:
    return f"""
    QToolTip {{ color: {theme.text}; background: {theme.panel}; border: 1px solid {theme.line}; padding: 4px; }}
    QLabel[kind="heading"], QLabel[kind="step"] {{ font-size: 15pt; font-weight: bold; }}
    QLabel[kind="step-why"] {{ font-size: 11pt; }}
    QLabel[kind="step-detail"] {{ font-size: 11pt; font-weight: bold; }}
    QLabel[kind="large"] {{ font-size: 11pt; }}
    QLabel[kind="welcome"] {{ font-size: 22pt; font-weight: bold; }}
    QLabel[kind="key"] {{
        background: {theme.field}; border: 1px solid {theme.secondary_text}; border-bottom-width: 2px; border-radius: 4px;
        padding: 1px 6px; font-weight: bold;
    }}
    QLabel[kind="command"] {{
        background: {theme.window}; border: 1px solid {theme.line}; border-radius: 4px; padding: 3px 8px;
        font-family: monospace;
    }}
    QLabel[kind="danger"] {{ color: {theme.error}; font-weight: bold; }}
    QLabel[kind="hint"] {{ color: {theme.text}; font-size: 11pt; }}
    QListWidget {{
        background: {theme.field}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 6px; outline: none;
        font-size: 11pt;
    }}
    QListWidget:focus {{ border: 2px solid {theme.accent}; }}
    QLabel[kind="running"] {{ font-size: 12pt; font-weight: bold; }}
    QLabel[kind="note"] {{ color: {theme.secondary_text}; font-size: 8.5pt; }}
    QLabel[kind="read-out"] {{
        background: {theme.panel}; border: 1px solid {theme.line}; border-radius: 3px; padding: 1px 5px;
    }}
    QLabel[kind="small"] {{ font-size: 8.5pt; }}
    QLabel[kind="value"] {{ font-size: 13pt; font-weight: bold; }}
    QLabel[kind="fault"] {{ color: {theme.error}; font-size: 9pt; }}
    QLabel[kind="caution"] {{ color: {theme.warning}; font-size: 9pt; }}
    QLabel[kind="caption"] {{ font-weight: bold; }}
    QLabel[kind="moved"] {{ color: {theme.accent}; font-weight: bold; }}
    QLabel[kind="note-size"] {{ color: {theme.secondary_text}; }}
    QLabel[kind="simulated"] {{
        color: {theme.simulated}; background: {theme.panel}; border: 4px solid {theme.simulated}; border-radius: 6px;
        font-size: 13pt; font-weight: bold; padding: 0 8px;
    }}
    QLabel[kind="simulated-mark"] {{ color: {theme.simulated}; font-weight: bold; }}
    QLineEdit, QPlainTextEdit {{
        background: {theme.field}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 4px; padding: 3px 5px;
        selection-background-color: {theme.accent}; selection-color: white;
    }}
    QLineEdit:focus, QPlainTextEdit:focus {{ border: 2px solid {theme.accent}; padding: 2px 4px; }}
    QLineEdit[kind="faulty"], QPlainTextEdit[kind="faulty"] {{ border: 2px solid {theme.error}; padding: 2px 4px; }}
    QLineEdit:disabled, QPlainTextEdit:disabled {{ color: {theme.secondary_text}; background: {theme.window}; }}
    QPushButton {{
        background: {theme.panel}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 5px; padding: 5px 12px;
    }}
    QPushButton:hover {{ border-color: {theme.accent}; }}
    QPushButton:focus {{ border: 2px solid {theme.accent}; padding: 4px 11px; }}
    QPushButton:disabled {{ color: {theme.secondary_text}; }}
    QPushButton[kind="choice"] {{ padding: 2px 9px; }}
    QPushButton[kind="choice"]:focus {{ padding: 1px 8px; }}
    QPushButton[kind="choice"]:checked {{ background: {theme.accent}; color: white; border-color: {theme.accent}; }}
    QPushButton[kind="choice"]:checked:focus {{ border-color: {theme.text}; }}
    QFrame[kind="ring"] {{ border: 2px solid {theme.accent}; border-radius: 4px; background: transparent; }}
    QToolButton[kind="tool"] {{
        background: {theme.panel}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 4px; padding: 3px 7px;
    }}
    QToolButton[kind="tool"]:hover {{ border-color: {theme.accent}; }}
    QToolButton[kind="tool"]:focus {{ border: 2px solid {theme.accent}; padding: 2px 6px; }}
    QToolButton[kind="tool"]:disabled {{ color: {theme.secondary_text}; }}
    QToolButton[popupMode="2"] {{ padding-right: 20px; }}
    QToolButton[popupMode="2"]:focus {{ padding-right: 19px; }}
    QToolButton::menu-indicator {{ subcontrol-origin: padding; subcontrol-position: right center; right: 5px; }}
    QPushButton[kind="go"] {{
        background: {theme.accent}; color: white; border: none; font-size: 12pt; font-weight: bold; padding: 9px 14px;
    }}
    QPushButton[kind="go"]:disabled {{ background: {theme.line}; color: {theme.secondary_text}; }}
    QPushButton[kind="go"]:focus {{ border: 2px solid {theme.text}; }}
    QPushButton[kind="stop"] {{
        background: #c00018; color: white; border: none; font-size: 13pt; font-weight: bold; padding: 0 14px;
    }}
    QPushButton[kind="stop"]:disabled {{ background: {theme.panel}; color: {theme.secondary_text}; border: 1px solid {theme.line}; }}
    QPushButton[kind="pause"] {{ font-size: 11pt; font-weight: bold; padding: 0 10px; border: 2px solid {theme.text}; }}
    QPushButton[kind="pause"]:disabled {{ color: {theme.secondary_text}; border: 1px solid {theme.line}; }}
    QLabel[kind="laser"] {{ font-size: 20pt; }}
    QProgressBar {{ background: {theme.field}; border: 1px solid {theme.line}; border-radius: 5px; }}
    QProgressBar::chunk {{ background: {theme.accent}; border-radius: 4px; }}
    QSplitter::handle {{ background: {theme.window}; }}
    QSplitter::handle:hover {{ background: {theme.line}; }}
    QScrollArea {{ border: none; background: transparent; }}
    QScrollArea:focus {{ border: 2px solid {theme.accent}; border-radius: 4px; }}
    QFrame[kind="panel"] {{ background: {theme.panel}; border: 1px solid {theme.line}; border-radius: 6px; }}
    QFrame[kind="broken"] {{ background: {theme.panel}; border: 4px dashed {theme.simulated}; border-radius: 6px; }}
    QFrame[kind="broken"] QLabel {{ color: {theme.simulated}; font-size: 11pt; font-weight: bold; }}
    QFrame[kind="prompt"] {{ background: #ffc400; border: none; border-radius: 6px; }}
    QFrame[kind="unsafe"] {{ background: #c00018; border: none; border-radius: 6px; }}
    QFrame[kind="toast"] {{ background: {theme.text}; border: none; border-radius: 6px; }}
    QFrame[kind="toast"] QLabel {{ color: {theme.window}; font-size: 11pt; }}
    QFrame[kind="trouble"] {{ background: {theme.panel}; border: 2px solid {theme.error}; border-radius: 6px; }}
    QFrame[kind="caution"] {{ background: {theme.panel}; border: 2px solid {theme.warning}; border-radius: 6px; }}
    QFrame[kind="caution"] QLabel, QFrame[kind="trouble"] QLabel {{ color: {theme.text}; font-size: 11pt; }}
    QFrame[kind="caution"] QLabel {{ color: {theme.warning}; font-weight: bold; }}
    QFrame[kind="caution"] QLabel[kind="detail"] {{ color: {theme.text}; font-weight: normal; }}
    QFrame[kind="caution"] QLabel[kind="detail"], QFrame[kind="trouble"] QLabel[kind="detail"] {{ font-size: 9pt; }}
    QFrame[kind="prompt"] QLabel {{ color: black; font-size: 17pt; font-weight: bold; }}
    QFrame[kind="unsafe"] QLabel {{ color: white; font-size: 14pt; font-weight: bold; }}
    QFrame[kind="unsafe"] QLabel[kind="detail"] {{ font-size: 9pt; font-weight: normal; }}
    QFrame[kind="prompt"] QPushButton {{ background: black; color: white; font-size: 13pt; font-weight: bold; padding: 9px 16px; }}
    QFrame[kind="prompt"] QPushButton[kind="stop"] {{ background: #c00018; }}
    QFrame[kind="prompt"] QPushButton:disabled {{ color: #a0a0a0; }}
    QFrame[kind="unsafe"] QPushButton {{ background: white; color: black; font-weight: bold; padding: 9px 16px; }}
    """
