"""Message card: a sentence, its details, and the buttons that mend it or answer it."""

from PySide6.QtWidgets import QPushButton, QWidget

from app.gui.widgets import SELECTABLE, STRETCH, IconView, OverlayCard, column, make_label, row


class MessageCard(OverlayCard):
    """Hidden while its message is empty.

    Args:
        name: object name.
        icon: of the message.
        color: token of the colour of icon and edge.
        buttons: below the message.
        closable: whether Esc closes it when no run goes on.
    """

    def __init__(self, name: str, icon: str, color: str, *buttons: QPushButton, closable: bool = True) -> None:
        self.buttons = list(buttons)
        self.message_label = make_label(kind="heading", name=f"{name}.message", textInteractionFlags=SELECTABLE)
        self.detail_label = make_label(name=f"{name}.detail", textInteractionFlags=SELECTABLE, visible=False)
        content = QWidget()
        super().__init__(name, content, edge=color, closable=closable)
        texts = column(self.message_label, self.detail_label, spacing=4)
        column(
            row(IconView(28, icon, color), (texts, 1), spacing=16),
            row(44, *buttons, STRETCH, spacing=12),
            parent=content,
            margins=(20, 16, 20, 16),
            spacing=12,
        )

    def show_message(self, text: str, detail: str = "") -> None:
        """Show a message and its details; an empty message hides the card."""
        if (text, detail) != (self.message_label.text(), self.detail_label.text()):
            self.message_label.setText(text)
            self.detail_label.setText(detail)
        self.detail_label.setVisible(bool(detail))
        if not text:
            self.dismiss()
        elif self.isHidden():
            self.open()
