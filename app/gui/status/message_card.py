"""Message card: a sentence, and the buttons that mend it or answer it."""

from PySide6.QtWidgets import QPushButton, QWidget

from app.gui.widgets import SELECTABLE, IconView, OverlayCard, column, make_label, row


class MessageCard(OverlayCard):
    """Hidden while its message is empty.

    Args:
        name: object name.
        icon: of the message.
        color: token of the colour of icon and edge.
        buttons: below the message.
    """

    def __init__(self, name: str, icon: str, color: str, *buttons: QPushButton) -> None:
        self.buttons = list(buttons)
        self.message_label = make_label(kind="heading", name=f"{name}.message", textInteractionFlags=SELECTABLE)
        content = QWidget()
        super().__init__(name, content, edge=color)
        column(
            row(IconView(28, icon, color), (self.message_label, 1), spacing=16),
            row(44, *buttons, None, spacing=12),
            parent=content,
            margins=(20, 16, 20, 16),
            spacing=12,
        )

    def show_message(self, text: str) -> None:
        """Show a message; an empty one hides the card."""
        self.message_label.setText(text)
        if not text:
            self.dismiss()
        elif self.isHidden():
            self.open()
