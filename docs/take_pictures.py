"""Pictures of the documentation, taken from the running program: every page of the window, and a report.

    python docs/take_pictures.py [window] [report]

Works without a display. All pictures in docs/pictures are made by this script.
"""

import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))
os.environ.setdefault("QT_QPA_PLATFORM", f"offscreen:configfile={HERE.parent / 'tests/app/gui/screen.json'}")

from pypdfium2 import PdfDocument  # noqa: E402

from app.cli.main import main as command  # noqa: E402
from app.cli.report import write_report  # noqa: E402
from app.report.content import build_report  # noqa: E402
from app.report.limits import example_limits, read_limits  # noqa: E402
from docs.window_pictures import take  # noqa: E402

PICTURES = HERE / "pictures"


def main() -> int:
    PICTURES.mkdir(exist_ok=True)
    for name in sys.argv[1:] or TAKEN:
        TAKEN[name]()
    return 0


def report() -> None:
    """Take the first page of a report on a dwell and voltage steps, with the example limits."""
    with tempfile.TemporaryDirectory() as folder:
        runs, limits = Path(folder), Path(folder) / "limits.toml"
        for protocol in ("sine-dwell", "voltage-steps"):
            command(["run", protocol, "--speed", "max", "--seed", "7", "--specimen", "T7", "--out", folder])
        limits.write_text(example_limits(), "utf-8")
        content, specimen, _ = build_report(runs, "T7", read_limits(limits), full=False)
        pdf, _ = write_report(content, specimen, (), runs)
        with PdfDocument(pdf) as document:
            document[0].render(scale=100 / 72).to_pil().save(PICTURES / "report.png")
        print(PICTURES / "report.png")


def window() -> None:
    """Take the pictures of every page of the window."""
    take(PICTURES)


TAKEN: dict[str, Callable[[], None]] = {"window": window, "report": report}

if __name__ == "__main__":
    sys.exit(main())
