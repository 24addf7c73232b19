"""What `tactor-bench report` does."""

import argparse
import sys
from pathlib import Path

from app.exits import DONE, UsageError
from app.observing import ObservingError
from app.report import ReportError, gather, to_html, to_pdf
from protocols.runfile import safe_name
from protocols.runreader import RunError


def report(options: argparse.Namespace) -> int:
    """`tactor-bench report SPECIMEN`."""
    out: Path = options.out
    if not options.folder.is_dir():
        raise UsageError(f"there is no folder {options.folder}; name the one your runs are in with --folder")
    try:
        out.mkdir(parents=True, exist_ok=True)
        found = gather(options.folder, options.specimen)
        for path, write in (
            (out / f"{safe_name(options.specimen)}_report.pdf", to_pdf),
            (out / f"{safe_name(options.specimen)}_report.html", to_html),
        ):
            write(found, path)
            sys.stderr.write(f"wrote {path}\n")
    except (ReportError, ObservingError, RunError, ValueError) as error:
        raise UsageError(str(error)) from None
    except OSError as error:
        raise UsageError(f"the report cannot be written to {out}: {error.strerror or error}") from None
    return DONE
