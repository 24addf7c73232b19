"""Colours for a light and a dark room; which one is the system's choice. Nothing is told by colour alone."""

from dataclasses import dataclass

from PySide6.QtCore import Qt
from PySide6.QtGui import QColor, QGuiApplication, QPalette

from app.sentences import Level
from app.view import BenchState, Lamp


@dataclass(frozen=True, slots=True)
class Theme:
    """Every colour of the window, as `#rrggbb`."""

    dark: bool
    window: str
    panel: str
    field: str
    line: str
    text: str
    dim: str
    accent: str
    model: str
    """The model's curve."""
    measured: str
    """Peak to peak, measured, and the displacement trace."""
    second: str
    """Twice the fundamental, measured, and the drive trace."""
    felt: str
    """The 50 um line."""
    good: str
    warn: str
    bad: str
    simulated: str
    """SIMULATED on a plot."""

    def state(self, state: BenchState) -> tuple[str, str]:
        """Ground and writing of the state sign."""
        match state:
            case BenchState.LIVE | BenchState.GOING_TO_REST | BenchState.ARMING | BenchState.PAUSED:
                return "#ffc400", "#000000"
            case BenchState.AT_REST:
                return "#1b7a3d", "#ffffff"
            case BenchState.UNSAFE:
                return "#c00018", "#ffffff"
            case _:
                return ("#3c424a", "#ffffff") if self.dark else ("#5b636d", "#ffffff")

    def lamp(self, lamp: Lamp) -> str:
        return {Lamp.READY: self.good, Lamp.WAITING: self.dim, Lamp.DOUBTED: self.warn, Lamp.ABSENT: self.bad}[lamp]

    def level(self, level: Level) -> str:
        return {Level.PLAIN: self.text, Level.GOOD: self.good, Level.ATTENTION: self.warn, Level.BAD: self.bad}[level]

    def palette(self) -> QPalette:
        """The theme as Qt's palette."""
        roles = QPalette.ColorRole
        palette = QPalette()
        for role, colour in (
            (roles.Window, self.window),
            (roles.WindowText, self.text),
            (roles.Base, self.field),
            (roles.AlternateBase, self.panel),
            (roles.Text, self.text),
            (roles.Button, self.panel),
            (roles.ButtonText, self.text),
            (roles.ToolTipBase, self.panel),
            (roles.ToolTipText, self.text),
            (roles.PlaceholderText, self.dim),
            (roles.Highlight, self.accent),
            (roles.HighlightedText, "#ffffff"),
            (roles.Link, self.accent),
            (roles.Light, self.panel),
            (roles.Midlight, self.line),
            (roles.Mid, self.line),
            (roles.Dark, self.line),
            (roles.BrightText, self.bad),
        ):
            palette.setColor(role, QColor(colour))
        for role in (roles.WindowText, roles.Text, roles.ButtonText):
            palette.setColor(QPalette.ColorGroup.Disabled, role, QColor(self.dim))
        return palette


LIGHT = Theme(
    dark=False,
    window="#f2f3f5",
    panel="#ffffff",
    field="#ffffff",
    line="#c9cdd3",
    text="#16191d",
    dim="#5d6570",
    accent="#1f5fbf",
    model="#1f5fbf",
    measured="#b3261e",
    second="#22262b",
    felt="#1b7a3d",
    good="#146c34",
    warn="#8a5a00",
    bad="#b00020",
    simulated="#d0021b",
)
DARK = Theme(
    dark=True,
    window="#15181c",
    panel="#1e2227",
    field="#23282e",
    line="#414851",
    text="#e8eaed",
    dim="#9aa3ad",
    accent="#3d78d0",
    model="#6ea8ff",
    measured="#ff8a80",
    second="#f4f5f6",
    felt="#6fd08c",
    good="#6fd08c",
    warn="#ffc46b",
    bad="#ff6b6b",
    simulated="#ff5a5a",
)


def system_theme() -> Theme:
    """What the system asks for; light where it does not say."""
    return DARK if QGuiApplication.styleHints().colorScheme() is Qt.ColorScheme.Dark else LIGHT
