"""Handbook: built from all pages without a network, readable without one."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

DOCS = Path(__file__).resolve().parents[2] / "docs"
NO_NETWORK = """
import socket, sys
def refuse(*_):
    raise AssertionError("the handbook wants a network")
socket.socket.connect = socket.create_connection = socket.getaddrinfo = refuse
from sphinx.cmd.build import main
sys.exit(main(["-q", "-W", "--keep-going", *sys.argv[1:]]))
"""


pytestmark = pytest.mark.deep


@pytest.fixture(scope="module")
def handbook(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("handbook")
    built = subprocess.run(
        [sys.executable, "-c", NO_NETWORK, DOCS, out], capture_output=True, text=True, timeout=240, check=False
    )
    assert built.returncode == 0, built.stdout + built.stderr
    return out


def test_every_page_is_in_the_handbook(handbook: Path) -> None:
    pages = [page for page in DOCS.rglob("*.md") if page != DOCS / "README.md"]
    assert len(pages) > 60
    for page in pages:
        assert (handbook / page.relative_to(DOCS).with_suffix(".html")).exists(), page


def test_nothing_is_fetched_when_it_is_read(handbook: Path) -> None:
    for page in handbook.rglob("*.html"):
        text = page.read_text("utf-8")
        fetched = re.findall(r'<(?:script|img|iframe)[^>]*src="(?:https?:)?//[^"]*"', text)
        fetched += re.findall(r'<link[^>]*href="(?:https?:)?//[^"]*"', text)
        assert fetched == [], page


def test_equations_are_drawn_where_the_page_has_them(handbook: Path) -> None:
    text = re.sub(r"```.*?```|`[^`]*`", "", (DOCS / "theory.md").read_text("utf-8"), flags=re.S)
    equations = len(re.findall(r"\$\$.+?\$\$", text, re.S)) + len(re.findall(r"(?<!\$)\$(?!\$)[^$]+\$(?!\$)", text))
    theory = (handbook / "theory.html").read_text("utf-8")
    assert theory.count('<svg role="img" aria-label=') == equations > 60
    assert "currentColor" in theory
