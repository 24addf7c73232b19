"""Calls that Windows does not have: none in the product outside code that asks for the system first.

The type checker's stubs of the standard library say which names exist on Windows.
"""

import ast
import re
from collections.abc import Iterator
from pathlib import Path

import mypy
import pytest

ROOT = Path(__file__).resolve().parents[2]
PRODUCT = ("app", "drivers", "model", "protocols", "sim_hardware", "tactor_bench")
STUBS = Path(mypy.__file__).parent / "typeshed" / "stdlib"
MODULES = {
    "os": "os/__init__.pyi",
    "signal": "signal.pyi",
    "socket": "socket.pyi",
    "time": "time.pyi",
    "select": "select.pyi",
}
POSIX_MODULES = {"fcntl", "termios", "pty", "tty", "pwd", "grp", "resource", "syslog", "readline", "crypt", "nis"}
"""Modules that Windows does not have; their import fails there."""

GUARDS = ("os.name", "sys.platform", "hasattr(")
"""What a condition that asks for the system contains."""

KNOWN = {
    (
        "app/services/prompts.py",
        "os.tcgetpgrp",
    ): "the keyboard is polled only where can_poll_keyboard, which is false on Windows",
    ("app/services/prompts.py", "os.getpgrp"): "the same",
    ("protocols/runfile/presence.py", "os.pread"): "the descriptor is None on Windows",
    ("sim_hardware/wires/pty.py", "os.openpty"): "a pseudo-terminal; tests of serial instruments use it, on POSIX",
    ("sim_hardware/wires/pty.py", "os.ttyname"): "the same",
    ("sim_hardware/wires/pty.py", "os.set_blocking"): "the same",
    ("sim_hardware/wires/pty.py", "import tty"): "the same",
}
"""Calls whose guard is elsewhere, with where it is."""


def posix_only_names() -> set[str]:
    """`module.name` of everything that the stubs define for other systems than Windows only."""
    found: set[str] = set()
    for module, stub in MODULES.items():
        everywhere: set[str] = set()
        elsewhere: set[str] = set()
        _collect(ast.parse((STUBS / stub).read_text(encoding="utf-8")).body, everywhere, elsewhere, posix=False)
        found |= {f"{module}.{name}" for name in elsewhere - everywhere}
    return found


def _collect(body: list[ast.stmt], everywhere: set[str], elsewhere: set[str], posix: bool) -> None:
    names = elsewhere if posix else everywhere
    for node in body:
        if isinstance(node, ast.If):
            test = ast.unparse(node.test)
            not_windows = "sys.platform != 'win32'" in test or ("sys.platform ==" in test and "win32" not in test)
            windows = test == "sys.platform == 'win32'"
            _collect(node.body, everywhere, elsewhere, posix or not_windows)
            _collect(node.orelse, everywhere, elsewhere, posix or windows)
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            names.add(node.name)
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            names.add(node.target.id)
        elif isinstance(node, ast.Assign):
            names |= {target.id for target in node.targets if isinstance(target, ast.Name)}
        elif isinstance(node, ast.ImportFrom):
            names |= {alias.asname or alias.name for alias in node.names}


def unguarded(source: str, posix_only: set[str]) -> Iterator[tuple[int, str]]:
    """Line and name of every use that no condition or handler of a missing import encloses."""
    yield from _visit(ast.parse(source), posix_only, guarded=False)


def _visit(node: ast.AST, posix_only: set[str], guarded: bool) -> Iterator[tuple[int, str]]:
    if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
        name = f"{node.value.id}.{node.attr}"
        if name in posix_only and not guarded:
            yield node.lineno, name
    if isinstance(node, ast.Import | ast.ImportFrom) and not guarded:
        modules = [node.module or ""] if isinstance(node, ast.ImportFrom) else [alias.name for alias in node.names]
        yield from ((node.lineno, f"import {module}") for module in modules if module in POSIX_MODULES)
        if isinstance(node, ast.ImportFrom):
            named = (f"{node.module}.{alias.name}" for alias in node.names)
            yield from ((node.lineno, name) for name in named if name in posix_only)
    if isinstance(node, ast.Try) and any(_catches_import(handler) for handler in node.handlers):
        guarded_body = {id(each) for each in node.body}
        for child in ast.iter_child_nodes(node):
            yield from _visit(child, posix_only, guarded or id(child) in guarded_body)
        return
    asks = isinstance(node, ast.If | ast.IfExp | ast.BoolOp) and _asks_for_system(node)
    body = list(ast.iter_child_nodes(node))
    for child in body:
        yield from _visit(child, posix_only, guarded or asks)
        if isinstance(child, ast.If) and _asks_for_system(child) and _leaves(child.body):
            guarded = True  # what follows an early way out is for the other systems


def _asks_for_system(node: ast.If | ast.IfExp | ast.BoolOp) -> bool:
    text = ast.unparse(node.test if isinstance(node, ast.If | ast.IfExp) else node.values[0])
    return any(guard in text for guard in GUARDS)


def _leaves(body: list[ast.stmt]) -> bool:
    return isinstance(body[-1], ast.Return | ast.Raise)


def _catches_import(handler: ast.ExceptHandler) -> bool:
    return handler.type is not None and "ImportError" in ast.unparse(handler.type)


@pytest.fixture(scope="module")
def posix_only() -> set[str]:
    return posix_only_names()


def test_the_product_calls_nothing_that_windows_lacks_without_asking(posix_only: set[str]) -> None:
    modules, missing = "|".join(MODULES), "|".join(POSIX_MODULES)
    attributes = "|".join(sorted({name.partition(".")[2] for name in posix_only}))
    # Parsing every file takes seconds.
    words = re.compile(rf"\b({modules})\.({attributes})\b|\bfrom ({modules}|{missing}) import|\bimport ({missing})\b")
    found = {
        (path.relative_to(ROOT).as_posix(), name): line
        for top in PRODUCT
        for path in sorted((ROOT / top).rglob("*.py"))
        if words.search(text := path.read_text(encoding="utf-8"))
        for line, name in unguarded(text, posix_only)
    }
    new = [f"{path}:{line}: {name}" for (path, name), line in found.items() if (path, name) not in KNOWN]
    assert not new, f"guard it by os.name or sys.platform: {new}"
    assert not KNOWN.keys() - found.keys(), "these are no longer there"


def test_calls_without_a_guard_are_found_and_those_with_one_are_not(posix_only: set[str]) -> None:
    assert {"os.fork", "os.killpg", "os.geteuid", "signal.SIGSTOP", "signal.SIGHUP", "os.pread"} <= posix_only
    assert not {"os.replace", "os.kill", "os.fsync", "signal.SIGINT", "signal.SIGTERM", "os.link"} & posix_only
    for wrong in (
        "import os\nos.fork()",
        "import fcntl",
        "from os import fork",
        "def f():\n import signal\n signal.SIGSTOP",
    ):
        assert list(unguarded(wrong, posix_only)), wrong
    for right in (
        "import os\nif os.name == 'posix':\n os.fork()",
        "x = [signal.SIGHUP] if hasattr(signal, 'SIGHUP') else []",
        "def f():\n if sys.platform == 'win32':\n  return 0\n return os.fork()",
        "try:\n import termios\nexcept ImportError:\n termios = None",
        "ok = os.name != 'nt' and os.getuid() == 0",
    ):
        assert not list(unguarded(right, posix_only)), right
