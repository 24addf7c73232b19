"""Take the pictures of the documentation from the running program: every page of the window, and a report.

    python docs/take_pictures.py [window] [report]

Works without a screen. The pictures in docs/pictures are made by this script and by nothing else.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")

from app.cli.main import main as command  # noqa: E402
from app.report.content import build_report  # noqa: E402
from app.report.limits import example_limits, read_limits  # noqa: E402
from app.report.pdf import signature_page  # noqa: E402
from docs.window_pictures import take  # noqa: E402

PICTURES = HERE / "pictures"


def main() -> int:
    PICTURES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or TAKEN:
        TAKEN[name]()
    return 0


def report() -> None:
    """The page to sign, of a dwell and steps on the virtual clock, with the example's limits."""
    with tempfile.TemporaryDirectory() as folder:
        runs, limits = Path(folder), Path(folder) / "limits.toml"
        for protocol in ("sine-dwell", "voltage-steps"):
            command(["run", protocol, "--speed", "max", "--seed", "7", "--specimen", "T7", "--out", folder])
        limits.write_text(example_limits(), "utf-8")
        page = signature_page(build_report(runs, "T7", read_limits(limits))[0])
        page.savefig(PICTURES / "report.png", dpi=100)
        print(PICTURES / "report.png")


def window() -> None:
    """Every page."""
    take(PICTURES)


TAKEN: dict[str, Callable[[], None]] = {"window": window, "report": report}

if __name__ == "__main__":
    sys.exit(main())
