"""Figures of the code: each is counted in a small checkout, and those of the product are within their table."""

import subprocess
from pathlib import Path

import pytest

from tests import structure
from tests.helpers import code_figures
from tests.helpers.code_figures import SourceTree

FILES = {
    "app/__init__.py": '"""Front ends."""\n',
    "app/inner/__init__.py": '"""Inner."""\n',
    "app/inner/part.py": '"""Part."""\n\nVALUE = 1\n\n\ndef own() -> int:\n    """Return it."""\n    return VALUE\n',
    "app/inner/user.py": '"""User inside."""\n\nfrom app.inner.part import VALUE\n\nUSED = VALUE\n',
    "app/outer.py": '"""User outside."""\n\nfrom app.inner.part import VALUE, own\n\nUSED = VALUE, own\n',
    "app/run_like.py": (
        '"""Forms."""\n\n\nclass Summary:\n    specimen: str\n    protocol: str\n    operator: str\n    verdict: str\n'
        "    start_time: str\n\n    @property\n    def duration_s(self) -> float:\n        return 0.0\n"
    ),
    "app/curve.py": '"""Curves."""\n\n\nclass Curve:\n    x: "Array"\n    y: Array\n    frequency_hz: Array\n',
    "app/messages.py": (
        '"""A module docstring of many words is no message."""\n\n\ndef fail(n: int) -> str:\n'
        '    return f"the folder {n} has no usable runs at all"\n\n\nOTHER = "choose another name for this specimen please"\n'
    ),
    "app/long.py": "def long(a, b, c, d, e, f, g, h, i):\n" + "    a += 1\n" * 60 + "\n\nclass Wide:\n"
    + "".join(f"    def m{n}(self): ...\n" for n in range(26)),
    "app/branches.py": "def branches(n):\n" + "".join(f"    if n == {n}:\n        return {n}\n" for n in range(13)),
    "tests/test_messages.py": 'def test_a(text):\n    assert "no usable runs" in text\n    assert "specimen" in text\n',
}  # fmt: skip


@pytest.fixture
def checkout(tmp_path: Path) -> Path:
    for name, text in FILES.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text)
    subprocess.run(["git", "init", "-q"], cwd=tmp_path, check=True)
    return tmp_path


def test_only_imports_from_outside_a_package_pass_its_interface(checkout: Path) -> None:
    tree = SourceTree(checkout, ("app",))
    assert code_figures.names_past_interfaces(tree) == [
        "app/outer.py:3 app.inner.part.VALUE",
        "app/outer.py:3 app.inner.part.own",
    ]


def test_forms_of_a_run_and_classes_of_series_are_counted(checkout: Path) -> None:
    tree = SourceTree(checkout, ("app",))
    assert code_figures.run_forms(tree) == ["app/run_like.py:Summary"]
    assert code_figures.series_classes(tree) == ["app/curve.py:Curve"]


def test_definitions_beyond_a_limit_are_listed_with_their_values(checkout: Path) -> None:
    assert code_figures.exceptions(SourceTree(checkout, ("app",))) == {
        "app/long.py:long lines": 61,
        "app/long.py:long parameters": 9,
        "app/long.py:Wide methods": 26,
        "app/branches.py:branches complexity": 14,
    }


def test_a_message_is_pinned_by_a_phrase_and_not_by_a_word(checkout: Path) -> None:
    pinned = code_figures.pinned_messages(SourceTree(checkout, ("app",)), SourceTree(checkout, ("tests",)))
    assert {message: len(files) for message, files in pinned.files.items()} == {
        "the folder has no usable runs at all": 1,
        "choose another name for this specimen please": 0,
    }
    assert pinned.share == 0.5


def test_growth_and_new_exceptions_are_reported_and_an_update_adds_none() -> None:
    table = {"at_most": {"forms": 4.0}, "lines": {"app": 100.0}, "exceptions": {"f lines": 70.0}}
    now = {"at_most": {"forms": 4.0}, "lines": {"app": 101.0}, "exceptions": {"f lines": 71.0, "g lines": 61.0}}
    assert [each.split(":")[0] for each in code_figures.growth(now, table)] == ["app", "f lines", "g lines"]
    assert structure.updated(table, now) == {
        "at_most": {"forms": 4.0},
        "lines": {"app": 101.0},
        "exceptions": {"f lines": 70.0},
    }


@pytest.mark.deep
def test_the_product_is_within_its_limits(capsys: pytest.CaptureFixture[str]) -> None:
    assert structure.main([]) == 0, capsys.readouterr().out
