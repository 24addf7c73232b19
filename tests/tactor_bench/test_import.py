"""`import tactor_bench`: fast, complete, and never another folder's packages."""

import doctest
import importlib
import os
import pkgutil
import subprocess
import sys
from pathlib import Path

import pytest

import tactor_bench as tb
from app.config import load_bench
from tactor_bench._packages import PACKAGES

ROOT = Path(tb.__file__).resolve().parent.parent
HEAVY = ("numpy", "pydantic", "scipy", "h5py", "pint", "rich", "matplotlib", "pyvisa", "nidaqmx", "grpc", "PySide6")


def python(code: str, folder: Path) -> subprocess.CompletedProcess[str]:
    """Run a script in `folder`, whose own files Python finds first, as it does for a notebook."""
    return subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_importing_loads_nothing_heavy(tmp_path: Path) -> None:
    done = python(f"import sys, tactor_bench; print(*(m for m in {HEAVY} if m in sys.modules))", tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, ""), done.stderr


def test_the_package_is_typed() -> None:
    assert (Path(tb.__file__).parent / "py.typed").exists()


@pytest.mark.parametrize(
    "name", ["tactor_bench", *(f"tactor_bench.{m.name}" for m in pkgutil.iter_modules(tb.__path__))]
)
def test_examples_in_docstrings_do_what_they_say(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_every_public_function_has_an_example() -> None:
    for name in ("calibration", "connect", "identify", "open_run", "response", "runs"):
        assert ">>> " in (getattr(tb, name).__doc__ or ""), name
        assert "Raises:" in (getattr(tb, name).__doc__ or ""), name


@pytest.mark.parametrize("name", PACKAGES)
@pytest.mark.parametrize("kind", ["folder", "file"])
def test_a_folder_of_the_same_name_is_named_and_not_imported(name: str, kind: str, tmp_path: Path) -> None:
    own = tmp_path / name if kind == "folder" else tmp_path / f"{name}.py"
    if kind == "folder":
        own.mkdir()
    (own / "__init__.py" if kind == "folder" else own).write_text("open('imported', 'w')")
    done = python("import tactor_bench", tmp_path)
    told = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1
    assert told.startswith(
        f"ImportError: tactor_bench cannot be imported: the {kind} {own} has the name of a package of"
    )
    assert told.endswith(f"'{name}', and is found before {ROOT / name}; rename it or work in another folder")
    assert not (tmp_path / "imported").exists()


def test_one_that_was_imported_before_is_named_too(tmp_path: Path) -> None:
    (tmp_path / "model.py").write_text("mine = 1")
    done = python(
        "import sys, model; sys.path.pop(0)\ntry: import tactor_bench\nexcept ImportError as e: print(e)", tmp_path
    )
    assert f"the file {tmp_path / 'model.py'} has the name of a package of Tactor Bench, 'model'" in done.stdout
    assert "restart Python or the kernel" in done.stdout


def test_one_that_was_made_by_hand_is_named_too(tmp_path: Path) -> None:
    code = "import sys, types; sys.modules['app'] = types.ModuleType('app')\nimport tactor_bench"
    assert "'app', and is imported already" in python(code, tmp_path).stderr


@pytest.mark.deep
def test_what_comes_into_the_way_after_the_import_changes_nothing(tmp_path: Path) -> None:
    other = tmp_path / "other"
    for name in PACKAGES:
        (other / name).mkdir(parents=True)
        (other / name / "__init__.py").write_text("raise RuntimeError('not ours')")
    code = f"import sys, os, tactor_bench as tb; sys.path.insert(0, {str(other)!r}); os.chdir({str(other)!r})\n"
    done = python(f"{code}with tb.connect('sim', speed=20, progress=False) as bench: print(bench.name)", tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, load_bench("sim").name), done.stderr


@pytest.mark.deep
def test_a_folder_without_python_in_it_is_not_in_the_way(tmp_path: Path) -> None:
    (tmp_path / "model").mkdir()
    (tmp_path / "model" / "fit.csv").write_text("1,2")
    done = python("import tactor_bench as tb; print(tb.Tactor().k2)", tmp_path)
    assert (done.returncode, done.stdout.strip()) == (0, "0.007"), done.stderr
