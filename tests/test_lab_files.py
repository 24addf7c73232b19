"""Protocol and drivers written for version 0.1.0 work in this version (tests/data/lab/README.md)."""

import importlib
import json
import os
import subprocess
import sys
import tomllib
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import pytest

ROOT = Path(__file__).parents[1]
LAB = Path(__file__).parent / "data" / "lab"
PROTOCOL = str(LAB / "lab_protocol.py")
SIM = ("--bench", "ideal", "--speed", "max", "--seed", "3", "--out", "runs", "--specimen", "T1")

OLD_NAMES_WARN = True
"""Whether the old names give a DeprecationWarning."""


@contextmanager
def old_names() -> Iterator[None]:
    """Expects the deprecation warnings of this version: none yet, or at least one and nothing else."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        yield
    assert {warning.category for warning in caught} == ({DeprecationWarning} if OLD_NAMES_WARN else set()), caught


def program(*arguments: str) -> int:
    """What the command line of this version does, wherever its module is."""
    scripts = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]["scripts"]
    module = importlib.import_module(scripts["tactor-bench"].partition(":")[0])
    code: int = module.main(list(arguments))
    return code


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """An empty working folder; whatever was loaded of the lab is forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith(("lab_", "tactor_bench_protocol_lab"))]:
        del sys.modules[name]
    registry = importlib.import_module("protocols.registry")
    registry.PROTOCOLS.pop("lab-steps", None)


@pytest.fixture
def installed(monkeypatch: pytest.MonkeyPatch) -> None:
    """The lab's package with its entry points."""
    monkeypatch.syspath_prepend(str(LAB))
    importlib.invalidate_caches()


def the_run(folder: Path, before: frozenset[Path] = frozenset()) -> Path:
    (new,) = set(folder.glob("runs/*.h5")) - before
    return new


@pytest.mark.deep
def test_the_lab_protocol_is_run_shown_and_resumed(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with old_names():
        assert program("protocols", PROTOCOL) == 0
        assert "levels_v = 3, 4 V" in capsys.readouterr().out
        assert program("run", PROTOCOL, *SIM, "--json") == 0
        events = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
        first = the_run(folder)
        assert program("show", str(first), "--picture", "lab.png") == 0
        assert "displacement per volt: " in capsys.readouterr().out
        again = ("--again", "4", "--protocol", PROTOCOL)
        assert program("resume", str(first), *again, *SIM) == 0
    noted = [event["text"] for event in events if event["event"] == "Noted"]
    assert "the room: quiet" in noted
    assert noted.count("the lab's own remark") == 1
    begun = [event["label"] for event in events if event["event"] == "EntryBegan"]
    assert begun == ["3 V", "3 V", "4 V", "3.5 V"]  # once again, and one more at the end
    assert "fix-mass" in [event["prompt"]["action"] for event in events if event["event"] == "Asked"]
    with h5py.File(first) as file:
        points = file["entry/points"]
        assert points["level"][:].round(2).tolist() == [3.0, 4.0, 3.5]
        assert (points["displacement"].attrs["units"], points["sine"][0] > 1e-6) == ("m", True)
        assert len(file["entry/curves"]) == 3
        assert file["entry/estimates/displacement_per_volt/value"][()] == pytest.approx(600 * 2.37886e-7, rel=2e-2)
    with h5py.File(the_run(folder, frozenset([first]))) as file:
        assert file["entry/points/entry"][:].tolist() == [0, 1, 2, 1]


@pytest.mark.deep
@pytest.mark.usefixtures("installed")
def test_the_lab_protocol_is_found_by_its_entry_point(folder: Path) -> None:
    with old_names():
        assert program("run", "lab-steps", *SIM, "--set", "levels_v=3") == 0
    with h5py.File(the_run(folder)) as file:
        assert file["entry/protocol"].asstr()[()] == "lab-steps"


@pytest.mark.one_in(2)
@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("driver", ["lab-derived", "lab-whole"])
def test_a_lab_driver_drives_the_simulated_bench(driver: str, folder: Path) -> None:
    bench = folder / "bench.toml"
    bench.write_text(
        f'[generator]\ndriver = "{driver}"\n[sensor]\ndelay_s = 1e-4\n[simulation.generator]\nmodel = "33220A"\n'
    )
    few = ("--set", "frequencies_hz=100,160", "--set", "record_s=0.1")
    with old_names():
        assert program("run", "sine-dwell", "--bench", "bench.toml", *SIM[2:], *few) == 0
        dwell = the_run(folder)
        quick = ("--set", "levels_v=3,4", "--set", "repeats=1", "--set", "hold_s=2")
        assert program("run", "voltage-steps", "--bench", "bench.toml", *SIM[2:], *quick) == 0
    with h5py.File(dwell) as file:
        configuration = json.loads(file["entry/configuration"].asstr()[()])
        assert configuration["generator"]["driver"] == driver
        assert file["entry/points/fundamental"][:].min() > 100e-6
        assert not (file["entry/points/quality"][:].astype(int) & ~32).any()


@pytest.mark.deep
@pytest.mark.parametrize("driver", ["LabGenerator", "WatchedGenerator"])
def test_a_lab_driver_passes_the_contract_by_its_old_command(driver: str, folder: Path) -> None:
    (folder / "lab_simulated.py").write_text(
        "from contextlib import contextmanager\n"
        f"from lab_drivers import {driver}\n"
        "from sim_hardware.bench import VirtualBench\n"
        "from sim_hardware.clock import VirtualClock\n"
        "from sim_hardware.truth import BenchTruth, GeneratorTruth\n"
        "@contextmanager\n"
        "def simulated():\n"
        '    bench = VirtualBench(BenchTruth(generator=GeneratorTruth(model="33220A")), VirtualClock())\n'
        f"    source = {driver}(bench.link(), bench.clock)\n"
        "    yield source, bench, bench.clock\n"
        "    source.close()\n"
    )
    environment = {**os.environ, "PYTHONPATH": f"{ROOT}{os.pathsep}{LAB}"}
    command = [sys.executable, "-m", "sim_hardware.contract", "--source", "lab_simulated:simulated"]
    done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout + done.stderr
