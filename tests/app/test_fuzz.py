"""Fuzzed files of every kind: one sentence each, no traceback, no hang, no more than a GB, no control characters.

A failing case is named by kind and seed; `python -m tests.helpers.fuzz_runner again KIND SEED FOLDER` repeats it. The
environment variable FUZZ_START begins with another seed.
"""

import contextlib
import os
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from app.common.text_table import FORMULA_STARTS, sheet_text
from protocols.base import parse_json_object, parse_toml, visible_text
from tests.helpers.fuzz_runner import fuzz_apart, kind_of, problem_of
from tests.helpers.fuzz_targets import TARGETS, Originals
from tests.helpers.texts import CONTROLS, LETTERS, SIGNS, SURROGATES, texts

CASES = 4000
SAMPLE = 6
SHARES = {name: target.share for name, target in TARGETS.items()}


@pytest.fixture(scope="module")
def originals(tmp_path_factory: pytest.TempPathFactory) -> Originals:
    return Originals(tmp_path_factory.mktemp("originals"))


def test_a_sample_of_fuzzed_files_is_read_or_refused_in_a_sentence(originals: Originals, tmp_path: Path) -> None:
    for seed in range(SAMPLE):
        kind = kind_of(seed, SHARES | {"mat": 0.0})  # its reader is a process of its own
        problem, sentence = problem_of(originals, kind, seed, tmp_path / "case")
        assert not problem, f"{kind} {seed}"
        assert "\n\n" not in sentence


@pytest.mark.deep
@pytest.mark.timeout(3000)
def test_thousands_of_fuzzed_files_are_read_or_refused_in_a_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    report = fuzz_apart(tmp_path, int(os.environ.get("FUZZ_START", "0")), CASES)
    with capsys.disabled():
        print(f"\n{report}")
    assert not report.problems, str(report)
    assert report.cases.total() == CASES
    assert set(report.cases) == set(TARGETS)


@given(texts(LETTERS + SIGNS + CONTROLS + SURROGATES, st.characters()), st.booleans())
def test_visible_text_gives_no_orders_and_is_stable(text: str, multiline: bool) -> None:
    shown = visible_text(text, multiline)
    assert visible_text(shown, multiline) == shown
    shown.encode()
    assert not any(ord(c) < 32 or 0x7F <= ord(c) < 0xA0 for c in shown if not (multiline and c in "\n\t"))


@given(st.text(alphabet='[]{}":,0123456789.eE-\\udabcxnul tf\n'))
def test_any_text_is_a_json_object_or_a_value_error(text: str) -> None:
    for parse in (parse_json_object, parse_toml):
        with contextlib.suppress(ValueError):
            assert isinstance(parse(text), dict)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ('{"a": ' + "[" * 100_000, "nested too deeply"),
        ('{"a": ' + "[" * 60 + "]" * 60 + "}", "nested too deeply"),
        ('{"a": ' + "9" * 400 + "}", "a number has 400 digits"),
        ('{"a": ' + "9" * 5000 + "}", "a number has 5000 digits"),
        ("[]", "not a JSON object"),
        ("null", "not a JSON object"),
    ],
)
def test_json_beyond_reason_is_a_sentence(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        parse_json_object(text)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("a = " + "9" * 400, "a number has 400 digits"),
        ("a." * 9000 + "b = 1", "nested too deeply"),
        ("[" + "a." * 9000 + "b]", "nested too deeply"),
        ("a = " + "[" * 5000, "nested too deeply"),
        ("a = " + "{b = " * 60 + "1" + "}" * 60, "nested too deeply"),
    ],
)
def test_toml_beyond_reason_is_a_sentence(text: str, says: str) -> None:
    with pytest.raises(ValueError, match=says):
        parse_toml(text)


@given(texts())
def test_no_cell_begins_as_a_formula_unless_it_is_a_number(text: str) -> None:
    cell = sheet_text(text)
    assert isinstance(cell, str)
    if cell.startswith(FORMULA_STARTS):
        float(cell)
