"""Added mass for a resonance and drive for an amplitude: checked by the closed form and by drawn parameters."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli.main import main
from app.identification.calibrations import Calibrations, write_calibrations
from model import AmplifierMap, Membrane, ParameterError, Specimen, Tactor, skin
from model.response import SITES, amplifier_response, exact_response, natural_frequencies
from model.studies.design import required_drive, required_mass
from model.studies.uncertainty import EstimateSet
from tests.helpers.calibrations import calibration

ERRORS = {"k2": (7.1e-3, 2e-5), "m_add": (7.9e-3, 1e-4), "c0": (150.0, 4.0), "mu": (-1.3e-5, 1e-7)}


def test_the_tactor_with_that_mass_resonates_there() -> None:
    found = required_mass(Specimen(), 160.0, n=20)
    assert found.standard_error is None
    f = np.linspace(140.0, 180.0, 4001)
    peak_hz = f[np.abs(exact_response(replace(Tactor(), m_add=found.value), f)).argmax()]
    assert peak_hz == pytest.approx(160.0, abs=0.1)
    undamped = required_mass(Specimen(), 158.0, undamped=True)
    assert undamped.value == pytest.approx(7.75e-3, abs=0.01e-3)  # settled: 7.75 g, 158.0 Hz
    assert natural_frequencies(replace(Tactor(), m_add=undamped.value))[0] == pytest.approx(158.0, abs=1e-3)
    with pytest.raises(ParameterError, match="it lies lower, or there is none"):
        required_mass(Specimen(membrane=Membrane(), delta=0.0373), 400.0)
    with pytest.raises(ParameterError, match="with the heaviest it lies higher"):
        required_mass(Specimen(), 20.0)


def test_that_drive_gives_the_amplitude_on_the_skin() -> None:
    on = Specimen(membrane=Membrane(), delta=0.0075)
    found = required_drive(on, 200.0, 100e-6, n=7)
    response = amplifier_response(Tactor(), 200.0, found.value / 2, skin=skin(Membrane(), 0.0075), n=7)
    assert response.peak_to_peak[0] == pytest.approx(100e-6, rel=1e-3)
    with pytest.raises(ParameterError, match="amplitude is 0 m"):
        required_drive(on, 200.0, 0.0)


@pytest.mark.deep
def test_the_standard_errors_are_the_scatter_of_drawn_parameters() -> None:
    names = tuple(ERRORS)
    values, errors = np.array(list(ERRORS.values())).T
    estimates = EstimateSet(names, tuple(values), np.diag(errors**2))
    base = Specimen(replace(Tactor(), **dict(zip(names, values, strict=True))))
    mass, drive = required_mass(base, 160.0, estimates), required_drive(base, 200.0, 100e-6, estimates)
    rng, masses, drives = np.random.default_rng(1), [], []
    for _ in range(200):
        drawn = dict(zip(names, rng.normal(values, errors), strict=True))
        tactor = replace(Tactor(), **drawn)
        masses.append(required_mass(Specimen(tactor), 160.0).value)
        drives.append(required_drive(Specimen(tactor), 200.0, 100e-6).value)
    assert mass.standard_error == pytest.approx(np.std(masses), rel=0.15)
    assert drive.standard_error == pytest.approx(np.std(drives), rel=0.15)
    assert drive.value == pytest.approx(np.mean(drives), rel=0.01)


def test_the_command_answers_from_the_calibration_and_says_what_cannot_be_reached(
    ask: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, ERRORS | {"mass_fraction": (0.7, 0.01)}),), 1))
    given = ("--specimen", "T7", "--folder", str(tmp_path))
    got = ask("model", "added-mass", "--frequency", "160 Hz", *given)["added-mass"]
    assert got["value"][2] == pytest.approx(got["value"][0] / 0.7)
    assert got["standard_error"][2] > got["standard_error"][0] / 0.7
    assert got["value"][0] < got["value"][1] < 9e-3
    assert all(low < value < high for low, value, high in zip(got["low"], got["value"], got["high"], strict=True))
    drive = ask("model", "drive", "--amplitude", "100 um", "--frequency", "200 Hz", *given)["drive"]
    assert 0 < drive["standard_error"][0] < 0.1 * drive["value"][0]
    held = ask("model", "drive", *given, "--set", "mu=-1.3e-5")["drive"]
    assert held["standard_error"][0] < drive["standard_error"][0]
    assert main(["model", "drive", "--amplitude", "1 mm", "--elongation", "6.35 mm", *given]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "It cannot be reached: the amplifier takes 5 V peak to peak" in said
    assert "has no parameters of the membrane" in said
    assert main(["model", "drive", "--specimen", "T8", "--folder", str(tmp_path)]) == 2
    assert "T8" in capsys.readouterr().err
    assert AmplifierMap().high_v == 5.0


def test_the_drive_of_least_power_and_the_life_of_a_battery(
    ask: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_calibrations(tmp_path, "T7", Calibrations((calibration(1, ERRORS),), 1))
    given = ("--specimen", "T7", "--folder", str(tmp_path), "--frequencies", "120...160 step 20", "-n", "7")
    asked = ("model", "power", "--battery", "2 W h", "--on-share", "0.25", "--idle", "1 mW", *given)
    assert main([*asked]) == 2
    assert "--loss" in capsys.readouterr().err
    load = ("--capacitance", "1.83 nF +- 0.02 nF", "--loss", "0.03", "--efficiency", "0.7 +- 0.05")
    got = ask(*asked, *load)["power"]
    assert got["waveform"] == ["sine", "square", "belt"]
    assert set(got["frequency"]) <= {120, 140, 160}
    for life, power, error in zip(got["battery_value"], got["driver_value"], got["driver_standard_error"], strict=True):
        assert life == pytest.approx(2 / (0.25 * power + 1e-3))
        assert error > 0.05 / 0.7 * power
    assert main([*asked, "--capacitance", "1.83", "--loss", "0.03"]) == 2


def test_the_margin_is_over_the_threshold_that_is_chosen(
    ask: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = ("model", "frequency-response", "--frequencies", "55,110 Hz", "-n", "7")
    paper, own = ask(*asked)["response"]["margin"], ask(*asked, "--threshold", "25 um")["response"]["margin"]
    assert np.array(own) == pytest.approx(2 * np.array(paper))
    curve = tmp_path / "finger.csv"
    curve.write_text("Hz;um\n50;10\n100;5\n", "utf-8")
    assert ask(*asked, "--threshold", str(curve))["response"]["margin"][1] == pytest.approx(10 * paper[1])
    assert main([*asked, "--threshold", "forearm"]) == 0
    assert "UNPROVEN: the level" in " ".join(capsys.readouterr().out.split())
    curve.write_text("50;ten\n", "utf-8")
    for wrong, said in ((str(curve), "two numbers"), ("nose", "neither a site"), ("missing.csv", "cannot be read")):
        assert main([*asked, "--threshold", wrong]) == 2
        assert said in " ".join(capsys.readouterr().err.split())


@pytest.mark.deep
def test_the_fleet_compares_margins_over_the_threshold_that_is_chosen(ask: Any, tmp_path: Path) -> None:
    dwell = ("run", "sine-dwell", "--speed", "max", "--bench", "ideal", "--specimen", "T7", "--out", str(tmp_path))
    assert main([*dwell, "--set", "frequencies_hz=110,150"]) == 0
    chosen = ("fleet", str(tmp_path), "--quantity", "margin_at_resonance")
    paper, forearm = ask(*chosen), ask(*chosen, "--threshold", "forearm")
    at_150_hz = float(SITES["forearm"].amplitude_at(150.0))
    ratio = forearm["quantities"]["mean"][0] / paper["quantities"]["mean"][0]
    assert ratio == pytest.approx(50e-6 / at_150_hz, rel=1e-3)
