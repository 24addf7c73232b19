"""Check for a display and for Qt's system libraries, before Qt is imported: Qt would abort the program."""

import ctypes
import importlib.util
import os
import sys

# Requirements of PySide6-Essentials 6.11 on Linux (its libraries' NEEDED entries, without what pip brings), and
# the Debian and Ubuntu package that holds it.
QT_LIBRARIES = {
    "libGL.so.1": "libgl1",
    "libEGL.so.1": "libegl1",
    "libX11.so.6": "libx11-6",
    "libxkbcommon.so.0": "libxkbcommon0",
    "libdbus-1.so.3": "libdbus-1-3",
    "libfontconfig.so.1": "libfontconfig1",
    "libfreetype.so.6": "libfreetype6",
    "libglib-2.0.so.0": "libglib2.0-0",
}
X11_LIBRARIES = {
    "libX11-xcb.so.1": "libx11-xcb1",
    "libxcb-cursor.so.0": "libxcb-cursor0",
    "libxcb-icccm.so.4": "libxcb-icccm4",
    "libxcb-image.so.0": "libxcb-image0",
    "libxcb-keysyms.so.1": "libxcb-keysyms1",
    "libxcb-randr.so.0": "libxcb-randr0",
    "libxcb-render-util.so.0": "libxcb-render-util0",
    "libxcb-shape.so.0": "libxcb-shape0",
    "libxcb-sync.so.1": "libxcb-sync1",
    "libxcb-util.so.1": "libxcb-util1",
    "libxcb-xfixes.so.0": "libxcb-xfixes0",
    "libxcb-xkb.so.1": "libxcb-xkb1",
    "libxkbcommon-x11.so.0": "libxkbcommon-x11-0",
}


def has_screen() -> bool:
    """Whether a window could be seen: always on Windows and macOS, with a display server elsewhere."""
    if os.environ.get("QT_QPA_PLATFORM", "").partition(":")[0] in ("offscreen", "minimal"):
        return True  # requested, as by tests
    return sys.platform in ("win32", "darwin") or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def missing_libraries() -> list[str]:
    """Debian packages without which Qt would not load here; empty where all is well."""
    if not sys.platform.startswith("linux"):
        return []
    on_x11 = os.environ.get("DISPLAY") and os.environ.get("QT_QPA_PLATFORM", "xcb") == "xcb"
    required = QT_LIBRARIES | (X11_LIBRARIES if on_x11 else {})
    return [package for library, package in required.items() if not _can_load(library)]


def window_unavailable_reason() -> str:
    """Why no window can be opened here, in a sentence with the remedy; empty where one can."""
    if importlib.util.find_spec("PySide6") is None:
        return "PySide6 is not installed; run 'pip install PySide6-Essentials'"
    if not has_screen():
        return "there is no screen (neither DISPLAY nor WAYLAND_DISPLAY is set)"
    if missing := missing_libraries():
        return (
            f"Qt needs system libraries that are not installed; run 'sudo apt-get install {' '.join(missing)}' "
            "(Debian, Ubuntu; other systems name them alike)"
        )
    return ""


def _can_load(library: str) -> bool:
    try:
        ctypes.CDLL(library)
    except OSError:
        return False
    return True
