"""Reader of a table file, CSV or MAT."""

import hashlib
from pathlib import Path

from app.archive.importing.csv_table import read_text_table
from app.archive.importing.table import ImportTable, TableReadError
from app.common import NO_PROGRESS, Progress
from protocols.runfile.schema import HDF5_SIGNATURE

MAX_FILE_BYTES = 400_000_000


def read_table(path: Path, progress: Progress = NO_PROGRESS) -> ImportTable:
    """Read the table of a file.

    Raises:
        TableReadError: there is no file, or no table in it.
    """
    try:
        if path.is_file() and path.stat().st_size > MAX_FILE_BYTES:
            raise TableReadError(f"{path} has more than {MAX_FILE_BYTES / 1e6:.0f} MB; cut it into smaller files")
        data = path.read_bytes()
    except FileNotFoundError:
        raise TableReadError(f"there is no file {path}") from None
    except OSError as error:
        raise TableReadError(f"{path} cannot be read: {error.strerror or error}") from None
    sha256 = hashlib.sha256(data).hexdigest()
    if not data.strip():
        raise TableReadError(
            f"{path} is empty; give a table with a header line, for example 'frequency [Hz],peak_to_peak [um]'"
        )
    if data.startswith(b"MATLAB 7.3 MAT-file"):
        raise TableReadError(
            f"{path} is a MATLAB file of version 7.3, which is HDF5; save it anew: save('file.mat', '-v7')"
        )
    if data.startswith(HDF5_SIGNATURE):
        raise TableReadError(
            f"{path} is an HDF5 file: a run is used as it is; of anything else save the table as CSV or MAT"
        )
    if data.startswith(b"PK\x03\x04"):
        raise TableReadError(f"{path} is a workbook or an archive; save its sheet as CSV")
    if data.startswith(b"MATLAB 5.0 MAT-file") or path.suffix.lower() == ".mat":
        from app.archive.importing.mat_table import read_mat_table  # scipy.io takes a while, and CSV needs none of it

        return read_mat_table(path, sha256)
    return read_text_table(path, sha256, data, progress)
