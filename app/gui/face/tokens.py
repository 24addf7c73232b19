"""Design tokens: every colour of the window by its meaning, for light and dark, and what follows a change of them."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QColor, QGuiApplication, QPalette
from PySide6.QtWidgets import QWidget

from app.common import Severity

APPEARANCES = {"system": "like the system", "light": "light", "dark": "dark"}
"""Choices of the theme, as they are stored in the settings."""


@dataclass(frozen=True, slots=True)
class Tokens:
    """Every colour of the window, as `#rrggbb`; text has a contrast of 4.5 on its ground, outlines and marks of 3."""

    dark: bool
    window: str
    """Page."""
    surface: str
    """Card and field."""
    sunken: str
    """Locked field, track of a bar."""
    text: str
    text2: str
    """Captions, axes, notes."""
    outline: str
    """Edge of a control."""
    line: str
    """Rule: decoration only."""
    accent: str
    """Ground of what can be pressed, selection, focus; nothing else is blue. Its text is white."""
    accent_text: str
    accent_tint: str
    green: str
    """At rest, good; its text is white."""
    green_text: str
    green_tint: str
    amber: str
    """Live, attention; its text is black."""
    amber_text: str
    amber_tint: str
    red: str
    """STOP and danger; nothing else is red. Its text is white."""
    red_text: str
    red_line: str
    grey: str
    """Ground of the sign while nothing is known; its text is white."""
    violet: str
    """SIMULATED, and the darker stripes of its hatch; its text is white."""
    violet2: str
    ink: str
    """Measured data."""
    model: str
    """Computed data."""
    band: str
    """Uncertainty of computed data."""
    layers: tuple[str, ...]
    """Earlier runs, beside their shapes."""
    sand: str
    """First region of a plot."""
    sand2: str
    """Second region of a plot."""
    sand_text: str

    def passed_color(self, passed: bool) -> str:
        """Text colour of a check that passed or failed."""
        return self.green_text if passed else self.red_text

    def severity_color(self, severity: Severity) -> str:
        """Text colour of a message."""
        return {
            Severity.INFO: self.text,
            Severity.SUCCESS: self.green_text,
            Severity.WARNING: self.amber_text,
            Severity.ERROR: self.red_text,
        }[severity]

    def palette(self) -> QPalette:
        """Return the colours as a Qt palette."""
        roles, palette = QPalette.ColorRole, QPalette()
        for colour, of in (
            (self.window, [roles.Window]),
            (self.surface, [roles.Base, roles.AlternateBase, roles.Button, roles.ToolTipBase, roles.Light]),
            (self.text, [roles.WindowText, roles.Text, roles.ButtonText, roles.ToolTipText]),
            (self.text2, [roles.PlaceholderText]),
            (self.accent, [roles.Highlight, roles.Accent]),
            (self.accent_text, [roles.Link]),
            ("#ffffff", [roles.HighlightedText]),
            (self.line, [roles.Midlight, roles.Mid, roles.Dark]),
            (self.red_text, [roles.BrightText]),
        ):
            for role in of:
                palette.setColor(role, QColor(colour))
        for role in (roles.WindowText, roles.Text, roles.ButtonText):
            palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(self.text2))
        return palette


COLORS: dict[str, tuple[str, str]] = {
    "window": ("#f2f4f7", "#12151a"),
    "surface": ("#ffffff", "#1b1f26"),
    "sunken": ("#e9ecf1", "#262c35"),
    "text": ("#12161c", "#edf0f4"),
    "text2": ("#505a68", "#a9b3c0"),
    "outline": ("#7f8896", "#7f8a99"),
    "line": ("#d3d8e0", "#39414d"),
    "accent": ("#1a5fd0", "#2c6bdd"),
    "accent_text": ("#1a5fd0", "#7fb0ff"),
    "accent_tint": ("#e6effc", "#1e2e4a"),
    "green": ("#12703a", "#157a41"),
    "green_text": ("#0f6632", "#72d697"),
    "green_tint": ("#e3f3e8", "#16301f"),
    "amber": ("#ffc21a", "#ffc21a"),
    "amber_text": ("#7e4d00", "#ffcb57"),
    "amber_tint": ("#fff2cc", "#3a2e0d"),
    "red": ("#c4001a", "#c4001a"),
    "red_text": ("#b00018", "#ff8f95"),
    "red_line": ("#c4001a", "#ff8f95"),
    "grey": ("#505a68", "#505a68"),
    "violet": ("#63399b", "#63399b"),
    "violet2": ("#7650ac", "#7650ac"),
    "ink": ("#12161c", "#edf0f4"),
    "model": ("#0a7a86", "#4cc3cf"),
    "band": ("#cbe6e8", "#1d4046"),
    "sand": ("#f6eedd", "#2b261b"),
    "sand2": ("#ede0c4", "#383020"),
    "sand_text": ("#6f5420", "#d9be86"),
}
"""Every colour in the light and in the dark theme."""

LAYERS = ("#8a5a2b", "#5a6b9a", "#66741a"), ("#d9a066", "#9db0e6", "#b9c95a")

LIGHT, DARK = (
    Tokens(bool(at), layers=LAYERS[at], **{name: pair[at] for name, pair in COLORS.items()}) for at in (0, 1)
)


PALETTE_CHANGES = QEvent.Type.PaletteChange, QEvent.Type.ApplicationPaletteChange


def tokens() -> Tokens:
    """Return the tokens in use: those of the application's palette."""
    return DARK if QGuiApplication.palette().color(QPalette.ColorRole.Window).lightness() < 128 else LIGHT


def tokens_for(appearance: str) -> Tokens:
    """Return the tokens of a choice of `APPEARANCES`; the system's for anything else, and light if it has none."""
    is_dark = QGuiApplication.styleHints().colorScheme() is Qt.ColorScheme.Dark
    return {"light": LIGHT, "dark": DARK}.get(appearance, DARK if is_dark else LIGHT)


def follow_tokens(widget: QWidget, apply: Callable[[Tokens], object]) -> None:
    """Call a function with the tokens, now and after every change of them: for colours that no style sheet reaches."""
    _TokenFollower(widget, apply)


class _TokenFollower(QObject):
    def __init__(self, widget: QWidget, apply: Callable[[Tokens], object]) -> None:
        super().__init__(widget)
        self._apply, self._applied = apply, tokens()
        widget.installEventFilter(self)
        apply(self._applied)

    def eventFilter(self, _watched: QObject, event: QEvent) -> bool:
        if event.type() in PALETTE_CHANGES and (now := tokens()) is not self._applied:
            self._applied = now
            self._apply(now)
        return False
