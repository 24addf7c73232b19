"""One fault at a call: system calls and messages of a run, campaign, accept, backup and report; `docs/single-faults.md` has the counts."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.helpers.single_faults.points import OPERATIONS
from tests.helpers.single_faults.system_calls import supported

ROOT = Path(__file__).parents[2]


@pytest.mark.deep
@pytest.mark.skipif(not supported(), reason="system calls are shown by Linux only")
@pytest.mark.parametrize("operation", OPERATIONS)
def test_a_call_that_fails_ends_in_words_at_rest_with_the_data_kept(operation: str, tmp_path: Path) -> None:
    """Points drawn by a fixed seed; `python docs/make_single_faults.py LOG` runs all of them."""
    command = [sys.executable, "docs/make_single_faults.py", str(tmp_path / "log"), "--only", operation]
    ran = subprocess.run([*command, "--at-most", "12"], cwd=ROOT, capture_output=True, text=True, check=False)
    assert ran.returncode == 0, ran.stdout + ran.stderr


def test_the_page_has_every_operation_and_no_violation() -> None:
    text = (ROOT / "docs" / "single-faults.md").read_text("utf-8")
    for name, operation in OPERATIONS.items():
        assert f"| {name} ({operation.boundary}) | " in text, "run: python docs/make_single_faults.py LOG"
    assert "## Violations" not in text
