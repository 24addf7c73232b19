"""Design tokens: every colour of the window by its meaning, for light and dark, and what follows a change of them."""

from collections.abc import Callable
from dataclasses import dataclass

from PySide6.QtCore import QEvent, QObject, Qt
from PySide6.QtGui import QColor, QGuiApplication, QPalette
from PySide6.QtWidgets import QWidget

from app.common import Severity

APPEARANCES = {"system": "like the system", "light": "light", "dark": "dark"}
"""Choices of the theme, as they are stored in the settings."""

LAYERS = ("#8a5a2b", "#5a6b9a", "#66741a"), ("#d9a066", "#9db0e6", "#b9c95a")


class Color:
    """One colour of the window, as `#rrggbb`, in the light and in the dark theme."""

    def __init__(self, light: str, dark: str) -> None:
        self._pair = light, dark

    def __get__(self, of: "Tokens", _: object) -> str:
        return self._pair[of.dark]


@dataclass(frozen=True, slots=True)
class Tokens:
    """Every colour of the window; text has a contrast of 4.5 on its ground, outlines and marks of 3."""

    dark: bool
    window = Color("#f2f4f7", "#12151a")
    """Page."""
    surface = Color("#ffffff", "#1b1f26")
    """Card and field."""
    sunken = Color("#e9ecf1", "#262c35")
    """Locked field, track of a bar."""
    text = Color("#12161c", "#edf0f4")
    text2 = Color("#505a68", "#a9b3c0")
    """Captions, axes, notes."""
    outline = Color("#7f8896", "#7f8a99")
    """Edge of a control."""
    line = Color("#d3d8e0", "#39414d")
    """Rule: decoration only."""
    accent = Color("#1a5fd0", "#2c6bdd")
    """Ground of what can be pressed, selection, focus; nothing else is blue. Its text is white."""
    accent_text = Color("#1a5fd0", "#7fb0ff")
    accent_tint = Color("#e6effc", "#1e2e4a")
    green = Color("#12703a", "#157a41")
    """At rest, good; its text is white."""
    green_text = Color("#0f6632", "#72d697")
    green_tint = Color("#e3f3e8", "#16301f")
    amber = Color("#ffc21a", "#ffc21a")
    """Live, attention; its text is black."""
    amber_text = Color("#7e4d00", "#ffcb57")
    amber_tint = Color("#fff2cc", "#3a2e0d")
    red = Color("#c4001a", "#c4001a")
    """STOP and danger; nothing else is red. Its text is white."""
    red_text = Color("#b00018", "#ff8f95")
    red_line = Color("#c4001a", "#ff8f95")
    grey = Color("#505a68", "#505a68")
    """Ground of the sign while nothing is known; its text is white."""
    violet = Color("#63399b", "#63399b")
    """SIMULATED, and the darker stripes of its hatch; its text is white."""
    violet2 = Color("#7650ac", "#7650ac")
    ink = Color("#12161c", "#edf0f4")
    """Measured data."""
    model = Color("#0a7a86", "#4cc3cf")
    """Computed data."""
    band = Color("#cbe6e8", "#1d4046")
    """Uncertainty of computed data."""
    sand = Color("#f6eedd", "#2b261b")
    """First region of a plot."""
    sand2 = Color("#ede0c4", "#383020")
    """Second region of a plot."""
    sand_text = Color("#6f5420", "#d9be86")

    @property
    def layers(self) -> tuple[str, ...]:
        """Of earlier runs, beside their shapes."""
        return LAYERS[self.dark]

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


COLORS = tuple(name for name, each in vars(Tokens).items() if isinstance(each, Color))
"""Names of the colours."""

LIGHT, DARK = Tokens(dark=False), Tokens(dark=True)

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
