"""Style sheet of the window, generated from the tokens.

It has colours, lines and paddings relative to the text, but no sizes: fonts and lengths follow from the text size
(`typeface`), so that no sheet is set when a window is resized.
"""

from string import Template

from app.gui.face.tokens import COLORS, Tokens

SHEET = Template("""
QToolTip { color: $text; background: $surface; border: 1px solid $outline; padding: 0.3em; }
QMenuBar { background: $surface; color: $text; border: none; }
QMenuBar::item { padding: 0.3em 0.7em; background: transparent; }
QMenuBar::item:selected { background: $accent_tint; }
QMenu { background: $surface; color: $text; border: 1px solid $outline; padding: 0.3em; }
QMenu::item { padding: 0.35em 1.6em 0.35em 1em; border-radius: 4px; }
QMenu::item:selected { background: $accent_tint; }
QMenu::item:disabled { color: $text2; }
QMenu::separator { height: 1px; background: $line; margin: 0.3em 0.5em; }
QMenu::indicator { width: 1em; height: 1em; }

QLabel[kind="note"], QLabel[kind="note-size"] { color: $text2; }
QLabel[kind="danger"], QLabel[kind="fault"] { color: $red_text; }
QLabel[kind="caution"], QLabel[tone="attention"] { color: $amber_text; }
QLabel[tone="good"] { color: $green_text; }
QLabel[tone="bad"] { color: $red_text; }
QLabel[kind="pill"] { background: $sunken; color: $text; border-radius: 8px; padding: 0.2em 0.7em; }
QLabel[kind="pill"][tone="good"] { background: $green; color: white; }
QLabel[kind="pill"][tone="attention"] { background: $amber; color: black; }
QLabel[kind="pill"][tone="bad"] { background: $red; color: white; }
QLabel[kind="moved"] { color: $accent_text; }
QLabel[kind="key"] {
    background: $sunken; color: $text2; border: 1px solid $outline; border-radius: 4px; padding: 0 0.3em;
}
QLabel[kind="command"] {
    background: $window; border: 1px solid $line; border-radius: 4px; padding: 0.2em 0.5em; font-family: monospace;
}
QLabel[kind="read-out"] { background: $surface; border: 1px solid $accent; border-radius: 6px; padding: 0.2em 0.5em; }
QLabel[kind="tag"] { background: $violet; color: white; border-radius: 4px; padding: 0.1em 0.5em; }

QLineEdit, QPlainTextEdit, QComboBox {
    background: $surface; color: $text; border: 1px solid $outline; border-radius: 6px; padding: 0.35em 0.5em;
    selection-background-color: $accent; selection-color: white;
}
QComboBox::drop-down { border: none; width: 1.6em; }
QComboBox QAbstractItemView {
    background: $surface; color: $text; border: 1px solid $outline; selection-background-color: $accent_tint;
    selection-color: $text;
}
QLineEdit:focus, QPlainTextEdit:focus, QComboBox:focus { border: 2px solid $accent_text; margin: -1px; }
QLineEdit[kind="faulty"], QPlainTextEdit[kind="faulty"] { border: 2px solid $red_line; margin: -1px; }
QLineEdit:disabled, QPlainTextEdit:disabled, QComboBox:disabled { color: $text2; background: $sunken; }

QPushButton, QToolButton[kind="tool"] {
    outline: none; background: $surface; color: $text; border: 1px solid $outline; border-radius: 6px; padding: 0.4em 0.9em;
}
QToolButton[kind="tool"] { padding: 0.3em 0.5em; }
QToolButton[popupMode="2"] { padding-right: 1.5em; }
QToolButton::menu-indicator { subcontrol-origin: padding; subcontrol-position: right center; right: 5px; }
QPushButton:hover, QToolButton[kind="tool"]:hover { border-color: $accent_text; }
QPushButton:disabled, QToolButton[kind="tool"]:disabled { color: $text2; background: $sunken; border-color: $line; }
QPushButton[kind="choice"] { padding: 0.2em 0.7em; }
QPushButton[kind="choice"]:checked { background: $accent; color: white; border-color: $accent; }
QPushButton[kind="chip"] { border-radius: 8px; padding: 0.15em 0.7em; color: $text2; border: 1px dashed $outline; }
QPushButton[kind="chip"]:checked { color: $text; border: 1px solid $outline; }
QPushButton[kind="tool"] { padding: 0.25em; border-color: transparent; background: transparent; }
QPushButton[kind="segment"] { border-radius: 0; padding: 0.35em 0.6em; margin: 0; }
QPushButton[kind="segment"]:checked { background: $accent; color: white; border-color: $accent; }
QPushButton[kind="segment"]:checked:focus { border: 2px solid $text; }
QPushButton[kind="link"] { background: transparent; color: $accent_text; border: 1px solid transparent; padding: 0.2em 0.4em; }
QPushButton[kind="go"] { background: $accent; color: white; border: 1px solid $accent; padding: 0.45em 1.1em; }
QPushButton[kind="go"]:disabled { background: $sunken; color: $text2; border-color: $line; }
QPushButton[kind="stop"] { background: $red; color: white; border: 1px solid $red; }
QPushButton:focus, QToolButton[kind="tool"]:focus { border: 2px solid $accent_text; margin: -1px; }
QPushButton[kind="choice"]:checked:focus, QPushButton[kind="go"]:focus { border: 2px solid $text; }
QGraphicsView { border: 2px solid $surface; }
QGraphicsView:focus { border: 2px solid $accent_text; }
QCheckBox:focus, QRadioButton:focus, QSlider:focus, QTabBar:focus {
    border: 2px solid $accent_text; border-radius: 4px;
}
QCheckBox, QRadioButton, QSlider { border: 2px solid transparent; }

QProgressBar { background: $line; border: none; border-radius: 2px; }
QProgressBar::chunk { background: $accent; border-radius: 2px; }
QSplitter::handle { background: $window; }
QSplitter::handle:hover { background: $line; }
QScrollArea { border: none; background: transparent; }
QScrollArea:focus { border: 2px solid $accent_text; border-radius: 4px; }
QListView, QTableView, QTreeView {
    background: $surface; color: $text; border: 1px solid $line; border-radius: 8px; outline: none;
    selection-background-color: $accent_tint; selection-color: $text; alternate-background-color: $surface;
}
QListView:focus, QTableView:focus, QTreeView:focus { border: 2px solid $accent_text; }
QHeaderView::section { background: $surface; color: $text2; border: none; border-bottom: 1px solid $line; padding: 0.3em; }
QScrollBar:vertical { background: transparent; width: 0.8em; margin: 0; }
QScrollBar:horizontal { background: transparent; height: 0.8em; margin: 0; }
QScrollBar::handle { background: $outline; border-radius: 3px; margin: 2px; min-height: 2em; min-width: 2em; }
QScrollBar::add-line, QScrollBar::sub-line { width: 0; height: 0; }
QScrollBar::add-page, QScrollBar::sub-page { background: transparent; }

QFrame[kind="panel"] { background: $surface; border: 1px solid $line; border-radius: 8px; }
QFrame[kind="band"] { background: $window; border: none; border-top: 1px solid $line; border-bottom: 1px solid $line; }
QFrame[kind="attention"] { background: $amber; border: none; border-top-left-radius: 9px; border-top-right-radius: 9px; }
QLabel[on="amber"] { color: black; }
QLabel[on="violet"] { color: white; }
QFrame[kind="rule"] { background: $line; border: none; }
QWidget[kind="bar"] { background: $surface; }
""")
"""With a place for each colour of the tokens, by its name."""


def style_sheet(tokens: Tokens) -> str:
    """Return the style sheet of the window."""
    return SHEET.substitute({name: getattr(tokens, name) for name in COLORS})
