"""Comparison of recordings: what the program writes and prints on the simulated bench for fixed seeds.

    python tests/compare_runs.py record BEFORE --checkout ../before
    python tests/compare_runs.py record AFTER
    python tests/compare_runs.py compare BEFORE AFTER

Every protocol is run with a fixed seed on the virtual clock. Run files, JSON, CSV and text are compared value by value; the
exit code is 1 where something differs that neither `VOLATILE` nor `RENAMED` names. Only the command line and the files are
used, so that two versions can be compared whose modules have other names.
"""

import argparse
import csv
import json
import math
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

RENAMED: dict[str, str] = {
    "wanted": "target_relative_uncertainty",
    "what was driven before the runs": "drive before the runs",
}
"""Names that the changelog announces, old to new: keys, columns, HDF5 names and whole text values of the recording before."""

VOLATILE = {
    "start_time": "wall clock",
    "end_time": "wall clock",
    "created": "wall clock",
    "accepted": "wall clock, in calibrations",
    "duration_s": "wall clock from start_time to end_time, in lists of runs",
    "size_bytes": "the text of a time stamp changes the file's size",
    "host": "computer",
    "process_id": "process",
    "software": "versions of the program and of its libraries",
    "version": "version of the program, in calibrations",
    "sha256": "hash of a run file, which holds time stamps",
}
"""Keys, columns and HDF5 names that are not compared, and why they differ between two recordings of one version."""

CLOCKS = (
    (re.compile(r"\d{8}T\d{6}Z"), "<time>"),
    (re.compile(r"\d{4}-\d\d-\d\d[T ]\d\d:\d\d(:\d\d(\.\d+)?)?(Z|[+-]\d\d:\d\d)?"), "<time>"),
    (re.compile(r"\b[0-9a-f]{16,64}\b"), "<hash>"),
)
"""What is replaced in every text before it is compared."""

SIDECAR = ".notes.json"

SEED = ["--bench", "ideal", "--speed", "max", "--seed", "3"]

SHORT: dict[str, list[str]] = {
    "static-loading": ["weights_kg=0.05,0.2", "repeats=2"],
    "mass-resonance": ["masses_kg=0.00175,0.00475", "sweep_s=40", "low_hz=60"],
    "voltage-steps": ["repeats=2", "hold_s=2", "levels_v=0.5,1.5,3.5,5"],
    "hysteresis": ["frequencies_hz=0.5,2,5", "cycles=3"],
    "sine-dwell": [],
    "square-dwell": ["frequencies_hz=60,160"],
    "membrane-series": ["elongations_m=0,0.00254", "frequencies_hz=50,125,160,200"],
    "membrane-sag": ["repeats=2"],
    "sweep": [],
    "free-decay": [],
    "latency": ["frequencies_hz=150", "repeats=2"],
    "wiring-check": [],
}
"""Every protocol of the program, with settings that keep a run short."""

TABLE = "frequency [Hz];peak to peak [um]\n100;760,5\n140;1010,2\n150;1154\n155;1180\n160;1166,4\n180;905\n"


CORRECTED = '[sensor]\ngain_m_per_v = "0.102 mm/V"\ndelay_s = "110 us"\nserial = "SIM-1"\n[simulation]\n'
"""A bench file with another calibration of the sensor than the runs were measured with."""


@dataclass(frozen=True)
class Step:
    """One command: its output goes to `name` plus .json, .jsonl or .txt; `keep` is the name of the run file it makes."""

    name: str
    arguments: Sequence[str]
    keep: str = ""
    code: int = 0


def steps() -> Iterator[Step]:
    """Every command of a recording, in order."""
    for protocol, settings in SHORT.items():
        chosen = [part for setting in settings for part in ("--set", setting)]
        yield Step(f"run-{protocol}.jsonl", [*_run(protocol), *chosen, "--json"], keep=protocol)
    dwell, few = "runs/sine-dwell.h5", ["--set", "frequencies_hz=100,150,165,200"]
    yield Step("run-text.txt", [*_run("sine-dwell"), *few], keep="text")
    yield Step("run-stuck.jsonl", [*_run("sine-dwell"), *few, "--json", "--fault", "sensor-stuck@2"], keep="stuck")
    fault = ["--fault", "card-unplugged@3"]
    yield Step("run-unplugged.jsonl", [*_run("sine-dwell"), *few, "--json", *fault], keep="unplugged", code=3)
    yield Step("resume-again.jsonl", ["resume", dwell, "--again", "155,160", *_bench(), "--json"], keep="again")
    yield Step("resume-rest.jsonl", ["resume", "runs/unplugged.h5", *_bench(), "--json"], keep="resumed")
    yield Step("check.json", ["check", *_bench(), "--json"], keep="check")
    yield Step("demo.txt", ["demo", *_bench(), "--no-window"], keep="demo")
    table = ["import", "table.csv", "--as", "sine-dwell", "--specimen", "T1", "--set", "peak_to_peak_v=5 V"]
    when = ["--measured", "2019-05-04T15:30", "--uncertainty", "peak_to_peak=1 %", "--out", "runs", "--json"]
    yield Step("import-dry.json", [*table, *when, "--dry-run"])
    yield Step("import.json", [*table, *when], keep="imported")
    made = [*SHORT, "stuck", "unplugged", "again", "resumed", "imported"]
    for name in made:
        yield Step(f"show-{name}.json", ["show", f"runs/{name}.h5", "--json"])
        yield Step(f"show-{name}.txt", ["show", f"runs/{name}.h5"])
    every = [f"runs/{name}.h5" for name in made]
    yield Step("export-csv.txt", ["export", *every, "--format", "csv", "--out", "csv"])
    yield Step("export-json.txt", ["export", *every, "--format", "json", "--out", "json"])
    yield Step("runs.json", ["runs", "runs", "--json", "--all"])
    yield Step("runs-search.json", ["runs", "runs", "--json", "--protocol", "sine-dwell", "--status", "completed"])
    yield Step("protocols.json", ["protocols", "--json"])
    for protocol in SHORT:
        yield Step(f"protocol-{protocol}.json", ["protocols", protocol, "--json"])
    yield Step("faults.json", ["faults", "--json"])
    yield Step("compare-again.json", ["compare", dwell, "runs/again.h5", "--json"])
    yield Step("compare-imported.json", ["compare", dwell, "runs/imported.h5", "--json"])
    yield Step("compare.txt", ["compare", dwell, "runs/again.h5"])
    yield from _identification()
    yield from _campaign()
    yield from _model()


def _bench() -> list[str]:
    return [*SEED, "--out", "runs", "--specimen", "T1"]


def _run(protocol: str) -> list[str]:
    return ["run", protocol, *_bench()]


def _identification() -> Iterator[Step]:
    four = [f"runs/{name}.h5" for name in ("static-loading", "mass-resonance", "voltage-steps", "sine-dwell")]
    yield Step("identify.json", ["identify", *four, "--json"])
    yield Step("identify.txt", ["identify", *four])
    yield Step("identify-chain.json", ["identify", *four, "--method", "chain", "--json"])
    yield Step("identify-membrane.json", ["identify", *four, "runs/membrane-series.h5", "--json"])
    yield Step("identify-profile.json", ["identify", *four, "--profile", "k2", "--json"])
    yield Step("identify-next.json", ["identify", *four, "--next", "--json"])
    yield Step("identify-robust.json", ["identify", four[-1], "--free", "m_add,c0", "--robust", "--json"])
    corrected = ["--bench", "corrected.toml"]  # raw samples are reduced anew
    yield Step("identify-corrected.json", ["identify", *four, *corrected, "--json"])
    by = ["--by", "K. Tanaka", "--note", "first"]
    yield Step("calibration-1.json", ["calibration", "accept", *four, *by, "--json"])
    yield Step("calibration-2.json", ["calibration", "accept", *four[:3], "--by", "A. Meier", "--json"])
    beside = ["--folder", "runs", "--json"]
    yield Step("calibration-show.json", ["calibration", "show", "T1", *beside])
    yield Step("calibration-diff.json", ["calibration", "diff", "T1", "1", "2", *beside])
    yield Step("calibration-use.json", ["calibration", "use", "T1", "1", *beside])
    yield Step("report.json", ["report", "T1", "--folder", "runs", "--out", "report", "--json"])
    yield Step("limits.txt", ["report", "--new-limits", "limits.toml"])
    limits = ["--limits", "limits.toml", "--out", "limited"]
    yield Step("report-limits.json", ["report", "T1", "--folder", "runs", *limits, "--json"], code=1)


def _campaign() -> Iterator[Step]:
    bench = [*SEED, "--out", "campaign", "--specimen", "T2", "--json"]
    yield Step("campaign-new.json", ["campaign", "new", *bench])
    yield Step("campaign-rehearse.json", ["campaign", "rehearse", *bench])
    yield Step("campaign-run.jsonl", ["campaign", "run", "wiring", *bench])
    yield Step("campaign-sag.jsonl", ["campaign", "run", "sag", *bench])
    yield Step("campaign-status.json", ["campaign", "status", *bench])
    yield Step("campaign-accept.json", ["campaign", "accept", "sag", *bench])
    yield Step("campaign-skip.json", ["campaign", "skip", "membrane", "--reason", "no membrane", *bench])
    yield Step("campaign-repeat.json", ["campaign", "repeat", "wiring", *bench])
    yield Step("campaign-move.json", ["campaign", "move", "sag", "--before", "loading", *bench])
    yield Step("campaign-end.json", ["campaign", "status", *bench])
    yield Step("campaign-end.txt", ["campaign", "status", *bench[:-1]])


def _model() -> Iterator[Step]:
    skin = ["--elongation", "1.27 mm"]
    yield Step("model-parameters.json", ["model", "parameters", *skin, "--json"])
    yield Step("model-modes.json", ["model", "modes", "--set", "m_add=5 g", *skin, "--json", "--csv", "modes.csv"])
    yield Step("model-modes.txt", ["model", "modes"])
    yield Step("model-static.json", ["model", "static", "--load", "200 g", "--json", "--csv", "static.csv"])
    response = ["model", "frequency-response", "--exact", "--json", "--csv", "response.csv"]
    yield Step("model-response.json", [*response, "--frequencies", "1:500:100"])
    yield Step("model-square.json", ["model", "frequency-response", "--waveform", "square", *skin, "--json"])
    yield Step("model-step.json", ["model", "step", "--json", "--csv", "step.csv"])
    yield Step("model-membrane.json", ["model", "membrane", "--elongation", "0:6.35 mm:6", "--json"])
    yield Step("model-convergence.json", ["model", "convergence", "--shapes", "3,5,10", "--json"])
    for preset in ("fig10", "fig11", "fig12"):
        yield Step(f"study-{preset}.json", ["study", preset, "--json", "--csv", f"{preset}.csv"])
    vary = ["--vary", "E_m=1e5:1e7:3:log", "--vary", "delta=0,0.02", "--frequencies", "50:250:9"]
    yield Step("study.txt", ["study", *vary, "--out", "study.h5"])
    yield Step("study-complex.json", ["study", *vary, "--quantity", "receptance", "--out", "complex.h5", "--json"])
    yield Step("sensitivity.json", ["study", *vary, "--sensitivity", "--samples", "64", "--json"])
    yield Step("figures.json", ["figures", "--out", "figures", "--json"])


def record(folder: Path, program: Sequence[str], environment: Mapping[str, str], only: str = "") -> None:
    """Run every command in `folder`, which must not exist yet."""
    folder.mkdir(parents=True)
    folder = folder.resolve()
    (folder / "table.csv").write_text(TABLE, encoding="utf-8")
    (folder / "corrected.toml").write_text(CORRECTED, encoding="utf-8")
    (folder / "answers").mkdir()
    home = folder / "home"
    private = {
        name: str(home / name.lower()) for name in ("XDG_CONFIG_HOME", "XDG_CACHE_HOME", "XDG_DATA_HOME", "HOME")
    }
    surroundings = {
        **os.environ,
        **environment,
        **private,
        "QT_QPA_PLATFORM": "offscreen",
        "COLUMNS": "120",
        "TZ": "UTC",
    }
    unexpected = []
    for step in steps():
        if only and not re.search(only, step.name):
            continue
        began = time.monotonic()
        known = set(folder.glob("runs/*.h5"))
        ended = subprocess.run(
            [*program, *step.arguments], cwd=folder, env=surroundings, capture_output=True, text=True, check=False
        )
        for new in set(folder.glob("runs/*.h5")) - known:
            new.rename(folder / "runs" / f"{step.keep}.h5")
            if (beside := new.with_suffix(SIDECAR)).exists():
                beside.rename(folder / "runs" / f"{step.keep}{SIDECAR}")
        messages = f"exit code {ended.returncode}\n{ended.stderr}"
        for name, text in ((step.name, ended.stdout), (f"{step.name}.err", messages)):
            (folder / "answers" / name).write_text(text.replace(str(folder), "<folder>"), encoding="utf-8")
        note = "" if ended.returncode == step.code else f"  EXIT CODE {ended.returncode}, not {step.code}"
        print(f"{time.monotonic() - began:6.1f} s  {step.name}{note}", flush=True)
        if note:
            unexpected.append(step.name)
            print(ended.stderr[-1000:])
    shutil.rmtree(home, ignore_errors=True)
    if unexpected:
        raise SystemExit(f"other exit codes than expected: {', '.join(unexpected)}")


class Comparison:
    """Compares two recordings; `differences` are sentences with file, path, value before and value after."""

    def __init__(self, ignored: Sequence[str] = (), pictures: bool = False, tolerance: float = 0.0) -> None:
        """Compare all but `ignored` names, bit by bit, or numbers in JSON within a relative `tolerance`."""
        self.ignored = {*VOLATILE, *ignored}
        self.pictures, self.tolerance = pictures, tolerance
        self.differences: list[str] = []
        self.values = 0
        self._file = ""

    def folders(self, before: Path, after: Path) -> None:
        """Compare every file of two recordings."""
        old, new = (
            {
                _clockless(str(p.relative_to(f))): p
                for p in f.rglob("*")
                if p.is_file() and not p.name.endswith(SIDECAR)  # which has size, time and hash of the run file
            }
            for f in (before, after)
        )
        for name in sorted(old.keys() | new.keys()):
            self._file = name
            if name not in old or name not in new:
                self._differ("", "a file" if name in old else "no file", "a file" if name in new else "no file")
            else:
                self.files(old[name], new[name])

    def files(self, before: Path, after: Path) -> None:
        """Compare two files by what they hold."""
        kind = after.suffix
        if kind == ".h5":
            with h5py.File(before, "r") as old, h5py.File(after, "r") as new:
                self._attributes("/", old, new)
                self._groups("", old, new)
            return
        if kind in (".png", ".pdf"):
            if self.pictures and before.read_bytes() != after.read_bytes():
                self._differ("", f"{before.stat().st_size} bytes", f"{after.stat().st_size} other bytes")
            return
        old_text, new_text = before.read_text("utf-8"), after.read_text("utf-8")
        if old_text == new_text and not RENAMED:
            self.values += old_text.count("\n")
            return
        if kind == ".json":
            self.json("", json.loads(old_text), json.loads(new_text))
        elif kind == ".jsonl":
            parsed = ([json.loads(line) for line in text.splitlines()] for text in (old_text, new_text))
            self.json("", *parsed)
        elif kind == ".csv":
            self._tables(old_text, new_text)
        else:
            self._lists("line", old_text.splitlines(), new_text.splitlines())

    def _differ(self, path: str, before: object, after: object) -> None:
        old, new = (text if len(text := str(value)) <= 300 else f"{text[:300]}..." for value in (before, after))
        self.differences.append(f"{self._file}  {path}\n    before: {old}\n    after:  {new}")

    def _is_ignored(self, name: str) -> bool:
        return name in self.ignored

    # -- JSON, CSV, text -----------------------------------------------------------------------------------------------

    def json(self, path: str, before: Any, after: Any) -> None:
        """Compare two JSON values; `path` is their place."""
        if isinstance(before, dict) and isinstance(after, dict):
            old = {_clockless(RENAMED.get(key, key)): value for key, value in before.items()}
            new = {_clockless(key): value for key, value in after.items()}
            for key in (*old, *(key for key in new if key not in old)):
                if self._is_ignored(key):
                    continue
                if key not in old or key not in new:
                    self._differ(f"{path}/{key}", old.get(key, "no such key"), new.get(key, "no such key"))
                else:
                    self.json(f"{path}/{key}", old[key], new[key])
        elif isinstance(before, list) and isinstance(after, list):
            self._lists(path, before, after)
        elif isinstance(before, str) and isinstance(after, str):
            self._texts(path, before, after)
        else:
            self.values += 1
            close = (
                isinstance(before, float)
                and isinstance(after, float)
                and math.isclose(before, after, rel_tol=self.tolerance, abs_tol=self.tolerance**2)
            )
            if not close and (type(before) is not type(after) or before != after):
                self._differ(path, repr(before), repr(after))

    def _lists(self, path: str, before: list[Any], after: list[Any]) -> None:
        if len(before) != len(after):
            self._differ(path, f"{len(before)} entries", f"{len(after)} entries")
        for index, (old, new) in enumerate(zip(before, after, strict=False)):
            self.json(f"{path}[{index}]", old, new)

    def _texts(self, path: str, before: str, after: str) -> None:
        """Compare two texts; JSON within a text, as run files hold it, by its values."""
        self.values += 1
        before = RENAMED.get(before, before)
        if before == after or _clockless(before) == _clockless(after):
            return
        if before[:1] in ("{", "[") and after[:1] in ("{", "["):
            try:
                parsed = json.loads(before), json.loads(after)
            except ValueError:
                pass
            else:
                self.json(path, *parsed)
                return
        self._differ(path, before, after)

    def _tables(self, before: str, after: str) -> None:
        old, new = (list(csv.reader(text.splitlines())) for text in (before, after))
        if len(old) != len(new):
            self._differ("rows", len(old), len(new))
        heads: list[str] = []
        for number, (left, right) in enumerate(zip(old, new, strict=False), start=1):
            if number == 1:
                heads = right
            if len(left) != len(right):
                self._differ(f"row {number}", f"{len(left)} cells", f"{len(right)} cells")
            if left[:1] == right[:1] and self._is_ignored(left[0] if left else ""):
                continue
            for place, (was, now) in enumerate(zip(left, right, strict=False)):
                head = heads[place] if place < len(heads) else str(place)
                if not self._is_ignored(head.split(" ")[0]):
                    self._texts(f"row {number}, {head}", was, now)

    # -- HDF5 ----------------------------------------------------------------------------------------------------------

    def _groups(self, path: str, before: h5py.Group, after: h5py.Group) -> None:
        old = {RENAMED.get(name, name): name for name in before}
        for name in sorted(old.keys() | set(after)):
            where = f"{path}/{name}"
            if self._is_ignored(name):
                continue
            if name not in old or name not in after:
                self._differ(where, "present" if name in old else "missing", "present" if name in after else "missing")
                continue
            links = before.get(old[name], getlink=True), after.get(name, getlink=True)
            if any(isinstance(link, h5py.ExternalLink) for link in links):
                was, now = (f"{type(k).__name__} {getattr(k, 'filename', '')} {getattr(k, 'path', '')}" for k in links)
                self._texts(where, was, now)
                continue
            left, right = before[old[name]], after[name]
            self._attributes(where, left, right)
            if isinstance(left, h5py.Group) and isinstance(right, h5py.Group):
                self._groups(where, left, right)
            elif isinstance(left, h5py.Dataset) and isinstance(right, h5py.Dataset):
                self._datasets(where, left, right)
            else:
                self._differ(where, left, right)

    def _attributes(self, path: str, before: Any, after: Any) -> None:
        old = {RENAMED.get(name, name): value for name, value in before.attrs.items()}
        new = dict(after.attrs.items())
        for name in sorted(old.keys() | new.keys()):
            if name not in old or name not in new:
                self._differ(f"{path}@{name}", old.get(name, "missing"), new.get(name, "missing"))
            else:
                self._arrays(f"{path}@{name}", _array(old[name]), _array(new[name]))

    def _datasets(self, path: str, before: h5py.Dataset, after: h5py.Dataset) -> None:
        for what in ("dtype", "maxshape", "chunks", "compression"):
            if getattr(before, what) != getattr(after, what):
                self._differ(f"{path} ({what})", getattr(before, what), getattr(after, what))
        self._arrays(path, _array(before[()]), _array(after[()]))

    def _arrays(self, path: str, before: np.ndarray, after: np.ndarray) -> None:
        self.values += before.size
        if before.dtype != after.dtype or before.shape != after.shape:
            self._differ(path, f"{before.dtype} {before.shape}", f"{after.dtype} {after.shape}")
            if before.shape[1:] != after.shape[1:] or before.dtype != after.dtype or not before.ndim:
                return
            rows = min(len(before), len(after))  # where a table became longer or shorter, its first other row counts
            before, after = before[:rows], after[:rows]
        if before.dtype.names:
            for name in before.dtype.names:
                if not self._is_ignored(name):
                    self._arrays(f"{path}.{name}", before[name], after[name])
        elif before.dtype.kind in "OSU":
            for index, (old, new) in enumerate(zip(before.ravel(), after.ravel(), strict=False)):
                self._texts(f"{path}[{index}]", _text(old), _text(new))
        elif before.tobytes() != after.tobytes():
            other = np.flatnonzero(before.ravel() != after.ravel())
            index = int(other[0]) if len(other) else 0
            self._differ(f"{path}[{index}], {len(other)} in all", before.ravel()[index], after.ravel()[index])


def _array(value: Any) -> np.ndarray:
    """The value as an array; numpy would make the length of a single text part of its type."""
    return np.array(value, object) if isinstance(value, bytes | str) else np.asarray(value)


def _text(value: Any) -> str:
    return value.decode("utf-8", "replace") if isinstance(value, bytes) else str(value)


def _clockless(text: str) -> str:
    for pattern, instead in CLOCKS:
        text = pattern.sub(instead, text)
    return text


def _program(options: argparse.Namespace) -> tuple[list[str], dict[str, str]]:
    """The command that starts the program, and the variables it needs."""
    if options.checkout is None:
        return shlex.split(options.program), {}
    root = options.checkout.resolve()
    project = tomllib.loads((root / "pyproject.toml").read_text("utf-8"))["project"]
    module, _, function = project["scripts"]["tactor-bench"].partition(":")
    start = f"import sys; from {module} import {function}; sys.argv[0] = 'tactor-bench'; sys.exit({function}())"
    return [sys.executable, "-c", start], {"PYTHONPATH": str(root)}


def main() -> int:
    """Record or compare, depending on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    commands = parser.add_subparsers(required=True, dest="command")
    recording = commands.add_parser("record", help="run every protocol and command, and keep what they write")
    recording.add_argument("folder", type=Path, help="a new folder")
    recording.add_argument(
        "--program",
        default=shlex.quote(str(Path(sys.executable).with_name("tactor-bench"))),
        help="command that starts the program (default: tactor-bench of this Python)",
    )
    recording.add_argument("--checkout", type=Path, help="run the program of this working tree instead")
    recording.add_argument("--only", default="", help="only steps whose name this regular expression finds")
    comparing = commands.add_parser("compare", help="print every difference between two recordings")
    comparing.add_argument("before", type=Path)
    comparing.add_argument("after", type=Path)
    comparing.add_argument(
        "--ignore", nargs="+", default=[], metavar="NAME", help="keys, columns or HDF5 names to leave out"
    )
    comparing.add_argument("--pictures", action="store_true", help="PNG and PDF files must be equal, too")
    options = parser.parse_args()
    if options.command == "record":
        record(options.folder, *_program(options), options.only)
        return 0
    comparison = Comparison(options.ignore, options.pictures)
    comparison.folders(options.before, options.after)
    for difference in comparison.differences:
        print(difference)
    print(f"{comparison.values} values compared, {len(comparison.differences)} differences")
    return 1 if comparison.differences else 0


if __name__ == "__main__":
    sys.exit(main())
