"""Reference page of the run file: objects of a real file, their meanings, and the texts stored as JSON."""

import re
import tempfile
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import h5py

from protocols.base import CheckResult, Outcome, Verdict
from protocols.base.quality import Quality
from protocols.base.reference import ReferenceModel

MEANINGS = {
    "": "the run",
    "blocks": "blocks of the acquisition: first row of the samples, the card's scan, time of arrival",
    "checksums": "digests of all other objects (JSON), written when the run ends: [checksums](#checksums)",
    "configuration": "tables of the bench file, identities of the instruments, commissioning of the source (JSON)",
    "continues": "file of the run that this one continues, relative to this file's folder; empty if none",
    "end_time": "ISO 8601, UTC: start plus elapsed time; empty until then",
    "estimates": "identified quantities",
    "events": "everything that happened (JSON each); a text of more than 1000 bytes continues in rows of kind `+`",
    "host": "name of the computer",
    "instrument": "identities of the instruments as they state them",
    "instrument/displacement_sensor": "calibration of the displacement sensor: m = (volts - zero) * gain",
    "instrument/displacement_sensor/calibrated": "date, ISO 8601",
    "instrument/displacement_sensor/delay": "how much later than the displacement its signal is",
    "instrument/displacement_sensor/delay_uncertainty": "standard uncertainty of the delay; 0: not stated",
    "instrument/displacement_sensor/expires": "date, ISO 8601; empty if not known",
    "instrument/displacement_sensor/gain": "displacement per volt",
    "instrument/displacement_sensor/gain_relative_uncertainty": "standard uncertainty of the gain over the gain",
    "instrument/displacement_sensor/valid_high": "a higher voltage means out of range",
    "instrument/displacement_sensor/valid_low": "a lower voltage means out of range",
    "instrument/displacement_sensor/zero": "voltage at zero displacement",
    "mountings": "last mounting of each part before the first entry (JSON): part, time, who, numbers of the prompt; not changed afterwards",
    "operator": "who measured (NXuser)",
    "operator/name": "name",
    "operator/origin": "how the name is known: given, or the login of the computer",
    "operator/role": "operator",
    "parameters": "parameters of the protocol, SI (JSON)",
    "points": "results, a column each; the default plot",
    "process_id": "number of the process that wrote the file",
    "protocol": "name of the protocol",
    "reason": "how and why the run ended; empty until then",
    "recordings": "recorded rows, quality flags, entry of the plan, drive (JSON)",
    "reference": "model of the free specimen that the verdict compares with (JSON): [reference](#reference-model)",
    "simulated": "whether the bench was simulated",
    "software": "versions of the software that computed the results (JSON)",
    "specimen": "name of the specimen",
    "start_time": "ISO 8601, UTC",
    "status": "how the program ended the run: running, completed, stopped, failed, unsafe",
    "title": "protocol and specimen",
    "trace": "samples of all channels, integer counts of the card",
    "trace/time": "times of the scans; absent from runs without end and those of more than 30 million scans",
    "trace/sample_rate": "rate at which the card sampled",
    "verdict": f"what the run is worth: {', '.join(Outcome)}",
    "verdict_details": "outcome, reasons and checks (JSON), written when the run ends: [verdict](#verdict)",
}
"""By path in /entry; columns and channels state their meaning in the file."""

ESTIMATE = {
    "source": "how it was identified",
    "standard_error": "standard error of the value",
    "value": "identified value",
}

FURTHER = {
    "/entry/curves/NAME_NUMBER": "series of a protocol, such as a response or a loop: NXdata with `title` and columns with units; beside the signal `SIGNAL_errors` (statistical), `SIGNAL_total_errors`, `SIGNAL_fit`, `phase` (rad; the signal is then a modulus), `coherence` and `usable`, where there are any",
    "/entry/earlier": "external link to the run that this one continues; the program itself does not follow it",
    "/entry/requested": "requested values of the parameters that were adapted to the source (JSON); absent if none was",
    "/entry/air_origin": "where temperature and humidity are from: a sensor's identity, or when they were typed; absent if not stated",
    "/entry/instrument/air_temperature/value": "temperature of the air, degrees Celsius; absent if not known",
    "/entry/instrument/air_humidity/value": "relative humidity of the air, 0 to 1; absent if not known",
    "/entry/imported": "imported runs only (JSON): source files with SHA-256, columns and units, cautions",
    "/entry/passes": "NXdata: the points of several passes, such as a membrane series, a line for each elongation; the default plot of such runs",
    "/entry/repaired": "time at which a crashed run was repaired; only such runs have it",
    "/entry/trace/CHANNEL...": "each further input of the card, with the same datasets as `drive`",
}

ATTRIBUTES = {
    "auxiliary_signals": "`trace`, series: plotted beside the signal (NXdata)",
    "axes": "`points`, `trace`, series: column of the horizontal axis (NXdata)",
    "creator": "file: the program",
    "default": "file, entry and `curves`: group of the default plot (NeXus): the series that the protocol states, the lines of a membrane series, or the points",
    "entry": "series: entry of the plan",
    "format": "file: kind of file, `tactor-bench-run`",
    "format_version": "file: version of the format",
    "further_channels": "`trace`: names of the further inputs, in the order of the bench file",
    "kind": "further inputs: what is measured",
    "label": "series: which one of its name",
    "long_name": "meaning and unit of a dataset, the label of its axis (NXdata)",
    "name": "series: kind of series",
    "NX_class": "NeXus class of a group",
    "role": "series: `measured`, `fit`, `model` or `reference`",
    "scaled_units": "channels: unit after scaling",
    "signal": "`points`, `trace`, series: plotted column (NXdata)",
    "terminal": "further inputs: terminal of the card",
    "units": "unit of a dataset; `1` for a pure number",
}


def run_file() -> str:
    """Return the page, with the objects of a simulated run."""
    return "\n".join([*_introduction(), *_flags(), *_objects(), *_tables(), *_texts(), ""])


def _introduction() -> list[str]:
    return [
        "# The run file",
        "",
        "One HDF5 file per run, with NeXus classes: a NeXus viewer opens it with a default plot. The table below lists the contents of the file",
        "of a sine dwell; other protocols have other columns under `points`.",
        "",
        "Raw samples are the card's integer counts. `displacement_scaling_factor` and `displacement_offset` convert them into metres",
        "as defined by NeXus; the card's own polynomial is in `..._scaling_coefficients` (volts).",
        "`status` is `running` until the run ends: a file that still has this status although its program has ended is that of a crashed run.",
        "The file is not touched after its end: what is added later is in the [sidecar](#sidecar).",
        "",
        "The version of the format is the attribute `format_version` of the file (`FORMAT_VERSION` in protocols/runfile/schema.py). A reader",
        "ignores groups, datasets without units, attributes and kinds of events that it does not know; a file of a newer version is",
        "rejected with the advice to install a newer version of the program.",
        "",
        "An imported run also has `/entry/imported` (JSON): source files with SHA-256, columns and units, cautions. It has no",
        "samples, events or instruments, and NaN for values that its table did not contain.",
        "",
    ]


def _flags() -> Iterator[str]:
    yield "`points/quality` is a sum of flags; 0 is good. Flags marked with * are informative; the value remains usable:"
    yield ""
    yield (
        ", ".join(f"{f.value} {(f.name or '').lower().replace('_', ' ')}{'*' if f.usable else ''}" for f in Quality)
        + "."
    )
    yield ""


def _objects() -> list[str]:
    from protocols.measurements.sine_dwell import SineDwell
    from tests.helpers.simulated_bench import laboratory, run

    lines = ["## Objects", "", "| path | type | unit | meaning |", "|---|---|---|---|"]
    with tempfile.TemporaryDirectory() as folder, laboratory() as lab:
        ran = run(SineDwell(frequencies_hz=(100, 150, 160, 170, 200)), Path(folder), lab)
        with h5py.File(ran.path) as file:
            file.visititems(lambda name, item: lines.append(_row(name, item)))
    return lines


def _row(name: str, item: Any) -> str:
    unit, meaning = str(item.attrs.get("units", "")), str(item.attrs.get("long_name", ""))
    if isinstance(item, h5py.Group):
        kind = str(item.attrs.get("NX_class", "group"))
    else:
        size = " x ".join("n" if most is None else str(most) for most in item.maxshape) if item.shape else ""
        kind = "text" if item.dtype.kind in "OS" else str(item.dtype) if item.dtype.names is None else "table"
        kind = f"{kind} [{size}]" if size else kind
    meaning = re.sub(r" [(][^)]*[)]$", "", meaning) or meaning_of(name)
    if not isinstance(item, h5py.Group) and item.dtype.names:
        meaning += "; columns " + ", ".join(item.dtype.names)
    return f"| `/{name}` | {kind} | {unit} | {cell(meaning)} |"


def meaning_of(name: str) -> str:
    """Return the meaning of an object that does not state it in the file."""
    path = name.removeprefix("entry").removeprefix("/")
    if path.startswith("estimates/"):
        return (
            ESTIMATE.get(path.rpartition("/")[2], "")
            if path.count("/") == 2
            else "an identified quantity; the attribute `name` is the given name"
        )
    if path.startswith("instrument/") and path not in MEANINGS:
        return {"name": "identity", "serial": "serial number"}.get(path.rpartition("/")[2], "an instrument")
    if path.startswith("trace/") and path.endswith("_volts_to_units"):
        return "gain and offset: unit = gain * volts + offset"
    return MEANINGS.get(path, "")


def _tables() -> Iterator[str]:
    for title, first, table in (
        ("Further objects of some runs", "path", FURTHER),
        ("Attributes", "attribute", ATTRIBUTES),
    ):
        yield from ["", f"## {title}", "", f"| {first} | meaning |", "|---|---|"]
        yield from (f"| `{name}` | {cell(meaning)} |" for name, meaning in table.items())


def _texts() -> list[str]:
    def names(kind: Any) -> str:
        return ", ".join(f"`{each.name}`" for each in fields(kind))

    return [
        "",
        "## Verdict",
        "",
        f"`verdict` is the outcome alone, for a look with any program. `verdict_details` has {names(Verdict)}. Each check has",
        f"{names(CheckResult)}: a figure of the result, its limits (null: open on that side; a value",
        "that could not be computed is null, too), the remedy, and the outcome of the run if the figure lies outside the limits. It is absent until the run ends, and",
        "from files of format 1 and 2. A verdict that `tactor-bench judge --store` stores later is in the [sidecar](#sidecar).",
        "",
        "## Reference model",
        "",
        f"`reference` has {names(ReferenceModel)}: the parameters of the free tactor and the amplifier's static map (SI), where they come",
        "from, and whether they were identified for this specimen. The verdict compares with them, so that a file gives the same verdict on",
        "every computer.",
        "",
        "## Checksums",
        "",
        "Every table and every channel has HDF5's Fletcher-32 checksums, so that a damaged part cannot be read by any program. `checksums` holds a digest of every",
        "other object, by its path (the file's own is the empty one): BLAKE2b of 8 bytes, hexadecimal, over the parts below, each after its length",
        "(64 bits, little endian). `tactor-bench verify` compares them.",
        "",
        "- kind: `File`, `Group`, `Dataset`, or `link` and `external link`, which are followed by their target only;",
        "- each attribute in the order of the names: name, shape, numpy type, value;",
        "- of a group, the names in it, without `checksums`;",
        "- of a dataset: shape, largest shape, numpy type, chunks, whether it has Fletcher-32; then its value unless it has.",
        "",
        "## Sidecar",
        "",
        "`RUN.notes.json` beside the run holds what is added to it later, and what lists show; it is replaced as a whole. Copy it with the run.",
        "",
        "| key | content |",
        "|---|---|",
        "| `tags`, `note` | tags and free text of the operator |",
        "| `checks` | checks by second persons: name, time, SHA-256 of the run file as it was checked, remark |",
        "| `later_verdict` | verdict that `judge --store` stored: verdict, time, SHA-256 of the run file as it was judged. If the file has changed since, this is reported, and the verdict in the file counts |",
        "| `listed` | the record for lists, which then need not open the run file: `record`, the `digest` of it and of the names of all fields of the version, and `size`, `modified_ns` and `sha256` of the file. It is used if size and time of modification are those of the file, or else the SHA-256 (computed up to 16 MB); otherwise the file is read |",
        "",
        "Files of earlier versions have the list's data behind their HDF5 data (`TBOVRV01`), where HDF5 ignores them. They are not read any more.",
        "",
        "## Where a fact of a run stands",
        "",
        "All facts of a run but its points, series, events and samples are one record, `RunRecord` in protocols/runfile/record.py. A new fact is",
        "a field there, a line in `create_file` (creation.py) or, if it is known at the end only, in `append_results` (results.py), which store it, and a line in",
        "`Run.stored_record` (reader.py), which reads it. Lists, window, report, exports, the sidecar and the Python interface have it from `record`.",
        "",
        "## Journal",
        "",
        "Results are appended through a journal, the hidden file `.NAME.h5.journal` beside the run, so that a killed program leaves all of them or none. It exists",
        "for some milliseconds; one that stays was left by a killed program, and the next start in the folder, or `tactor-bench verify --repair`, applies and removes it. Do not",
        "copy or move a run file without it. It contains `TBJRNL01`, the length of the file afterwards, the length of all pages (64 bits each, little endian), the pages,",
        "each after its place and length, and a BLAKE2b digest of 16 bytes over all of it. An incomplete journal is removed: the file is as it was.",
    ]  # fmt: skip


def cell(text: str) -> str:
    """Return a text as one cell of a table."""
    return " ".join(text.split()).replace("|", "\\|")
