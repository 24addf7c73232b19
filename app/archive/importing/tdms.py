"""TDMS reader: the channels of one group as columns, read with npTDMS."""

import logging
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from app.archive.importing.import_table import ImportTable, TableColumn, split_heading
from app.common import truncate_text
from protocols.base import TableImportError

SIGNATURE = b"TDSm"
UNIT_PROPERTIES = ("unit_string", "NI_UnitDescription")
INCREMENT_PROPERTY = "wf_increment"
"""Seconds between two samples of a waveform channel."""


def read_tdms(path: Path) -> ImportTable:
    """Read the channels of the only group with channels; waveforms get a column of times.

    Raises:
        TableImportError: it cannot be read, npTDMS is not installed, or it has several groups.
    """
    try:
        from nptdms import TdmsFile
    except ModuleNotFoundError:
        raise TableImportError(
            f"{path} is a TDMS file, which needs the library npTDMS; install it with: pip install 'tactor-bench[formats]', or save the table as CSV"
        ) from None
    logging.getLogger("nptdms").setLevel(logging.ERROR)  # a file that is cut off is reported below
    try:
        file = TdmsFile.read(path)
        if file.file_status.incomplete_final_segment:
            raise TableImportError(f"{path} is a TDMS file that is cut off; copy it again, or save the table as CSV")
        groups = {group.name: group.channels() for group in file.groups() if group.channels()}
        if not groups:
            raise TableImportError(f"{path} is a TDMS file without channels, or cut off; copy it again")
        if len(groups) != 1:
            names = ", ".join(map(repr, groups))
            raise TableImportError(f"{path} has the groups {names}; give a file with one group of channels")
        (channels,) = groups.values()
        columns = tuple(_columns(channels))
    except TableImportError:
        raise
    except Exception as error:  # noqa: BLE001 - any error of npTDMS by a damaged file
        raise TableImportError(
            f"{path} is not a readable TDMS file ({truncate_text(str(error) or type(error).__name__)}); copy it again, or save the table as CSV"
        ) from None
    if not columns:
        raise TableImportError(f"{path} holds no channels of numbers; save the columns as channels")
    rows = max(len(column.cells) for column in columns)
    return ImportTable(path, columns, range(1, rows + 1), "sample {}")


def _columns(channels: Any) -> Iterator[TableColumn]:
    """Yield the channels of numbers, after their times if they are waveforms."""
    steps = {
        float(channel.properties[INCREMENT_PROPERTY])
        for channel in channels
        if INCREMENT_PROPERTY in channel.properties
    }
    names = {channel.name.casefold() for channel in channels}
    if len(steps) == 1 and not any("time" in name for name in names) and (step := steps.pop()) > 0:
        longest = max(len(channel) for channel in channels)
        yield TableColumn("time [s]", "time", "s", (step * np.arange(longest)).tolist())
    for channel in channels:
        values = np.asarray(channel[:])
        if values.dtype.kind not in "iuf":
            continue
        name, unit = split_heading(channel.name)
        stated = next((str(channel.properties[p]) for p in UNIT_PROPERTIES if channel.properties.get(p)), None)
        yield TableColumn(channel.name, name if unit else channel.name, unit or stated, values.astype(float).tolist())
