"""Specimen sheet of a simulated bench: what its laboratory measured of the specimen, written beside the first run."""

import json
from collections.abc import Mapping
from importlib import resources
from pathlib import Path
from typing import Any

from app.common import parse_toml
from protocols.base import write_atomic
from protocols.runfile import sheet_path

HEAD = """# Specimen sheet of a simulated specimen: what its laboratory measured, off the truth within the uncertainty that is stated.
# Uncertainties are standard uncertainties (k = 1). Values not listed here are the paper's Table I, with the uncertainty of ruler, caliper or scale.
# Another bench's specimen needs another name.

"""


def provide_sheet(configuration: Mapping[str, Any], folder: Path, specimen: str) -> str:
    """Write the sheet of a simulated bench's specimen beside its runs if there is none; return a message, or an empty text.

    A sheet that was written for another bench is left as it is, and the message names it.

    Args:
        configuration: of the bench, as a run file stores it; `sheet` of its table `simulation` names the file.
        folder: of the runs.
        specimen: the name under which the specimen is measured.
    """
    source = str((configuration.get("simulation") or {}).get("sheet", ""))
    if not specimen:
        return ""
    path = sheet_path(folder, specimen)
    try:
        if path.exists():
            if source or not parse_toml(path.read_text("utf-8")).get("simulated"):
                return ""
            return f"{path.name} describes the specimen of another, simulated bench; give this one another name, or delete that file"
        if not source:
            return ""
        text = resources.files("sim_hardware").joinpath(Path(source).name).read_text("utf-8")
        _, key, rest = text.partition("specimen = ")
        entries = rest.partition("\n")[2]
        folder.mkdir(parents=True, exist_ok=True)
        write_atomic(path, f"{HEAD}{key}{json.dumps(specimen, ensure_ascii=False)}\n{entries}")
    except (OSError, ValueError):  # the run reports a folder without access; the fits report a damaged sheet
        return ""
    return f"Wrote {path.name}: dimensions and masses of the simulated specimen with their uncertainties, which every fit of its runs uses"
