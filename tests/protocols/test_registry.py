"""Protocol registry: names and titles match the protocols', which are imported on first use."""

import subprocess
import sys

import pytest

from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS


@pytest.mark.parametrize("name", BUILT_IN_PROTOCOLS)
def test_name_and_title_are_the_protocols_own(name: str) -> None:
    assert (PROTOCOLS[name].name, PROTOCOLS[name].title) == (name, BUILT_IN_PROTOCOLS[name][0])


def test_the_list_imports_no_protocol() -> None:
    code = "import sys, protocols.registry; print([m for m in sys.modules if m == 'protocols.measurements.hysteresis'])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"
