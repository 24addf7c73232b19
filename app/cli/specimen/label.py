"""The command `label`: labels of specimens to print, with a QR code for a barcode scanner."""

from argparse import ArgumentTypeError
from collections.abc import Sequence
from pathlib import Path

from app.cli.options import FOLDER, argument, command, option, specimen_argument
from app.common import ExitCode, UsageError, print_line, print_message, usage_errors
from app.identification import SheetError, make_label
from drivers import open_regular
from protocols.runfile import safe_name

SUFFIXES = (".pdf", ".png", ".svg")
SMALLEST_MM, LARGEST_MM = 10.0, 300.0
MAX_LIST_BYTES, MOST_PLACES = 1_000_000, 1000


@command("example: tactor-bench label --list specimens.txt --sheet --size 63.5x38.1 --gap 2.5x0 --out labels.pdf")
class LabelCommand:
    """Make labels to print: name, batch and serial number of the specimen, the first digits of the SHA-256 of its sheet,
    and a QR code of name and hash. A scanner types the code into the field Specimen of the window, which reports a
    sheet that has changed since.
    """

    specimens: Sequence[str] = argument("names of specimens", nargs="*", metavar="SPECIMEN")
    names: Path | None = option(
        "file of further names: one per line, or the first column of a CSV file", flag="--list", metavar="FILE"
    )
    folder: Path = FOLDER
    out: Path | None = option(
        "a .pdf with a page for each label; of a single label also .png or .svg (default: SPECIMEN_label.pdf, or labels.pdf)",
        metavar="FILE",
    )
    size: str = option("width and height in mm (default: 50x25)", "50x25", metavar="WxH")

    sheet: bool = option("print as many labels as fit on each A4 page, centred")
    gap: str = option("gap between the labels of a sheet, mm (default: 0x0)", "0x0", metavar="WxH")
    used: int = option("number of first places of the sheet without a label", 0, metavar="N")

    @usage_errors(SheetError)
    def execute(self) -> int:
        from app.plotting import draw_label_sheets, draw_labels

        specimens = [*self.specimens, *_read_names(self.names)]
        if not specimens:
            raise UsageError("name the specimens: 'tactor-bench label T7 T8', or --list FILE")
        path = self.out or Path(f"{safe_name(specimens[0])}_label.pdf" if len(specimens) == 1 else "labels.pdf")
        if path.suffix.casefold() not in SUFFIXES:
            raise UsageError(f"--out {path}: write a name that ends in .pdf, .png or .svg")
        if (self.sheet or len(specimens) > 1) and path.suffix.casefold() != ".pdf":
            raise UsageError(f"--out {path}: several labels and sheets go into a .pdf")
        size = _read_size("--size", self.size, SMALLEST_MM, LARGEST_MM)
        gap = _read_size("--gap", self.gap, 0.0, LARGEST_MM)
        if not 0 <= self.used < MOST_PLACES:
            raise UsageError(f"--used {self.used}: from 0 to {MOST_PLACES - 1}")
        try:
            labels = [make_label(self.folder, specimen) for specimen in specimens]
            if self.sheet:
                places = draw_label_sheets(labels, size, gap, self.used, path)
                print_message(f"{places} labels on a sheet; print at 100 %, without fitting to the page")
            else:
                draw_labels(labels, size, path)
        except OSError as error:
            raise UsageError(f"{error.filename or path} cannot be read or written: {error.strerror or error}") from None
        except ValueError as error:
            raise UsageError(f"--size {self.size}: {error}") from None
        for label in labels:
            if not label.sheet_hash:
                print_message(
                    f"{label.specimen} has no sheet in {self.folder}, so its label has no hash: tactor-bench specimen new {label.specimen}"
                )
        print_line(str(path))
        return ExitCode.DONE


HEADS = ("specimen", "specimens", "name", "names", "label", "id")
"""Heads of a list's first column, which are no specimens."""


def _read_names(path: Path | None) -> list[str]:
    """Return the names of a list: of each line the text before the first comma or semicolon; blank and `#` lines are skipped."""
    if path is None:
        return []
    try:
        with open_regular(path, "r", encoding="utf-8-sig") as file:
            lines = file.read(MAX_LIST_BYTES).splitlines()
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"--list {path} cannot be read: {getattr(error, 'strerror', None) or error}") from None
    cells = [line.replace(";", ",").split(",")[0].strip().strip('"') for line in lines if not line.startswith("#")]
    names = [cell for cell in cells if cell]
    if names and names[0].casefold() in HEADS:  # the head of a table that was exported
        names = names[1:]
    if not names:
        raise UsageError(f"--list {path} has no name; write one specimen per line")
    with usage_errors(ArgumentTypeError):
        return [specimen_argument(name) for name in names]


def _read_size(option_name: str, text: str, low: float, high: float) -> tuple[float, float]:
    try:
        width, height = (float(part) for part in text.casefold().replace("mm", "").split("x"))
    except ValueError:
        raise UsageError(f"{option_name} {text}: write width and height in mm, such as 50x25") from None
    if not all(low <= each <= high for each in (width, height)):
        raise UsageError(f"{option_name} {text}: from {low:g} to {high:g} mm")
    return width, height
