"""Public interfaces of the packages: names match their modules, and importing a package loads none of them."""

import ast
import importlib
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ["drivers", "model", "protocols", "sim_hardware"]
STUBS = sorted(
    stub.relative_to(ROOT)
    for package in ("app", *PACKAGES, "tactor_bench")
    for stub in (ROOT / package).rglob("__init__.pyi")
    if (stub.parent / "__init__.py").exists()
)


@pytest.mark.parametrize("package", [".".join(stub.parts[:-1]) for stub in STUBS])
def test_every_public_name_is_there(package: str) -> None:
    module = importlib.import_module(package)
    tree = ast.parse((ROOT / package.replace(".", "/") / "__init__.pyi").read_text("utf-8"))
    module_of = {alias.name: node.module for node in tree.body for alias in node.names}  # type: ignore[attr-defined]
    assert set(module.__all__) == set(module_of) <= set(dir(module))
    for name in module.__all__:
        assert getattr(module, name) is getattr(importlib.import_module(f"{package}.{module_of[name]}"), name)
    with pytest.raises(AttributeError, match=rf"No {package} attribute nothing"):
        module.nothing  # noqa: B018


def test_importing_the_packages_loads_nothing() -> None:
    code = f"import sys, {', '.join(PACKAGES)}; print(*(n for n in sys.modules if n.split('.')[0] in {PACKAGES}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == PACKAGES
