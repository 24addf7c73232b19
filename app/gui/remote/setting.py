"""Setting of the read-only web page: who can read it, its address, and the address as a QR code; below it the stop of the present run."""

import io

import segno
from PySide6.QtCore import Qt
from PySide6.QtGui import QPixmap
from PySide6.QtWidgets import QLabel, QWidget

from app.gui.remote.controller import MODES, NETWORK, RemoteController
from app.gui.widgets import SELECTABLE, column, configure, make_button, make_combo, make_label, show_text

MODULE_PIXELS = 5
DESCRIPTION = (
    "State, voltage, points and next step for a phone or a second screen; nothing can be commanded there. In a network the address has a token that "
    "no other page and no log contains; the connection is not encrypted. During an unattended run with stop_from_phone its stop has an address here."
)


class RemoteSetting(QWidget):
    """Editor of the settings page."""

    def __init__(self, remote: RemoteController) -> None:
        super().__init__()
        self._remote = remote
        self.mode = make_combo("settings.remote.mode", "web page", ((text, name) for name, text in MODES.items()))
        self.mode.setCurrentIndex(self.mode.findData(remote.mode))
        self.address, self.stop_address = (
            make_label(name=f"settings.remote.{name}", textInteractionFlags=SELECTABLE)
            for name in ("address", "stop-address")
        )
        centre = Qt.AlignmentFlag.AlignCenter
        self.code, self.stop_code = (
            configure(
                QLabel(), f"settings.remote.{name}", accessibleName=f"address of {of} as a QR code", alignment=centre
            )
            for name, of in (("code", "the web page"), ("stop-code", "the stop of this run"))
        )
        tip = "Addresses with the present token are no longer valid"
        self.renew_button = make_button("New token", remote.renew_token, "choice", tip, "settings.remote.renew")
        parts = (self.mode, self.address, self.code, self.renew_button, self.stop_address, self.stop_code)
        column(*parts, parent=self, spacing=6)
        self.mode.currentIndexChanged.connect(lambda _: remote.set_mode(self.mode.currentData()))
        remote.changed.connect(self._show)
        self._show()

    def _show(self) -> None:
        url, stop_url = self._remote.url, self._remote.stop_url
        show_text(self.address, self._remote.problem or url)
        show_text(self.stop_address, f"Stop of this run from a phone: {stop_url}" if stop_url else "")
        self.renew_button.setVisible(bool(url) and self._remote.mode == NETWORK)
        for code, shown in ((self.code, url), (self.stop_code, stop_url)):
            code.setVisible(bool(shown))
            code.setPixmap(qr_pixmap(shown) if shown else QPixmap())


def qr_pixmap(text: str) -> QPixmap:
    """Return a text as a QR code with its quiet zone, black on white in both themes."""
    data = io.BytesIO()
    segno.make(text, micro=False).save(data, kind="png", scale=MODULE_PIXELS, border=4)
    pixmap = QPixmap()
    pixmap.loadFromData(data.getvalue())
    return pixmap
