"""Driver plug-ins: found by entry point, checked by the documented command; broken ones are reported and skipped."""

import importlib
import logging
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

from app.config.bench_file import ConfigError, load_bench
from app.config.driver_registry import DIGITIZERS, SOURCES, driver_names, load_plug_ins, open_generator
from app.session.bench_connection import connect
from drivers.errors import BenchError, InstrumentError
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.plant.parameters import GeneratorParameters, SimulationParameters
from sim_hardware.testing.__main__ import main as run_contract
from tests.helpers.simulated_bench import simulated

ROOT = Path(__file__).resolve().parents[2]
GUIDE = ROOT / "docs" / "how-to-write-a-driver.md"

NOVEL = """
from drivers.generators.keysight import Keysight33200

class Novel(Keysight33200):
    pass
"""
LACKING = """
class Lacking:
    def some_other(self, drive): ...
"""


def install(folder: Path, monkeypatch: pytest.MonkeyPatch, group: str, **drivers: str) -> None:
    """A package `lab-drivers 1.2` in `folder`, as pip would leave it: entry points and the modules they name."""
    info = folder / "lab_drivers-1.2.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: lab-drivers\nVersion: 1.2\n")
    lines = "".join(f"{name} = {value}\n" for name, value in drivers.items())
    (info / "entry_points.txt").write_text(f"[{group}]\n{lines}")
    monkeypatch.syspath_prepend(str(folder))
    importlib.invalidate_caches()


@pytest.fixture
def lab(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    for name, text in {"novel": NOVEL, "lacking": LACKING, "outdated": "import nidaqmx_of_2009"}.items():
        (tmp_path / f"lab_{name}.py").write_text(text)
    (tmp_path / "lab_typo.py").write_text("def broken(:\n")
    (tmp_path / "lab_exits.py").write_text("raise SystemExit(3)\n")
    install(
        tmp_path,
        monkeypatch,
        SOURCES,
        novel="lab_novel:Novel",
        lacking="lab_lacking:Lacking",
        outdated="lab_outdated:Box",
        typo="lab_typo:Box",
        exits="lab_exits:Box",
        nothing="lab_novel:Missing",
        number="lab_novel:__name__",
    )
    yield tmp_path
    for name in [name for name in sys.modules if name.startswith("lab_")]:
        del sys.modules[name]


def guide_files(folder: Path) -> None:
    """The modules of the guide, written as its reader would."""
    blocks = re.findall(r"```python\n# (\w+\.py)\n(.*?)```", GUIDE.read_text(), re.S)
    assert [name for name, _ in blocks] == ["acme_generator.py", "acme_simulated.py"]
    for name, text in blocks:
        (folder / name).write_text(text)


def contract(folder: Path, *arguments: str) -> subprocess.CompletedProcess[str]:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "sim_hardware.testing", *arguments]
    return subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True, timeout=240)


@pytest.mark.deep
def test_the_guides_own_example_passes_by_the_guides_own_command(tmp_path: Path) -> None:
    guide_files(tmp_path)
    command = re.search(r"^python -m sim_hardware\.testing (.*)$", GUIDE.read_text(), re.M)
    assert command is not None
    done = contract(tmp_path, *command[1].split())
    assert done.returncode == 0, done.stdout + done.stderr
    assert re.search(r"\b1[5-9]|2\d passed", done.stdout)


@pytest.mark.deep
def test_a_driver_that_jumps_fails_the_contract(tmp_path: Path) -> None:
    guide_files(tmp_path)
    file = tmp_path / "acme_generator.py"
    file.write_text(
        file.read_text()
        + "\n    def ramp_to(self, level_v, duration_s):\n        self.dialect.offset_command(level_v).send()\n"
    )
    done = contract(tmp_path, "--source", "acme_simulated:simulated", "-k", "levels_are_reached")
    assert done.returncode == 1
    assert re.search(r"assert [25]\.\d* <= \(0\.05|largest_jump_v=[25]\.", done.stdout), done.stdout


@pytest.mark.parametrize("named", ["nowhere:simulated", "acme_simulated:nothing", "acme_simulated"])
def test_a_factory_that_is_not_there_is_a_sentence(
    named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    guide_files(tmp_path)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(sys, "path", [*sys.path])
    with pytest.raises(SystemExit) as ended:
        run_contract(["--source", named])
    assert ended.value.code == 2
    assert f"'{named}'" in capsys.readouterr().err
    for name in [name for name in sys.modules if name.startswith("acme_")]:
        del sys.modules[name]


def test_the_contract_without_pytest_is_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(sys, "path", [*sys.path])
    monkeypatch.setitem(sys.modules, "pytest", None)
    with pytest.raises(SystemExit) as ended:
        run_contract(["--source", "os:getcwd"])
    assert ended.value.code == 2
    assert capsys.readouterr().err.startswith("The contract suite runs on pytest")


@pytest.mark.deep
def test_the_digitizer_contract_runs_by_the_same_command(tmp_path: Path) -> None:
    (tmp_path / "card.py").write_text(
        "from contextlib import contextmanager\n"
        "from sim_hardware.bench import SimulatedBench\n"
        "from sim_hardware.clock import VirtualClock\n"
        "@contextmanager\n"
        "def simulated():\n"
        "    bench = SimulatedBench(clock=VirtualClock())\n"
        "    yield bench.digitizer(), bench\n"
    )
    done = contract(tmp_path, "--digitizer", "card:simulated")
    assert done.returncode == 0, done.stdout + done.stderr


def test_a_plug_in_is_chosen_by_name_in_a_bench_file(lab: Path) -> None:
    assert "novel" in driver_names(SOURCES)
    file = lab / "bench.toml"
    file.write_text('[generator]\ndriver = "novel"\n[simulation.generator]\nmodel = "33220A"\n')
    with connect(load_bench(str(file))) as laboratory:
        assert type(laboratory.bench.amplifier._source).__name__ == "Novel"


@pytest.mark.parametrize(
    ("name", "says"),
    [
        ("outdated", "cannot be loaded: ModuleNotFoundError: No module named 'nidaqmx_of_2009'"),
        ("typo", "cannot be loaded: SyntaxError"),
        ("exits", "cannot be loaded: SystemExit: 3"),
        ("nothing", "cannot be loaded: AttributeError"),
        ("number", "is not a driver: lab_novel:__name__ cannot be called"),
        ("lacking", r"is not a Source: it lacks is_at_rest\(\), initialize_at_rest\(\), start_drive\(\), stop\(\)"),
    ],
)
def test_a_broken_plug_in_is_a_sentence_where_it_was_chosen(name: str, says: str, lab: Path) -> None:
    config = simulated()
    config = config.model_copy(update={"generator": config.generator.model_copy(update={"driver": name})})
    with pytest.raises(BenchError, match=rf"plug-in driver '{name}' \(lab-drivers 1\.2\) {says}"), connect(config):
        pass
    assert len([p for p in load_plug_ins(SOURCES) if p.problem]) == 6


def test_broken_plug_ins_are_named_and_skipped_where_all_are_looked_through(
    lab: Path, caplog: pytest.LogCaptureFixture
) -> None:
    class Stranger(SimulatedBench): ...

    bench = Stranger(SimulationParameters(generator=GeneratorParameters(model="33220A")), VirtualClock())
    bench._generator_model.identity = "Acme,FG-20,1,1.0"
    with (
        caplog.at_level(logging.WARNING),
        pytest.raises(InstrumentError, match=r"answered as 'Acme FG-20 #1', a model for which there is no driver"),
    ):
        open_generator("auto", bench.link(), bench.clock, 0.05)
    skipped = [record.getMessage() for record in caplog.records]
    assert len(skipped) == 6
    assert all("It was skipped" in line and "lab-drivers 1.2" in line for line in skipped)


def test_a_driver_that_nobody_has_is_told_with_those_there_are(lab: Path) -> None:
    file = lab / "bench.toml"
    file.write_text('[generator]\ndriver = "hp"\n[card]\ndriver = "adc"\n[simulation]\n')
    with pytest.raises(ConfigError) as raised:
        load_bench(str(file))
    assert "line 2: generator.driver: there is no driver 'hp'; choose from auto, keysight-33500" in str(raised.value)
    assert "novel" in str(raised.value)
    assert "line 4: card.driver: there is no driver 'adc'; choose from ni" in str(raised.value)
    assert DIGITIZERS not in str(raised.value)
