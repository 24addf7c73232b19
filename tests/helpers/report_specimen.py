"""Specimen of the report tests: a tactor with other parameters than Table I; access to the blocks of a report."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pypdfium2 import PdfDocument

from app.report.document import Report
from model.parameters import Tactor
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.voltage_steps import VoltageSteps

TRUTH = Tactor(mu=-1.5e-5, c0=180.0)
DWELL = SineDwell(frequencies_hz=(100, 140, 150, 160, 220), record_s=0.05, min_cycles=5)
STEPS = VoltageSteps(levels_v=(1.0, 4.0), repeats=1, rest_s=0.2, read_s=0.2, hold_s=0.5)


def blocks_of(report: Report, kind: type) -> Sequence[Any]:
    """Return all blocks of one kind of a report, in order."""
    return [block for block in report.blocks if isinstance(block, kind)]


def texts_of_pages(pdf: Path) -> list[str]:
    """What can be selected on each page, as another program reads it."""
    with PdfDocument(pdf) as document:
        return [page.get_textpage().get_text_range() for page in document]
