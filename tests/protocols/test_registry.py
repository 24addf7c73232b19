"""Protocol registry: names and titles match the protocols', which are imported on first use."""

import re
import subprocess
import sys
from inspect import getdoc
from pathlib import Path

import pytest

from protocols.registry import (
    BUILT_IN_PROTOCOLS,
    PROTOCOLS,
    ProtocolFileError,
    ProtocolRegistry,
    load_protocol_file,
)


@pytest.mark.parametrize("name", BUILT_IN_PROTOCOLS)
def test_name_and_title_are_the_protocols_own(name: str) -> None:
    assert (PROTOCOLS[name].name, PROTOCOLS[name].title) == (name, BUILT_IN_PROTOCOLS[name][0])


def test_a_summary_is_the_first_line_of_the_description_and_imports_nothing() -> None:
    registry = ProtocolRegistry(BUILT_IN_PROTOCOLS)
    summaries = {name: registry.summary(name) for name in registry}
    assert all(isinstance(place, str) for place in registry._classes.values())
    assert summaries == {name: (getdoc(PROTOCOLS[name]) or "").splitlines()[0] for name in BUILT_IN_PROTOCOLS}


def test_the_list_imports_no_protocol() -> None:
    code = "import sys, protocols.registry; print([m for m in sys.modules if m == 'protocols.measurements.hysteresis'])"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout.strip() == "[]"


LABORATORY_FILE = """
from dataclasses import dataclass
from typing import Annotated
from annotated_types import Unit
from protocols import Protocol

@dataclass(frozen=True)
class Spot:
    level: Annotated[float, Unit("V"), "level"]
    moved: Annotated[float, Unit("m"), "displacement"]
    quality: Annotated[int, Unit("1"), "flags"]

class Spots(Protocol):
    name, title, point_type, axes = "spots", "Spots", Spot, ("level", "moved")
    def plan(self, rest_v): return ()
    def measure(self, entry, rest_v): yield
    def point(self, key, recordings, simulated): return None
    def estimates(self, points): return ()
"""


@pytest.mark.parametrize(
    ("correct", "wrong", "named"),
    [
        ('"spots", "Spots"', '"spots/lab", "Spots"', "'spots/lab'"),
        ("@dataclass(frozen=True)\n", "", "dataclass"),
        ('moved: Annotated[float, Unit("m"), "displacement"]', "moved: float", "moved: Annotated"),
        ('    quality: Annotated[int, Unit("1"), "flags"]\n', "", "quality: Annotated"),
        ("quality: Ann", 'entry: Annotated[int, Unit("1"), "entry"]\n    quality: Ann', "entry"),
        ('("level", "moved")', '("level", "displacement")', "displacement"),
    ],
)
def test_a_protocol_whose_runs_no_file_can_store_is_refused(
    correct: str, wrong: str, named: str, tmp_path: Path
) -> None:
    (path := tmp_path / "spots.py").write_text(LABORATORY_FILE)
    try:
        assert load_protocol_file(path).name == "spots"
    finally:
        del PROTOCOLS["spots"]
    assert LABORATORY_FILE.count(correct) == 1
    path.write_text(LABORATORY_FILE.replace(correct, wrong))
    with pytest.raises(ProtocolFileError, match=re.escape(named)) as refused:
        load_protocol_file(path)
    assert str(path) in str(refused.value)
    assert "spots" not in PROTOCOLS
