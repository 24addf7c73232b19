"""What the sliders of the Explore page vary, as a study file. No Qt."""

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from model.study import Study


def write_study(path: Path, study: "Study", variable: str) -> str:
    """Compute a study into a file, HDF5 or by its ending CSV; what was written, in words."""
    from protocols.studyfile import StudyFile, StudyHeader  # HDF5, which no window waits for

    if path.suffix == ".csv":
        study.run().to_csv(path)
    else:
        with StudyFile(path, StudyHeader.of(study)) as file:
            for start, block in study.blocks():
                file.write(start, block)
    return f"{path.name}: max − min over {variable}, {study.shape[0]} values"
