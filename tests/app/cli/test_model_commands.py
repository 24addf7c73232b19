"""`tactor-bench model`: reference numbers on the command line, error messages for unphysical parameters."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.cli.main import main
from app.common.exit_codes import ExitCode
from model.specimen import variable_specs

DWELL = [25, 50, 75, 80, 100, 125, 150, 160, 175, 200, 225, 250]
"""Frequencies of the settled table, Hz; below, its two rows in µm."""
FUNDAMENTAL = [486.8, 522.8, 594.2, 614.4, 724.0, 946.9, 1154.0, 1115.4, 922.2, 595.9, 402.9, 291.6]
PEAK_TO_PEAK = [491.0, 537.4, 702.7, 724.8, 760.1, 953.9, 1154.2, 1115.7, 923.5, 596.8, 403.3, 291.8]


def sheet(path: Path) -> tuple[list[str], np.ndarray]:
    with path.open(encoding="utf-8", newline="") as file:
        head, *rows = csv.reader(file)
    return head, np.array(rows, float)


def test_poles_with_and_without_mass_and_skin(ask: Any) -> None:
    got = ask("model", "modes", "-n", "7")
    assert got["free_poles"]["frequency"][:2] == pytest.approx([158.31, 2278.1], rel=3e-5)
    assert got["free_poles"]["damping_ratio"][:2] == pytest.approx([0.2110, 0.1183], abs=5e-5)
    assert got["undamped"]["free_frequency"][0] == pytest.approx(158.15, abs=0.005)
    assert got["on_skin_poles"]["damping_ratio"][0] > 0.3
    bare = ask("model", "modes", "-n", "7", "--set", "m_add=0 g", "--count", "2")
    assert bare["undamped"]["free_frequency"] == pytest.approx([620.66, 3642.75], rel=1e-5)
    assert bare["units"]["free_frequency"] == "Hz"


def test_the_masses_of_the_resonance_series(ask: Any) -> None:
    expected = [300.9, 250.9, 219.7, 197.8, 181.4, 168.5, 158.0, 149.2, 141.8]
    got = [
        ask("model", "modes", "-n", "7", "--set", f"m_add={1.75 + i} g")["undamped"]["free_frequency"][0]
        for i in range(9)
    ]
    assert got == pytest.approx(expected, abs=0.05)


def test_statics_with_a_weight_and_without(ask: Any) -> None:
    got = ask("model", "static", "--load", "500 g", "--voltage", "1.5 kV")["static"]
    assert got["compliance"] == pytest.approx(1.3790e-4, rel=1e-4)
    assert got["voltage_gain"] == pytest.approx(2.37886e-7, rel=1e-5)
    assert got["load"] == pytest.approx(0.5 * 9.80665)
    assert got["deflection"] == pytest.approx(1.3790e-4 * 4.903325 + 356.83e-6, rel=1e-4)
    stiff = ask("model", "static", "--elongation", "6.35 mm")["static"]
    assert stiff["compliance"] < got["compliance"]


def test_the_settled_table_under_the_amplifier(ask: Any) -> None:
    got = ask("model", "frequency-response", "-n", "7", "--frequencies", ", ".join(map(str, DWELL)) + " Hz")["response"]
    assert got["frequency"] == DWELL
    assert 1e6 * np.array(got["twice_fundamental"]) == pytest.approx(FUNDAMENTAL, abs=0.06)
    assert 1e6 * np.array(got["peak_to_peak"]) == pytest.approx(PEAK_TO_PEAK, abs=0.06)
    assert got["margin"][0] == pytest.approx(491.0 / 50, rel=1e-3)


@pytest.mark.parametrize(("delta", "expected"), [("0", [652.2, 705.9, 447.0]), ("0.75 %", [436.9, 357.4, 257.8])])
def test_the_settled_table_on_the_membrane(delta: str, expected: list[float], ask: Any) -> None:
    got = ask("model", "frequency-response", "-n", "7", "--pre-stretch", delta, "--frequencies", "100:200:3")
    assert 1e6 * np.array(got["response"]["peak_to_peak"]) == pytest.approx(expected, abs=0.15)
    assert got["specimen"]["c_s"] == pytest.approx(165 + 5.48e4 * got["specimen"]["delta"])


def test_elongation_is_pre_stretch_times_length(ask: Any) -> None:
    specimen = ask("model", "static", "--elongation", "6.35 mm")["specimen"]
    assert specimen["delta"] == pytest.approx(0.03735, abs=5e-6)
    assert specimen["k_s"] == pytest.approx(8.480e4, rel=1e-4)
    assert specimen["c_s"] == pytest.approx(2211.9, rel=1e-4)
    longer = ask("model", "static", "--elongation", "6.35 mm", "--set", "L_m=34 cm")["specimen"]
    assert longer["delta"] == pytest.approx(specimen["delta"] / 2)


def test_the_closed_form_beside_the_shapes(ask: Any) -> None:
    got = ask("model", "frequency-response", "-n", "7", "--exact", "--frequencies", "100,158,250")["response"]
    assert 1e6 * np.array(got["exact"]) == pytest.approx([724.52, 1128.59, 290.90], abs=0.006)
    assert 1e6 * np.array(got["twice_fundamental"]) == pytest.approx([723.97, 1130.84, 291.58], abs=0.006)


def test_the_number_of_shapes_keeps_the_accuracy_and_is_reported(ask: Any, capsys: pytest.CaptureFixture[str]) -> None:
    """The paper's seven are 0.5 % off the closed form; a plate of 35 times its stiffness needs 20."""
    got = ask("model", "frequency-response", "--exact", "--frequencies", "100,158,250")
    assert got["shapes"] == 14
    assert got["shape_error"] < 1e-3
    assert got["response"]["twice_fundamental"] == pytest.approx(got["response"]["exact"], rel=1e-3)
    stiff = ask("model", "modes", "--set", "k2=0.0322")  # 35 times k1 of the plate
    assert stiff["shapes"] == 20
    assert ask("model", "step", "--accuracy", "1 %")["shapes"] == 7
    assert main(["model", "modes", "-n", "7"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "0.49 %" in said
    assert main(["model", "modes", "--accuracy", "2"]) == 2
    assert "accuracy is 2" in capsys.readouterr().err


def test_implausible_values_are_questioned_as_imports_do(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "static", "--set", "L=22", "--set", "L1=8", "--set", "L2=15", "--set", "k2=7e-3"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "CAUTION: L is 22 m" in said
    assert "k2 is" not in said
    assert main(["model", "static", "--elongation", "1.27"]) == 0
    assert "CAUTION: delta is 7.471" in " ".join(capsys.readouterr().out.split())
    assert main(["model", "static", "--set", "m_add=0"]) == 0
    assert "CAUTION" not in capsys.readouterr().out
    assert main(["model", "membrane", "--elongation", "1.27"]) == 0
    assert "CAUTION: delta is 7.471" in " ".join(capsys.readouterr().out.split())


@pytest.mark.deep
def test_values_with_which_nothing_can_be_computed_are_questioned(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "modes", "--set", "h_Al=200"]) == 2
    assert "h_Al is 200 m" in capsys.readouterr().err
    assert main(["model", "frequency-response", "--set", "L=22", "--frequencies", "1:250:3"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "CAUTION: 120 shape functions" in said
    assert "CAUTION: L is 22 m" in said


@pytest.mark.deep
def test_latency_of_step_and_sine_onset(ask: Any) -> None:
    got = ask("model", "step", "-n", "7")
    step = got["step"]
    assert step["final"] == pytest.approx(356.8e-6, abs=0.05e-6)
    assert step["to_threshold"] == pytest.approx(0.56e-3, abs=0.01e-3)
    assert step["rise"] == pytest.approx(1.21e-3, abs=0.005e-3)
    assert step["overshoot"] == pytest.approx(0.51, abs=0.005)
    assert got["sine_onset"]["final"] == pytest.approx(1115.4e-6 / 2, rel=1e-4)
    down = ask("model", "step", "--voltage", "-500V")["step"]
    assert down["final"] == pytest.approx(356.8e-6 / 3, abs=0.05e-6)
    faint = ask("model", "step", "--voltage", "100 V", "--threshold", "0.05 mm")["step"]
    assert faint["to_threshold"] is None


def test_the_membrane_sags_less_than_linear_theory_says(ask: Any) -> None:
    got = ask("model", "membrane")["membrane"]
    assert got["elongation"] == pytest.approx([0, 1.27e-3, 2.54e-3, 3.81e-3, 5.08e-3, 6.35e-3])
    assert got["sag"][0] == pytest.approx(3.5e-3, abs=0.05e-3)
    assert got["linear_sag"][0] == pytest.approx(18.8e-3, abs=0.05e-3)
    assert (got["k_point"][0], got["k_s"][0]) == pytest.approx((4.1, 585.6), rel=1e-3)
    assert (got["k_s"][-1], got["c_s"][-1]) == pytest.approx((8.480e4, 2211.9), rel=1e-4)
    weightless = ask("model", "membrane", "--load", "0 N/m", "--pre-stretch", "0")["membrane"]
    assert weightless["sag"] == [0.0]


def test_parameters_are_tabled_with_what_follows(ask: Any) -> None:
    got = ask("model", "parameters", "--set", "L=22 mm", "--set", "E_Al=69 GPa", "--set", "c0=0.2 g/(mm s)")
    assert (got["tactor"]["L"], got["tactor"]["E_Al"], got["tactor"]["c0"]) == pytest.approx((0.022, 69e9, 0.2))
    assert got["derived"]["tau"] == pytest.approx(1.696e-3, rel=1e-3)
    assert got["derived"]["c_bar"] == pytest.approx(6.66, abs=0.005)
    assert {**got["tactor"], **got["skin"], **got["nonideal"], **got["derived"]}.keys() >= variable_specs().keys()
    units = {"k2": "N m^2", "L": "m", "E_Al": "Pa"}
    assert units.items() <= got["units"].items()


def test_convergence_against_the_closed_form(ask: Any) -> None:
    got = ask("model", "convergence")["convergence"]
    assert got["n"] == [3, 5, 7, 10, 14, 20, 28, 40]
    assert (np.diff(got["error"]) < 0).all()
    assert got["amplitude_error"][2] == pytest.approx(0.0036, abs=0.0001)
    assert got["error"][-1] < 2e-5


def test_a_person_reads_tables_with_units(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["model", "step"]) == ExitCode.DONE
    output = capsys.readouterr().out
    assert "Step of 1500 V on the specimen, vibrating freely" in output
    assert [line.split() for line in output.splitlines() if "final deflection" in line] == [
        ["final", "deflection", "356.8", "µm"]
    ]
    assert main(["model", "frequency-response", "-n", "7"]) == ExitCode.DONE
    output = capsys.readouterr().out
    assert "Highest max - min: 1154.2 µm at 150 Hz" in output
    assert ["25", "491.0", "486.8", "-3.8", "9.82"] in [line.split() for line in output.splitlines()]


def test_long_tables_are_thinned_for_people_only(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "response.csv"
    assert (
        main(["model", "frequency-response", "-n", "7", "--frequencies", "1:500:500", "--csv", str(file)])
        == ExitCode.DONE
    )
    output = capsys.readouterr().out
    assert "one row in 9 of 500" in output
    assert len(output.splitlines()) < 70
    head, rows = sheet(file)
    columns = ["frequency [Hz]", "peak_to_peak [m]", "twice_fundamental [m]"]
    assert head[:3] == columns
    assert rows.shape[0] == 500
    assert rows[24, 1:3] == pytest.approx([491.0e-6, 486.8e-6], rel=1e-4)
    assert 1e3 * 2 * np.abs(rows[:, 4] + 1j * rows[:, 5]) == pytest.approx(rows[:, 2], rel=1e-9)


@pytest.mark.parametrize(
    ("topic", "head"),
    [
        ("modes", ["x [m]", "free, mode 1 [kg^-1/2]"]),
        ("static", ["x [m]", "deflection [m]"]),
        ("step", ["time [s]", "step [m]", "sine_onset [m]"]),
        ("membrane", ["elongation [m]", "pre_stretch []"]),
        ("convergence", ["n []", "error []"]),
    ],
)
def test_every_curve_goes_into_a_sheet(topic: str, head: list[str], tmp_path: Path) -> None:
    file = tmp_path / "curve.csv"
    short = {"membrane": ["--elongation", "0,1 mm"], "convergence": ["--shapes", "3,5"]}.get(topic, [])
    assert main(["model", topic, "--csv", str(file), *short]) == ExitCode.DONE
    columns, rows = sheet(file)
    assert columns[: len(head)] == head
    assert np.isfinite(rows).all()


@pytest.mark.deep
@pytest.mark.one_in(2)
@pytest.mark.parametrize("topic", ["modes", "convergence"])  # two panels, a logarithmic one
def test_a_picture_where_one_is_asked_for(topic: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    picture = tmp_path / "curve.png"
    assert main(["model", topic, "--picture", str(picture)]) == ExitCode.DONE
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert f"wrote {picture}" in capsys.readouterr().err


def test_the_step_sheet_ends_at_the_final_value(tmp_path: Path) -> None:
    file = tmp_path / "step.csv"
    assert main(["model", "step", "--duration", "100 ms", "--csv", str(file)]) == ExitCode.DONE
    _, rows = sheet(file)
    assert rows[-1, 0] == pytest.approx(0.1)
    assert rows[-1, 1] == pytest.approx(356.8e-6, abs=0.05e-6)


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["modes", "--set", "L=-1 mm"], '-0.001 m'),
        (["modes", "--set", "L1=1.6 cm"], 'L1 is 0.016 m'),
        (["modes", "--set", "k2=nan"], 'nan N m^2'),
        (["static", "--set", "k_s=-3"], '-3 N/m^2'),
        (["modes", "--set", "cheese=3"], "'cheese'"),
        (["modes", "--set", "L=3 kg"], "L: '3 kg'"),
        (["modes", "--set", "L=long"], "L: 'long'"),
        (["modes", "--set", "L"], "--set L: write NAME=VALUE"),
        (["modes", "--set", "k2=1e-20", "--set", "c0=1e200"], "cannot be computed with these parameters"),
        (["modes", "-n", "2"], 'is 2: '),
        (["modes", "-n", "3.5"], "invalid int value: '3.5'"),
        (["modes", "--count", "0"], '--count 0'),
        (["convergence", "--shapes", "2,5"], 'is 2'),
        (["convergence", "--shapes", "7.5"], 'is 7.5'),
        (["convergence", "--frequencies", "-5"], '-5 Hz'),
        (["frequency-response", "--frequencies", "10,-5"], '-5 Hz'),
        (["frequency-response", "--frequencies", "1:500"], "'1:500'"),
        (["frequency-response", "--frequencies", "1:9:1"], '100000'),
        (["frequency-response", "--frequencies", "1:9:5:lin"], "'1:9:5:lin'"),
        (["convergence", "--frequencies", "0:9:5:log"], "both ends must be greater than 0"),
        (["frequency-response", "--frequencies", ""], "frequency: ''"),
        (["frequency-response", "--peak-to-peak", "6 V"], '-0.5..5.5 V'),
        (["frequency-response", "--at", "3 cm"], '0.03 m'),
        (["static", "--load", "3 V"], "load: '3 V'"),
        (["static", "--load", "inf"], 'inf N'),
        (["step", "--voltage", "nan"], 'nan V'),
        (["step", "--tolerance", "2"], 'is 2: '),
        (["step", "--frequency", "0"], '0 Hz'),
        (["step", "--duration", "0 s"], "duration (duration of the curve) is 0 s"),
        (["membrane", "--pre-stretch", "-0.1"], 'is -0.1'),
        (["membrane", "--elongation", "-1mm"], "elongation (elongation of the membrane) is -0.001 m"),
        (["membrane", "--elongation", "1 mm", "--pre-stretch", "0"], "the pre-stretch is given twice"),
        (["membrane", "--set", "delta=0.1"], '--pre-stretch'),
        (["static", "--elongation", "1 mm", "--set", "delta=0"], '--elongation and --set delta'),
        (["static", "--csv", "/nowhere/x.csv"], '/nowhere'),
        (["static", "--picture", "x.cheese"], '.png, .pdf'),
        (["cheese"], "invalid choice: 'cheese'"),
        ([], "the following arguments are required: TOPIC"),
    ],
)  # fmt: skip
def test_what_is_not_physical_gets_one_sentence_and_exit_code_2(
    arguments: list[str], says: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["model", *arguments]) == ExitCode.USAGE
    captured = capsys.readouterr()
    assert says in captured.err
    assert "Traceback" not in captured.err
    assert len(captured.err.splitlines()) == 1
    assert captured.out == ""


def test_a_unit_at_the_end_of_a_list_is_everybodys(ask: Any) -> None:
    assert ask("model", "membrane", "--elongation", "1, 2 mm")["membrane"]["elongation"] == pytest.approx([1e-3, 2e-3])
    assert ask("model", "membrane", "--elongation", "1:3 mm:3")["membrane"]["elongation"][0] == pytest.approx(1e-3)
    mixed = ask("model", "frequency-response", "--frequencies", "100 Hz, 1 kHz")["response"]["frequency"]
    assert mixed == pytest.approx([100, 1000])
    log = ask("model", "frequency-response", "--frequencies", "1:100:3:log")["response"]["frequency"]
    assert log == pytest.approx([1, 10, 100])


@pytest.mark.parametrize(
    "topic", ["parameters", "modes", "static", "frequency-response", "step", "membrane", "convergence"]
)
def test_every_topic_has_help_with_an_example(topic: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as left:
        main(["model", topic, "--help"])
    assert left.value.code == 0
    words = capsys.readouterr().out.split()
    assert words[words.index("example:") + 1 :][:3] == ["tactor-bench", "model", topic]
