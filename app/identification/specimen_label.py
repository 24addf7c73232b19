"""Labels of specimens for a barcode scanner: name and hash of the sheet in one text, and its verification after a scan."""

import re
from dataclasses import dataclass
from pathlib import Path

from protocols.base import file_hash
from protocols.runfile import sheet_path

HASH_DIGITS = 12
"""Digits of the SHA-256 of the sheet: as many as identify a line of the audit trail."""
_PATTERN = re.compile(rf"(?P<specimen>.*\S) #(?P<hash>[0-9a-f]{{{HASH_DIGITS}}})", re.DOTALL)


@dataclass(frozen=True, slots=True)
class SpecimenLabel:
    """Contents of a label.

    Attributes:
        sheet_hash: first digits of the SHA-256 of the specimen's sheet; empty without a sheet.
        batch, serial: batch and serial number of the sheet.
    """

    specimen: str
    sheet_hash: str = ""
    batch: str = ""
    serial: str = ""

    @property
    def text(self) -> str:
        """The text of the QR code, which a scanner types."""
        return f"{self.specimen} #{self.sheet_hash}" if self.sheet_hash else self.specimen


def read_label(text: str) -> SpecimenLabel:
    """Return name and hash of a scanned or typed text; one without a hash is a name."""
    match = _PATTERN.fullmatch(text.strip())
    return SpecimenLabel(text.strip()) if match is None else SpecimenLabel(match["specimen"], match["hash"])


def make_label(folder: Path, specimen: str) -> SpecimenLabel:
    """Return the label of a specimen with the hash of its present sheet.

    Raises:
        SheetError: the sheet cannot be read, or is of another specimen.
        OSError: the sheet cannot be read.
    """
    from app.identification.sheet_file import load_sheet  # not needed for reading a scanned text

    sheet = load_sheet(folder, specimen)
    digest = file_hash(sheet_path(folder, specimen)) if sheet.path is not None else ""
    return SpecimenLabel(specimen, digest[:HASH_DIGITS], sheet.batch, sheet.serial)


def compare_label(folder: Path, label: SpecimenLabel) -> str:
    """Return a sentence on a scanned label and the present sheet; empty for a name without a hash.

    Raises:
        SheetError: the sheet cannot be read, or is of another specimen.
        OSError: the sheet cannot be read.
    """
    if not label.sheet_hash:
        return ""
    present = make_label(folder, label.specimen).sheet_hash
    if present == label.sheet_hash:
        return f"Label of {label.specimen}: its sheet is unchanged since the label was printed."
    if not present:
        return f"Label of {label.specimen}: there is no sheet of it in this folder. Is it the right folder?"
    return f"Label of {label.specimen}: its sheet has changed since the label was printed. Print a new one with: tactor-bench label {label.specimen}"
