"""Small specimen for all report tests: measured once, read once."""

from pathlib import Path

import pytest

from app.report.content import build_report
from app.report.document import Report
from app.report.runs import ReportRun
from app.report.specimen import SpecimenModel
from tests.helpers.report_specimen import DWELL, STEPS, TRUTH
from tests.helpers.simulated_bench import laboratory, run, simulated


@pytest.fixture(scope="package")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short dwell and short steps."""
    folder = tmp_path_factory.mktemp("runs")
    with laboratory(simulated(tactor={"mu": TRUTH.mu, "c0": TRUTH.c0}, seed=5)) as lab:
        for protocol in (DWELL, STEPS):
            run(protocol, folder, lab)
    return folder


@pytest.fixture(scope="package")
def gathered(folder: Path) -> tuple[Report, SpecimenModel, tuple[ReportRun, ...]]:
    return build_report(folder, "T1")
