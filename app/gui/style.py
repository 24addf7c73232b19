"""The window's style sheet in a theme's colours; sizes follow the system's font, so that scaling reaches everything."""

from app.gui.theme import Theme


def sheet(theme: Theme) -> str:
    """The style sheet."""
    return f"""
    QToolTip {{ color: {theme.text}; background: {theme.panel}; border: 1px solid {theme.line}; padding: 4px; }}
    QLabel[kind="heading"] {{ font-size: 15pt; font-weight: bold; }}
    QLabel[kind="step"] {{ font-size: 19pt; font-weight: bold; }}
    QLabel[kind="step-why"] {{ font-size: 11pt; }}
    QLabel[kind="step-detail"] {{ font-size: 11pt; font-weight: bold; }}
    QLabel[kind="large"] {{ font-size: 11pt; }}
    QLabel[kind="welcome"] {{ font-size: 22pt; font-weight: bold; }}
    QLabel[kind="key"] {{
        background: {theme.field}; border: 1px solid {theme.dim}; border-bottom-width: 2px; border-radius: 4px;
        padding: 1px 6px; font-weight: bold;
    }}
    QLabel[kind="command"] {{
        background: {theme.window}; border: 1px solid {theme.line}; border-radius: 4px; padding: 3px 8px;
        font-family: monospace;
    }}
    QLabel[kind="danger"] {{ color: {theme.bad}; font-weight: bold; }}
    QLabel[kind="hint"] {{ color: {theme.text}; font-size: 11pt; }}
    QListWidget {{
        background: {theme.field}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 6px; outline: none;
        font-size: 11pt;
    }}
    QListWidget:focus {{ border: 2px solid {theme.accent}; }}
    QLabel[kind="running"] {{ font-size: 12pt; font-weight: bold; }}
    QLabel[kind="note"] {{ color: {theme.dim}; font-size: 8pt; }}
    QLabel[kind="small"] {{ font-size: 8pt; }}
    QLabel[kind="fault"] {{ color: {theme.bad}; font-size: 9pt; }}
    QLabel[kind="caution"] {{ color: {theme.warn}; font-size: 9pt; }}
    QLabel[kind="caption"] {{ font-weight: bold; }}
    QLabel[kind="moved"] {{ color: {theme.accent}; font-weight: bold; }}
    QLabel[kind="note-size"] {{ color: {theme.dim}; }}
    QLabel[kind="simulated"] {{
        color: {theme.simulated}; background: {theme.panel}; border: 4px solid {theme.simulated}; border-radius: 6px;
        font-size: 13pt; font-weight: bold; padding: 0 8px;
    }}
    QLineEdit, QPlainTextEdit {{
        background: {theme.field}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 4px; padding: 3px 5px;
        selection-background-color: {theme.accent}; selection-color: white;
    }}
    QLineEdit:focus, QPlainTextEdit:focus {{ border: 2px solid {theme.accent}; padding: 2px 4px; }}
    QLineEdit[kind="faulty"], QPlainTextEdit[kind="faulty"] {{ border: 2px solid {theme.bad}; padding: 2px 4px; }}
    QLineEdit:disabled, QPlainTextEdit:disabled {{ color: {theme.dim}; background: {theme.window}; }}
    QPushButton {{
        background: {theme.panel}; color: {theme.text}; border: 1px solid {theme.line}; border-radius: 5px; padding: 5px 12px;
    }}
    QPushButton:hover {{ border-color: {theme.accent}; }}
    QPushButton:focus {{ border: 2px solid {theme.accent}; padding: 4px 11px; }}
    QPushButton:disabled {{ color: {theme.dim}; }}
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
    QToolButton[kind="tool"]:disabled {{ color: {theme.dim}; }}
    QToolButton[popupMode="2"] {{ padding-right: 20px; }}
    QToolButton[popupMode="2"]:focus {{ padding-right: 19px; }}
    QToolButton::menu-indicator {{ subcontrol-origin: padding; subcontrol-position: right center; right: 5px; }}
    QPushButton[kind="go"] {{
        background: {theme.accent}; color: white; border: none; font-size: 12pt; font-weight: bold; padding: 9px 14px;
    }}
    QPushButton[kind="go"]:disabled {{ background: {theme.line}; color: {theme.dim}; }}
    QPushButton[kind="go"]:focus {{ border: 2px solid {theme.text}; }}
    QPushButton[kind="stop"] {{
        background: #c00018; color: white; border: none; font-size: 13pt; font-weight: bold; padding: 0 14px;
    }}
    QPushButton[kind="stop"]:disabled {{ background: {theme.panel}; color: {theme.dim}; border: 1px solid {theme.line}; }}
    QPushButton[kind="pause"] {{ font-size: 11pt; font-weight: bold; padding: 0 10px; border: 2px solid {theme.text}; }}
    QPushButton[kind="pause"]:disabled {{ color: {theme.dim}; border: 1px solid {theme.line}; }}
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
    QFrame[kind="trouble"] {{ background: {theme.panel}; border: 2px solid {theme.bad}; border-radius: 6px; }}
    QFrame[kind="prompt"] QLabel {{ color: black; font-size: 17pt; font-weight: bold; }}
    QFrame[kind="unsafe"] QLabel {{ color: white; font-size: 14pt; font-weight: bold; }}
    QFrame[kind="unsafe"] QLabel[kind="detail"] {{ font-size: 9pt; font-weight: normal; }}
    QFrame[kind="trouble"] QLabel {{ color: {theme.text}; font-size: 11pt; }}
    QFrame[kind="prompt"] QPushButton {{ background: black; color: white; font-size: 13pt; font-weight: bold; padding: 9px 16px; }}
    QFrame[kind="prompt"] QPushButton[kind="stop"] {{ background: #c00018; }}
    QFrame[kind="prompt"] QPushButton:disabled {{ color: #a0a0a0; }}
    QFrame[kind="unsafe"] QPushButton {{ background: white; color: black; font-weight: bold; padding: 9px 16px; }}
    """
