"""Import check: finds folders and files that shadow the packages of this application."""

import importlib
import importlib.util
import sys
from pathlib import Path

PACKAGES = ("app", "drivers", "model", "protocols", "sim_hardware")


def import_own_packages() -> None:
    """Import the packages of this application from this folder, so that no others can replace them later.

    Raises:
        ImportError: another module has the name of a package; the message names it and its place. It is not imported.
    """
    home = Path(__file__).resolve().parent.parent
    for name in PACKAGES:
        loaded = sys.modules.get(name)
        if loaded is not None:
            origin = getattr(loaded, "__file__", None) or next(iter(getattr(loaded, "__path__", ())), None)
        else:
            spec = importlib.util.find_spec(name)
            origin = None if spec is None else spec.origin or next(iter(spec.submodule_search_locations or ()), None)
        if origin is None and loaded is None:
            raise ImportError(
                f"tactor_bench needs its own package '{name}', which is not in {home}; install Tactor Bench again"
            )
        place = Path(origin or "an interactive session")
        place = place.parent if place.name == "__init__.py" else place
        if origin is None or place.resolve() != home / name:
            raise ImportError(_shadowed(name, place, home, loaded is not None))
    for name in PACKAGES:
        importlib.import_module(name)


def _shadowed(name: str, place: Path, home: Path, loaded: bool) -> str:
    kind = "the folder" if place.is_dir() else "the file" if place.is_file() else "the module of"
    restart = ", then restart Python or the kernel" if loaded else ""
    state = "is imported already" if loaded else "is found before"
    return (
        f"tactor_bench cannot be imported: {kind} {place} has the name of a package of Tactor Bench, '{name}', and {state} "
        f"{'in place of ' if loaded else ''}{home / name}; rename it or work in another folder{restart}"
    )
