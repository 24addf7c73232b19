"""Documentation: the reference matches the code, links resolve, commands run."""

import importlib.util
import re
import shlex
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from app.cli.main import main
from docs.run_file_page import meaning_of
from protocols.base import Series, Verdict
from protocols.runfile.series import append_series
from protocols.runfile.writer import append_results, store_verdict
from tests.helpers.run_files import finished_run

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted([*ROOT.glob("*.md"), *ROOT.glob("docs/**/*.md")])
FENCE = re.compile(r"^```(console|python run)( exit=\w+)?\n(.*?)^```", re.M | re.S)
REFUSED = re.compile(r"^```text\n(tactor-bench [^\n]*)\n(tactor-bench: .*?)^```", re.M | re.S)
COMMANDED = [page for page in PAGES if "decisions" not in page.parts and FENCE.search(page.read_text("utf-8"))]


def reference() -> Any:
    spec = importlib.util.spec_from_file_location("make_reference", ROOT / "docs" / "make_reference.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.deep
def test_the_reference_is_what_the_code_gives() -> None:
    for name, text in reference().pages():
        page = ROOT / "docs" / name
        assert page.read_text("utf-8") == text, f"run 'python docs/make_reference.py': {name} is out of date"


def test_every_object_and_attribute_of_a_run_file_is_explained(tmp_path: Path) -> None:
    text = (ROOT / "docs" / "reference" / "run-file.md").read_text("utf-8")
    path = finished_run(tmp_path)
    further = r"entry/(repaired|earlier|imported)|entry/curves(/\w+_\d+(/\w+)?)?"
    names: dict[str, str] = {}
    with append_results(path) as file:
        store_verdict(file, Verdict())
        append_series(file, [Series(np.ones(1), np.ones(1), name="loop")])
    with h5py.File(path) as file:
        attributes = set(file.attrs)
        file.visititems(lambda name, item: names.update({name: str(item.attrs.get("long_name", ""))}))
        file.visititems(lambda name, item: attributes.update(item.attrs))
    for name, meaning in names.items():
        assert f"| `/{name}` |" in text or re.fullmatch(further, name), f"{name} is not named"
        assert meaning or re.fullmatch(further, name) or meaning_of(name), f"{name} has no meaning"
    for name in attributes:
        assert f"| `{name}` |" in text, f"the attribute {name} is not named"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_links_lead_somewhere(page: Path) -> None:
    text = re.sub(r"```.*?```", "", page.read_text("utf-8"), flags=re.S)
    for target in re.findall(r"\]\(([^)#\s]+)(?:#[^)]*)?\)", text):
        if not target.startswith(("http", "mailto:")):
            assert (page.parent / target).exists(), f"{page.name} links to {target}, which is not there"


def test_a_refusal_reads_as_the_tutorial_says(capfd: pytest.CaptureFixture[str]) -> None:
    ((command, told),) = REFUSED.findall((ROOT / "docs" / "tutorial.md").read_text("utf-8"))
    assert main(shlex.split(command)[1:]) == 2
    assert capfd.readouterr().err == told


def matches(word: str) -> list[str]:
    """What a shell makes of a word with a star in it."""
    return sorted(str(path) for path in Path().glob(word)) if "*" in word else [word]


def blocks(page: Path) -> Iterator[tuple[str, str, str]]:
    for kind, exit_code, text in FENCE.findall(page.read_text("utf-8")):
        yield kind, exit_code.removeprefix(" exit="), text


@pytest.mark.deep
@pytest.mark.parametrize("page", COMMANDED, ids=lambda page: str(page.relative_to(ROOT)))
def test_every_command_does_what_the_page_says(
    page: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for kind, exit_code, text in blocks(page):
        if kind == "python run":
            exec(compile(text, str(page), "exec"), {})
            continue
        for line in text.replace("\\\n", " ").splitlines():
            arguments = [match for word in shlex.split(line, comments=True) for match in matches(word)]
            if not arguments:
                continue
            assert arguments[0] == "tactor-bench", f"{page.name}: {line}"
            code = main(arguments[1:])
            captured = capfd.readouterr()
            if exit_code != "any":
                assert code == int(exit_code or 0), f"{page.name}: {line}\n{captured.err}"
            assert code != 2, f"{page.name}: {line}\n{captured.err}"
