"""The command `label`: labels of specimens to print, with a QR code for a barcode scanner."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from app.cli.options import CommandSyntax, folder_option, option
from app.common import ExitCode, UsageError, path_argument, print_line, print_message, usage_errors
from app.identification import SheetError
from app.identification.specimen_label import make_label
from protocols.runfile.names import safe_name

SUFFIXES = (".pdf", ".png", ".svg")
SMALLEST_MM, LARGEST_MM = 10.0, 300.0


@dataclass(frozen=True)
class LabelCommand:
    """Draw the labels of specimens."""

    specimens: Sequence[str] = option(nargs="+", metavar="SPECIMEN", help="names of specimens")
    folder: Path = folder_option()
    out: Path | None = option(
        "--out",
        type=path_argument,
        metavar="FILE",
        help="a .pdf with a page for each label; of a single label also .png or .svg (default: SPECIMEN_label.pdf, or labels.pdf)",
    )
    size: str = option("--size", default="50x25", metavar="WxH", help="width and height in mm (default: 50x25)")

    @usage_errors(SheetError)
    def execute(self) -> int:
        from app.plotting.label_figure import draw_labels

        path = self.out or Path(
            f"{safe_name(self.specimens[0])}_label.pdf" if len(self.specimens) == 1 else "labels.pdf"
        )
        if path.suffix.casefold() not in SUFFIXES:
            raise UsageError(f"--out {path}: write a name that ends in .pdf, .png or .svg")
        if len(self.specimens) > 1 and path.suffix.casefold() != ".pdf":
            raise UsageError(f"--out {path}: several labels go into a .pdf, a page each")
        size = _read_size(self.size)
        try:
            labels = [make_label(self.folder, specimen) for specimen in self.specimens]
            draw_labels(labels, size, path)
        except OSError as error:
            raise UsageError(f"{error.filename or path} cannot be read or written: {error.strerror or error}") from None
        for label in labels:
            if not label.sheet_hash:
                print_message(
                    f"{label.specimen} has no sheet in {self.folder}, so its label has no hash: tactor-bench specimen new {label.specimen}"
                )
        print_line(str(path))
        return ExitCode.DONE


def _read_size(text: str) -> tuple[float, float]:
    try:
        width, height = (float(part) for part in text.casefold().replace("mm", "").split("x"))
    except ValueError:
        raise UsageError(f"--size {text}: write width and height in mm, such as 50x25") from None
    if not all(SMALLEST_MM <= each <= LARGEST_MM for each in (width, height)):
        raise UsageError(f"--size {text}: from {SMALLEST_MM:g} to {LARGEST_MM:g} mm")
    return width, height


COMMANDS: Mapping[str, CommandSyntax] = {
    "label": CommandSyntax(
        LabelCommand,
        "Labels to print: name, batch and serial number of the specimen, the first digits of the SHA-256 of its sheet, and a QR code of name and hash. A scanner types "
        "it into the field Specimen of the window, which says whether the sheet has changed since.",
        "example: tactor-bench label T7 T8 T9 --out labels.pdf --size 50x25",
    ),
}
