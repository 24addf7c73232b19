"""Build of the desktop program with PyInstaller: one folder that needs no Python, for the system it is built on.

    python3 start.py desktop        sets up, then builds dist/tactor-bench/

The program in it is `tactor-bench`, on Windows `tactor-bench.exe`; without arguments it opens the window.
"""

import os
import sys
from pathlib import Path

import PyInstaller.__main__
from PyInstaller.utils.hooks import collect_data_files, collect_submodules, copy_metadata

HERE = Path(__file__).resolve().parent
ROOT = HERE.parent
PACKAGES = ("app", "drivers", "model", "protocols", "sim_hardware", "tactor_bench")
DEPENDENCIES = ("nidaqmx", "pyvisa_py", "pyqtgraph", "pyuff", "lazy_loader")
"""Packages with modules or data that are looked up by name while the program runs."""
DATA = ("pyi", "toml", "template", "html", "css", "js", "png", "svg", "txt", "ttf", "qss")
"""Endings of the files that packages read: stubs of lazy imports, tables and simulated benches, templates, the web page, pictures, fonts."""
BACKENDS = tuple(f"matplotlib.backends.backend_{name}" for name in ("agg", "pdf", "svg"))
"""Backends that matplotlib imports by the ending of a file's name."""
EXCLUDED = ("tkinter", "IPython", "pytest", "mypy", "sphinx", "PyInstaller")


def _is_needed(module: str) -> bool:
    """Return whether a module belongs into the program: examples are left out, and importing them opens windows."""
    return ".examples" not in module


def options() -> list[str]:
    """Return the options of PyInstaller."""
    sys.path.insert(0, str(ROOT))
    given = ["--noconfirm", "--clean", "--onedir", "--console", "--name", "tactor-bench", "--paths", str(ROOT)]
    given += ["--distpath", str(ROOT / "dist"), "--workpath", str(ROOT / "build" / "desktop")]
    given += ["--specpath", str(ROOT / "build" / "desktop"), "--log-level", "WARN"]
    for name in (*PACKAGES, *DEPENDENCIES):
        given += [
            word for module in collect_submodules(name, filter=_is_needed) for word in ("--hidden-import", module)
        ]
        for source, target in collect_data_files(name, includes=[f"**/*.{suffix}" for suffix in DATA]):
            given += ["--add-data", f"{source}:{target}"]
    given += [word for module in BACKENDS for word in ("--hidden-import", module)]
    for source, target in copy_metadata("tactor-bench", recursive=True):
        given += ["--add-data", f"{source}:{target}"]
    for name in EXCLUDED:
        given += ["--exclude-module", name]
    return [*given, str(HERE / "entry.py")]


if __name__ == "__main__":
    # Modules are imported to be found; without a display Qt ends such a process.
    os.environ.setdefault("QT_QPA_PLATFORM", "offscreen")
    PyInstaller.__main__.run(options())
