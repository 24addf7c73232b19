"""The packages' public names: each is what its module has, and importing a package loads none of its modules."""

import importlib
import subprocess
import sys

import pytest

PACKAGES = ["drivers", "model", "protocols", "sim_hardware"]


@pytest.mark.parametrize("package", PACKAGES)
def test_every_public_name_is_there(package: str) -> None:
    module = importlib.import_module(package)
    assert set(module.__all__) == set(module._MODULE_OF)
    for name in module.__all__:
        assert getattr(module, name) is getattr(importlib.import_module(module._MODULE_OF[name]), name)
    with pytest.raises(AttributeError, match=rf"module '{package}' has no attribute 'nothing'"):
        module.nothing  # noqa: B018


def test_importing_the_packages_loads_nothing() -> None:
    code = f"import sys, {', '.join(PACKAGES)}; print(*(n for n in sys.modules if n.split('.')[0] in {PACKAGES}))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.split() == PACKAGES
