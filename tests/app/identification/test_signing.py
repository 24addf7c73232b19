"""Adequacy of an identification, intervals, next measurement, corrected calibration."""

import hashlib
import inspect
import json
import pkgutil
import threading
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import model
from app.cli.main import main
from app.config.bench_file import ConfigError
from app.identification import calibrations
from app.identification.observations import shape_count_of_file
from app.identification.recalibration import Correction, RecalibratedRun
from app.identification.specimen_identification import identify
from drivers.drive_shapes import Sine
from drivers.interfaces import Block
from model.identification.fit_options import FitOptions
from model.identification.paper_chain import PaperChainOptions
from model.parameters import Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import amplifier_response
from protocols.base import EntryStarted, PointMeasured, Protocol, RecordingFinished, RunPaused, RunStatus
from protocols.measurements.membrane_sag import MembraneSag
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run, RunReadError
from protocols.runner.request import RunRequest
from protocols.runner.runner import Runner
from tests.helpers.run_files import begun_run, sine_point
from tests.helpers.simulated_bench import Trigger, laboratory, run, simulated

DWELL = SineDwell(frequencies_hz=(50, 100, 145, 160, 175, 250), record_s=0.1, peak_to_peak_v=4.0)
STEPS = VoltageSteps(levels_v=(1.0, 4.5), repeats=2, rest_s=0.3, read_s=0.3, hold_s=0.5)
SERIAL = "SIM-1"

Made = Callable[..., list[Path]]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A dwell and steps of a simulated bench with this truth; each truth is measured once."""
    known: dict[str, list[Path]] = {}

    def measured(**truth: Any) -> list[Path]:
        key = json.dumps(truth, sort_keys=True)
        if key not in known:
            folder = tmp_path_factory.mktemp("runs")
            with laboratory(simulated(**truth)) as lab:
                known[key] = [run(protocol, folder, lab).path for protocol in (DWELL, STEPS)]
        return known[key]

    return measured


def bench(path: Path, gain_m_per_v: float, serial: str = SERIAL) -> Path:
    path.write_text(
        f'name = "corrected"\n[generator]\nresource = "TCPIP::192.0.2.7::5025::SOCKET"\n[sensor]\nname = "laser"\nserial = "{serial}"\n'
        f'gain_m_per_v = {gain_m_per_v}\ndelay_s = 1e-4\ngain_relative_uncertainty = 0.001\ncalibrated = "2026-11-20"\n'
    )
    return path


# -- adequacy ---------------------------------------------------------------------------------------------------------


@pytest.mark.deep
@pytest.mark.parametrize("truth", [{}, {"modes": 20}], ids=["seven modes", "twenty modes"])
def test_a_truth_that_the_model_has_is_called_adequate(made: Made, truth: dict[str, Any]) -> None:
    found = identify(made(**truth))
    assert found.adequacy is not None
    assert found.adequacy.adequate is True, found.adequacy.message
    assert found.shapes == truth.get("modes", 7)


@pytest.mark.deep
@pytest.mark.parametrize(
    "beyond",
    [{"hysteresis_width": 0.01}, {"creep_per_decade": 0.01}],
    ids=["hysteresis", "creep"],
)
def test_what_the_model_does_not_have_is_noticed(made: Made, beyond: dict[str, float], capsys: Any) -> None:
    runs = made(beyond=beyond)
    found = identify(runs, sheet="none")
    assert found.adequacy is not None
    assert found.adequacy.adequate is False
    assert main(["identify", *map(str, runs), "--sheet", "none"]) == 0
    output = capsys.readouterr().out
    assert found.verdict in output
    assert "Discrepancies between runs and model" in output
    assert "p = 0)" not in output
    assert "next best: find the cause" in output


@pytest.mark.deep
def test_seven_shapes_would_call_a_clamp_loose_that_is_rigid(tmp_path: Path) -> None:
    """Why a real tactor is identified with twenty: what seven lack looks like a clamp that turns."""
    precise = DWELL.model_copy(update={"record_s": 0.4})
    with laboratory(simulated(modes=20)) as lab:
        runs = [run(protocol, tmp_path, lab).path for protocol in (precise, STEPS)]
    few = identify(runs, n=7, sheet="none")
    assert few.adequacy is not None
    assert few.adequacy.adequate is False
    # only the plant's parameters have their number
    with Run(runs[0]) as measured:
        assert measured.record.configuration["simulation"]["modes"] == 20


@pytest.mark.deep
def test_a_real_tactor_is_identified_with_twenty_shapes(made: Made, tmp_path: Path) -> None:
    (path,) = made()[:1]
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes())
    with h5py.File(copy, "r+") as file:
        file["entry/simulated"][()] = False
    assert shape_count_of_file(path) == 7
    assert shape_count_of_file(copy) == 20


def test_default_shape_count_is_one_constant_and_accurate_enough_to_draw() -> None:
    """One default in the whole model but for fits; drawn with it, a tactor moves within 0.4 % of the exact solution, 2 % of nothing seen."""
    defaults = {
        (name, parameter.default)
        for info in pkgutil.walk_packages(model.__path__, "model.")
        for module in [import_module(info.name)]
        for name, thing in vars(module).items()
        if inspect.isfunction(thing) and thing.__module__ == info.name
        for parameter in inspect.signature(thing).parameters.values()
        if parameter.name == "n" and isinstance(parameter.default, int)
    }
    assert len(defaults) > 10
    assert {default for _, default in defaults} == {PaperChainOptions().n}
    f = np.linspace(5.0, 250.0, 50)
    drawn = abs(amplifier_response(Tactor(), f, 2.5).fundamental)
    assert abs(drawn / abs(1000 * exact_response(Tactor(), f)) - 1).max() < 4e-3
    fitted = abs(amplifier_response(Tactor(), f, 2.5, n=FitOptions.n).fundamental)
    assert abs(fitted / abs(1000 * exact_response(Tactor(), f)) - 1).max() < 1.2e-4


# -- intervals and plans ----------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_profiles_and_the_next_best_run_on_the_command_line(made: Made, capsys: Any) -> None:
    runs = [str(path) for path in made()]
    assert (
        main(["identify", *runs, "--plain", "--profile", "c0", "--coverage", "0.9", "--next", "m_add", "--json"]) == 0
    )
    result = json.loads(capsys.readouterr().out)
    at = result["parameters"]["name"].index("c0")
    value, error = result["parameters"]["value"][at], result["parameters"]["standard_error"][at]
    (low,), (high,) = result["profiles"]["low"], result["profiles"]["high"]
    assert [float(low), float(high)] == pytest.approx([value - 1.645 * error, value + 1.645 * error], abs=0.1 * error)
    assert result["next"]["run"][0]
    assert result["adequate"] is True
    assert main(["identify", *runs]) == 0
    result = capsys.readouterr().out
    assert "adequate: the misfit is noise: none of " in result
    assert "next best: " in result


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--profile", "E_m"], "--profile E_m: this parameter was not free in the fit; choose from mu"),
        (["--next", "E_m"], "E_m was not free in this fit"),
        (["--profile", "mu", "--coverage", "95"], "--coverage 95: it must lie between 0 and 1"),
        (["--method", "chain", "--next"], "are for the joint fit"),
        (["--bench", "nowhere.toml"], "cannot be read"),
        (["--bench", "sim"], "give the corrected bench file itself"),
        (["--shapes", "2"], "2 shape functions: choose from 3 to 60"),
    ],
)
def test_what_is_asked_wrongly_is_a_sentence(made: Made, arguments: list[str], message: str, capsys: Any) -> None:
    assert main(["identify", str(made()[0]), *arguments]) == 2
    assert message in capsys.readouterr().err


# -- a corrected calibration ------------------------------------------------------------------------------------------


@pytest.mark.deep
def test_old_runs_are_reduced_anew_with_a_corrected_sensor(made: Made, tmp_path: Path, capsys: Any) -> None:
    """The laser's gain was 2 % off all the time: with the corrected bench file the plant's own coupling comes back."""
    runs = []
    for path in made(sensor={"gain_m_per_v": 1.02e-4}):
        runs.append(tmp_path / path.name)
        runs[-1].write_bytes(path.read_bytes())
    before = [hashlib.sha256(path.read_bytes()).hexdigest() for path in runs]
    truth = Tactor().mu
    wrong = {e.name: e for e in identify(runs, sheet="none").estimates}["mu"]
    assert wrong.value / truth == pytest.approx(1 / 1.02, rel=1e-3)
    corrected = bench(tmp_path / "corrected.toml", 1.02e-4)
    command = [
        "identify",
        *map(str, runs),
        "--bench",
        str(corrected),
        "--sheet",
        "none",
        "--accept",
        "--by",
        "K. Tanaka",
    ]
    assert main(command) == 0
    output = capsys.readouterr().out
    assert f"{runs[0].name} reduced again from its raw samples: gain_m_per_v 0.0001 -> 0.000102" in output
    accepted = calibrations.read_calibrations(tmp_path, "T1").get()
    mu = next(e for e in accepted.estimates if e.name == "mu")
    assert mu.value == pytest.approx(truth, rel=1e-3)
    assert mu.standard_error / abs(mu.value) == pytest.approx(0.001, rel=0.1)  # the corrected gain's own uncertainty
    assert accepted.reduced["sha256"] == hashlib.sha256(corrected.read_bytes()).hexdigest()
    assert accepted.reduced["sensor"]["gain_m_per_v"] == 1.02e-4
    assert [hashlib.sha256(path.read_bytes()).hexdigest() for path in runs] == before
    assert main(["calibration", "show", "T1", "--folder", str(tmp_path)]) == 0
    assert "raw samples reduced again with corrected.toml" in capsys.readouterr().out


def test_calibrations_of_an_older_program_are_read(tmp_path: Path, made: Made, capsys: Any) -> None:
    (path,) = made()[:1]
    copy = tmp_path / path.name
    copy.write_bytes(path.read_bytes())
    assert main(["identify", str(copy), "--accept"]) == 0
    file = tmp_path / "T1.calibrations.json"
    record = json.loads(file.read_text("utf-8"))
    del record["versions"][0]["reduced"]
    file.write_text(json.dumps(record), "utf-8")
    assert calibrations.read_calibrations(tmp_path, "T1").get().reduced == {}


@pytest.mark.deep
@pytest.mark.one_in(2)
@pytest.mark.parametrize(
    "protocol",
    [
        VoltageSteps(levels_v=(1.0, 4.0), repeats=1, rest_s=0.3, read_s=0.3, hold_s=0.5),
        SineDwell(frequencies_hz=(100, 160), record_s=0.1, target_relative_uncertainty=2e-5),
        StaticLoading(weights_kg=(0.1, 0.2), repeats=1, sides="MFC up"),
        MembraneSag(repeats=1),
    ],
    ids=lambda protocol: protocol.name,
)
def test_with_the_same_calibration_every_point_is_the_same(protocol: Protocol, tmp_path: Path) -> None:
    with laboratory() as lab:
        path = run(protocol, tmp_path / "runs", lab).path
        file = tmp_path / "same.toml"
        sensor = lab.bench.sensor
        file.write_text(
            f'name = "same"\n[generator]\nresource = "TCPIP::192.0.2.7::5025::SOCKET"\n[sensor]\nname = "l"\nserial = "{sensor.serial}"\n'
            f"gain_m_per_v = {sensor.gain_m_per_v}\ndelay_s = {sensor.delay_s}\n"
        )
    with Run(path) as was, Correction.from_bench_file(file).open(path) as now:
        assert isinstance(now, RecalibratedRun)
        measured, again = was.points(), now.points()
    assert again.keys() == measured.keys()
    for name, column in measured.items():
        np.testing.assert_array_equal(again[name], column, err_msg=name)


@pytest.mark.deep
def test_what_a_pause_cut_off_is_not_part_of_the_point(tmp_path: Path) -> None:
    """Several recordings a frequency: those before the pause were given up, and are not averaged in."""
    protocol = SineDwell(frequencies_hz=(160,), record_s=0.1, target_relative_uncertainty=2e-5)
    pause = threading.Event()
    with laboratory() as lab:
        hold = Trigger(lambda event: isinstance(event, RecordingFinished), pause.set)
        go_on = Trigger(lambda event: isinstance(event, RunPaused), pause.clear)
        ran = run(protocol, tmp_path, lab, hold, go_on, pause=pause)
    assert [type(event) for event in ran.events].count(EntryStarted) == 2
    correction = Correction.from_bench_file(bench(tmp_path / "same.toml", 1e-4))
    with Run(ran.path) as was, correction.open(ran.path) as now:
        kept, (point,) = list(was.recordings()), was.points()["cycles"]
        assert sum(len(r.drive_v) for r in kept) * 160 / kept[0].rate_hz > point + 10  # more was kept than counts
        for name, column in was.points().items():
            np.testing.assert_array_equal(now.points()[name], column, err_msg=name)


def test_a_point_has_the_recordings_since_the_last_start_of_its_entry(tmp_path: Path) -> None:
    file = begun_run(tmp_path, "T7", (100.0,), 5000.0)
    row = file.row_count
    for start in (0, 300):
        file.append_event(EntryStarted(3, "100 Hz", (100.0,)), 0.0)
        file.append_block(Block(4000 + start, np.zeros((2, 300), np.int16)), 0.8)
        for first, last in ((0, 100), (100, 300)):
            file.append_recording((row + start + first, row + start + last), 0, Sine(100.0, 2.5, 2.5, 20), 3)
    file.append_event(PointMeasured(sine_point(100.0), 0, entry=3), 0.0)
    file.finish(RunStatus.COMPLETED, "")
    with RecalibratedRun(file.path, Correction(tmp_path, "", None, None)) as run:
        assert [each.rows for each in run._latest_recordings()[3]] == [(row + 300, row + 400), (row + 400, row + 600)]


@pytest.mark.deep
def test_a_run_that_went_on_is_reduced_with_what_it_went_on_from(tmp_path: Path) -> None:
    protocol = SineDwell(frequencies_hz=(100, 160), record_s=0.1)
    with laboratory() as lab:
        first = run(protocol, tmp_path, lab).path
        request = RunRequest.resuming(first, tmp_path, (1,))
        runner = Runner(request, lab.bench, lab.operator)
        runner.run()
    correction = Correction.from_bench_file(bench(tmp_path / "c.toml", 1.1e-4))
    with Run(runner.path) as was, correction.open(runner.path) as now:
        measured, again = was.points(), now.points()
    last = {int(entry): row for row, entry in enumerate(measured["entry"])}
    for row, entry in enumerate(again["entry"].tolist()):
        assert again["fundamental"][row] == pytest.approx(1.1 * measured["fundamental"][last[entry]], rel=1e-9)
    assert len(again["entry"]) == 2
    first.unlink()
    with correction.open(runner.path) as now, pytest.raises(RunReadError, match="also give the run that it continues"):
        now.points()


def test_a_bench_file_corrects_what_stands_in_it_alone(made: Made, tmp_path: Path) -> None:
    """A corrected amplifier leaves the sensor as it was, and the other way round."""
    (path,) = made()[:1]
    amplifier = tmp_path / "amplifier.toml"
    amplifier.write_text('name = "a"\n[generator]\nresource = "x"\n[amplifier]\nslope_above = 610.0\n')
    with Run(path) as was, Correction.from_bench_file(amplifier).open(path) as now:
        assert now.record.sensor == was.record.sensor
        assert now.record.configuration["amplifier"]["slope_above"] == 610.0
    with Run(path) as was, Correction.from_bench_file(bench(tmp_path / "s.toml", 1.1e-4)).open(path) as now:
        assert now.record.sensor.gain_m_per_v == 1.1e-4
        assert now.record.configuration == was.record.configuration
    neither = tmp_path / "neither.toml"
    neither.write_text('name = "n"\n[generator]\nresource = "x"\n')
    with pytest.raises(ConfigError, match="neither \\[sensor\\] nor \\[amplifier\\]"):
        Correction.from_bench_file(neither)


def test_another_instrument_corrects_nothing(made: Made, tmp_path: Path, capsys: Any) -> None:
    other = bench(tmp_path / "other.toml", 1e-4, serial="7")
    assert main(["identify", *map(str, made()), "--bench", str(other)]) == 2
    output = capsys.readouterr().err
    assert "was measured with the sensor of serial number SIM-1, and" in output
    assert "has serial number 7: give the bench file of that instrument" in output
    without = Correction.from_bench_file(bench(tmp_path / "without.toml", 1e-4, serial=""))
    with pytest.raises(RunReadError, match=r"without\.toml"):
        without.open(made()[0])


def test_a_point_whose_raw_samples_are_missing_is_told_and_not_left_out(
    made: Made, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    whole = RecalibratedRun._latest_recordings
    monkeypatch.setattr(RecalibratedRun, "_latest_recordings", lambda run: {**whole(run), 1: []})
    with (
        Correction.from_bench_file(bench(tmp_path / "same.toml", 1e-4)).open(made()[0]) as run,
        pytest.raises(RunReadError, match=made()[0].name),
    ):
        run.points()
