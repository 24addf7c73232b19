"""Fuzz targets: each kind of file, its undamaged originals, and the commands and functions that read it."""

import random
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np

from app.archive.catalogue import Catalogue
from app.archive.replay import load_run, read_measured_response
from app.campaign import Campaign
from app.campaign.plan import CampaignError
from app.cli.main import main
from app.config import ConfigError, load_bench
from app.identification.observations import ObservationError, amplifier_of, read_observations, shape_count_of_file
from app.report.limits import LimitsError, read_limits
from app.report.runs import _read_report_run
from model import ParameterError
from protocols.resume import find_entries, load_resumable
from protocols.runfile.reader import RunReadError
from tactor_bench import open_run
from tests.helpers.fuzz_cases import (
    DATA,
    damage_run,
    damaged_bytes,
    damaged_json,
    damaged_record,
    damaged_table,
    damaged_toml,
    json_text,
)
from tests.helpers.run_files import finished_run

OUT = "out"


def _identify(path: Path) -> None:
    read_observations([path])
    amplifier_of([path])
    shape_count_of_file(path)


def _list(path: Path) -> int:
    """List the folder with the damaged run, a good run and its notes: both are in the list."""
    catalogue = Catalogue(path.parent, path.parent / "index.sqlite")
    catalogue.scan()
    listed = {entry.path for entry in catalogue.entries()}
    assert "good.h5" in listed, listed
    with mock.patch("app.archive.catalogue.index_path", lambda folder: folder / "index.sqlite"):
        return main(["runs", str(path.parent)])


def _api(path: Path) -> None:
    run = open_run(path)
    print(repr(run), len(run.points), run.estimates, run.series, len(run.log), len(run.traces))
    run.trace(0.0, 0.01)


def _report(path: Path) -> None:
    catalogue = Catalogue(path.parent, path.parent / "index.sqlite")
    catalogue.scan()
    for entry in catalogue.entries():
        _read_report_run(path.parent / entry.path, entry, ())


def _command(*words: str) -> Callable[[Path], int]:
    return lambda path: main([word.format(path=path, out=path.parent / OUT) for word in words])


RUN_READERS: tuple[Callable[[Path], Any], ...] = (
    _command("show", "{path}"),
    _command("show", "--json", "{path}"),
    _command("export", "{path}", "--out", "{out}"),
    _command("export", "{path}", "--out", "{out}", "--format", "json"),
    _command("export", "{path}", "--out", "{out}", "--format", "mat"),
    lambda path: main(["compare", str(path), str(path.with_name("good.h5"))]),
    _list,
    load_run,
    read_measured_response,
    _identify,
    load_resumable,
    lambda path: find_entries(path, ("flagged",)),
    _api,
    _report,
)


def _campaign(path: Path) -> None:
    campaign = Campaign.open_file(path)
    campaign.item_states()
    for item in campaign.items:
        campaign.protocol_for(item)


def _settings(path: Path) -> int:
    return main(["model", "parameters", "--set", f"@{path}"])


@dataclass(frozen=True)
class Target:
    """A kind of file: share of the cases, originals, damage, and what reads it."""

    share: float
    originals: Callable[[Path], list[Path]]
    damage: Callable[[Path, random.Random], None]
    readers: tuple[Callable[[Path], Any], ...]


def _by_bytes(damage: Callable[[bytes, random.Random], bytes]) -> Callable[[Path, random.Random], None]:
    return lambda path, rng: path.write_bytes(damage(path.read_bytes(), rng)) and None


def _data(*names: str) -> Callable[[Path], list[Path]]:
    return lambda _: [DATA / name for name in names]


def _runs(folder: Path) -> list[Path]:
    return [*sorted((DATA / "runs").glob("*.h5")), finished_run(folder, "T7", (100.0, 130.0, 160.0))]


def _tables(folder: Path) -> list[Path]:
    table, trace = folder / "amplitudes.csv", folder / "trace.csv"
    table.write_text("frequency [Hz],peak_to_peak [um]\n" + "".join(f"{f},{f / 3}\n" for f in range(50, 200, 5)))
    time_s = np.arange(400) / 2000
    rows = (f"{t},{2.5 + np.sin(600 * t)},{np.cos(600 * t)}\n" for t in time_s)
    trace.write_text("time [s],drive [V],displacement [um]\n" + "".join(rows))
    return [table, trace]


def _notes(folder: Path) -> list[Path]:
    path = folder / "good.notes.json"
    path.write_text('{"tags": ["good", "second try"], "note": "new glue"}')
    return [path]


def _mat(folder: Path) -> list[Path]:
    from scipy.io import savemat

    plain, export = folder / "plain.mat", folder / "export.mat"
    savemat(plain, {"frequency_Hz": np.arange(50.0, 60.0), "peak_to_peak_um": np.ones(10)})
    about = {"specimen": "T7", "protocol": "sine-dwell", "parameter_record_s": 0.3, "simulated": 1}
    points = {
        "frequency": np.arange(50.0, 60.0),
        "peak_to_peak": np.ones(10) * 1e-6,
        "units": {"frequency": "Hz", "peak_to_peak": "m"},
    }
    savemat(export, {"about": about, "points": points})
    return [plain, export]


def _damage_mat(path: Path, rng: random.Random) -> None:
    from scipy.io import loadmat, savemat

    if rng.random() < 0.6:
        path.write_bytes(damaged_bytes(path.read_bytes(), rng))
        return
    whole = {name: value for name, value in loadmat(path, simplify_cells=True).items() if not name.startswith("__")}
    changed = damaged_record({k: v if not isinstance(v, np.ndarray) else v.tolist() for k, v in whole.items()}, rng)
    try:
        savemat(path, changed if isinstance(changed, dict) else {"x": 1.0}, long_field_names=True)
    except Exception:  # noqa: BLE001 - this is no MAT content: damage the bytes instead
        path.write_bytes(damaged_bytes(path.read_bytes(), rng))


def _damage_settings(path: Path, rng: random.Random) -> None:
    record = {"L": 0.05, "c0": 10, "delta": "0.02", "k2": 8.7e-3}
    text = b"\n".join(f"{k} = {v!r}".encode() for k, v in record.items())
    path.write_bytes(json_text(damaged_record(record, rng), rng) if rng.random() < 0.5 else damaged_toml(text, rng))


TARGETS: dict[str, Target] = {
    "run": Target(0.62, _runs, damage_run, RUN_READERS),
    "bench": Target(0.08, _data("bench.toml"), _by_bytes(damaged_toml), (lambda p: load_bench(str(p)).simulated,)),
    "limits": Target(0.05, _data("limits.toml"), _by_bytes(damaged_toml), (read_limits,)),
    "campaign": Target(0.06, _data("runs/T1.campaign.json"), _by_bytes(damaged_json), (_campaign,)),
    "calibration": Target(
        0.05,
        _data("runs/T1.calibrations.json"),
        _by_bytes(damaged_json),
        (lambda p: main(["calibration", "show", "T1", "--folder", str(p.parent)]),),
    ),
    "notes": Target(0.05, _notes, _by_bytes(damaged_json), (_list,)),
    "table": Target(0.06, _tables, _by_bytes(damaged_table), (_command("import", "{path}", "--out", "{out}"),)),
    "settings": Target(0.02, _data("explore.toml"), _damage_settings, (_settings,)),
    "mat": Target(0.01, _mat, _damage_mat, (_command("import", "{path}", "--out", "{out}"),)),
}

EXPECTED = (RunReadError, ObservationError, ConfigError, LimitsError, CampaignError, ParameterError)
"""Errors whose message is a sentence for the operator."""


class Originals:
    """The undamaged files, made once."""

    def __init__(self, folder: Path) -> None:
        (folder / "good").mkdir(parents=True, exist_ok=True)
        self.good = finished_run(folder / "good", "good").rename(folder / "good" / "good.h5")
        self.index = folder / "index.sqlite"
        """Catalogue with the good run, so that a case reads its own file only."""
        Catalogue(self.good.parent, self.index).scan()
        self.files = {name: target.originals(folder) for name, target in TARGETS.items()}

    def case(self, kind: str, seed: int, folder: Path) -> Path:
        """Write the damaged file of a case into an empty folder, with a good run beside it."""
        rng = random.Random(f"{kind}-{seed}")
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir(parents=True)
        original = self.files[kind][rng.randrange(len(self.files[kind]))]
        path = folder / original.name
        shutil.copy2(self.good, folder / "good.h5")
        shutil.copy(self.index, folder / "index.sqlite")
        shutil.copy(original, path)
        try:
            TARGETS[kind].damage(path, rng)
        except (OSError, ValueError, LookupError, RuntimeError, TypeError):
            path.write_bytes(damaged_bytes(original.read_bytes(), rng))  # h5py cannot do this damage
        return path

    def read(self, kind: str, seed: int, path: Path) -> str:
        """Read a case; return the message of an expected error."""
        readers = TARGETS[kind].readers
        try:
            code = readers[random.Random(seed).randrange(len(readers))](path)
        except EXPECTED as error:
            return str(error)
        assert not isinstance(code, int) or code in (0, 1, 2), code
        return ""
