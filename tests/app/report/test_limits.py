"""Limits on a specimen: validation of the file, verdicts that include the uncertainty, exit code."""

import json
from pathlib import Path

import pytest

from app.cli import report as command
from app.cli.main import main
from app.report.document import Paragraph
from app.report.figures_of_merit import figure_of_merit
from app.report.limits import FIGURES_OF_MERIT, Limit, Limits, LimitsError, judge_limits, read_limits
from app.report.result_cards import _typeset
from app.report.rounding import typeset_measurement, typeset_number, typeset_probability
from protocols.base import RunFigure
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import blocks_of


def test_a_file_of_limits_is_read_with_its_units(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(
        'golden = "T0"\nrule = "simple"\n[limits.peak_frequency]\nlow = "0.15 kHz"\nhigh = 170\n'
        '[limits.k2]\nwithin_golden = "5 %"\n[limits.latency]\nhigh = "0.6 ms"\n'
    )
    read = read_limits(path)
    assert (read.golden, read.rule) == ("T0", "simple")
    assert read.limits["peak_frequency"] == Limit(pytest.approx(150.0), 170.0)
    assert read.limits["k2"] == Limit(within_golden=pytest.approx(0.05))
    assert read.limits["latency"] == Limit(high=pytest.approx(6e-4))


def test_every_fault_is_listed_with_its_line(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text(
        'rule = "loose"\n[limits.resonanse]\nlow = 3\n[limits.k2]\nlow = "3 kg"\n[limits.c0]\nlow = 3\nhigh = 2\n'
        "[limits.mu]\n[limits.peak_frequency]\nlowest = 3\n"
    )
    with pytest.raises(LimitsError) as raised:
        read_limits(path)
    messages = str(raised.value)
    for text in (
        "line 1: rule", "line 2: limits.resonanse: unknown key", "line 5: limits.k2.low", "low 3 is above high 2",
        "line 9: limits.mu: asks nothing", "line 11: limits.peak_frequency.lowest: unknown key", "amplitude_at_resonance",
    ):  # fmt: skip
        assert text in messages, messages


def test_an_ambiguous_limit_is_refused_with_the_choice(tmp_path: Path) -> None:
    path = tmp_path / "limits.toml"
    path.write_text("[limits.resonance]\nlow = 150\n")
    with pytest.raises(LimitsError) as raised:
        read_limits(path)
    assert all(name in str(raised.value) for name in ("natural_frequency", "damped_frequency", "peak_frequency"))


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("[limits", "not valid TOML"),
        ("", "sets no limit"),
        ("limits = 3", "line 1: limits"),
        ("\0\udc80", "cannot be read"),
    ],
)
def test_what_is_no_file_of_limits_is_a_sentence(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "limits.toml"
    path.write_bytes(text.encode("utf-8", "surrogateescape"))
    with pytest.raises(LimitsError, match=says):
        read_limits(path)
    with pytest.raises(LimitsError, match="cannot be read: No such file"):
        read_limits(tmp_path / "none.toml")


RESONANCE = {"peak_frequency": figure_of_merit("peak_frequency", 150.5, 0.5)}


@pytest.mark.parametrize(
    ("limit", "rule", "verdict"),
    [
        (Limit(low=149.0, high=170.0), "guarded", "pass"),
        (Limit(low=150.0), "guarded", "cannot tell"),
        (Limit(low=151.0), "guarded", "cannot tell"),
        (Limit(low=152.0), "guarded", "fail"),
        (Limit(high=149.0), "guarded", "fail"),
        (Limit(low=150.0), "simple", "pass"),
        (Limit(low=151.0), "simple", "fail"),
        (Limit(within_golden=0.05), "guarded", "pass"),
        (Limit(within_golden=0.01), "guarded", "cannot tell"),
        (Limit(within_golden=0.001), "guarded", "fail"),
    ],
)
def test_a_verdict_minds_the_uncertainty(limit: Limit, rule: str, verdict: str) -> None:
    golden = {"peak_frequency": figure_of_merit("peak_frequency", 153.0, 0.5)}
    (outcome,) = judge_limits(Limits({"peak_frequency": limit}, rule, "T0"), RESONANCE, golden)  # type: ignore[arg-type]
    assert outcome.verdict == verdict, outcome


def test_what_was_not_measured_does_not_pass() -> None:
    asked = Limits({"k2": Limit(low=1e-3), "peak_frequency": Limit(within_golden=0.5)}, golden="T0")
    k2, resonance = judge_limits(asked, RESONANCE, {})
    assert (k2.verdict, resonance.verdict) == ("cannot tell", "cannot tell")
    assert "T0" in resonance.why


@pytest.mark.parametrize(
    ("text", "is_"),
    [
        (typeset_measurement(-1.33e-5, 2.5e-8, "N m^2"), "(−13.300 ± 0.025) × 10⁻⁶ N m²"),
        (typeset_measurement(-1.33e-5, 2.5e-8, "N m/V"), "−13.300 ± 0.025 N mm/kV"),
        (typeset_measurement(54812.0, 312.0, "kg/(m s)"), "54810 ± 310 kg/(m s)"),
        (typeset_measurement(7.73e-3, 1e-5, "kg"), "7.730 ± 0.010 g"),
        (typeset_measurement(3.0, 0.0, "1"), "3"),
        (typeset_number(1.4e-3, 3), "1.4 × 10⁻³"),
        (typeset_probability(3.2e-8), "3 × 10⁻⁸"),
        (typeset_probability(0.0), "< 10⁻¹⁰"),
    ],
)
def test_numbers_are_printed_to_what_their_errors_allow(text: str, is_: str) -> None:
    assert text.replace("\N{NO-BREAK SPACE}", " ") == is_


@pytest.mark.deep
def test_the_example_is_valid_and_the_exit_code_tells_the_verdict(
    folder: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    example = Path("limits.toml")
    assert main(["report", "--new-limits", str(example)]) == 0
    assert main(["report", "--new-limits", str(example)]) == 2
    for name in FIGURES_OF_MERIT:
        assert name in example.read_text("utf-8")
    report = ["report", "T1", "--folder", str(folder), "--out", "out", "--json", "--limits"]
    assert set(read_limits(example).limits) == {
        "peak_frequency",
        "amplitude_at_resonance",
        "smallest_margin",
    }
    Path("strict.toml").write_text(
        'golden = "T1"\n[limits.peak_frequency]\nlow = "160 Hz"\n[limits.mu]\nwithin_golden = "60 %"\n'
    )
    capsys.readouterr()
    messages: list[str] = []
    monkeypatch.setattr(
        command,
        "write_report",
        lambda content, *_: messages.extend(b.text for b in blocks_of(content, Paragraph)) or (),
    )
    assert main([*report, "strict.toml"]) == 1
    captured = capsys.readouterr()
    assert "fail: peak_frequency is" in captured.err
    assert_names(captured.err, "160", "Hz")
    record = json.loads(captured.out)
    assert record["passed"] is False
    assert [o["verdict"] for o in record["limits"]] == ["fail", "pass"]
    assert "NOT PASSED: of 2 limits 1 met, 1 not met." in messages


@pytest.mark.deep
@pytest.mark.parametrize(
    ("options", "says"),
    [
        (["--golden", "T0"], "--golden needs limits"),
        (["--limits", "gone.toml"], "cannot be read"),
        (["--limits", "k2.toml"], "names none"),
        (["--limits", "k2.toml", "--golden", "T0"], "no run of specimen 'T0'"),
    ],
)
def test_what_is_asked_wrongly_is_a_sentence(
    folder: Path, tmp_path: Path, options: list[str], says: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    Path("k2.toml").write_text('[limits.k2]\nwithin_golden = "5 %"\n')
    assert main(["report", "T1", "--folder", str(folder), *options]) == 2
    assert says in capsys.readouterr().err
    assert main(["report"]) == 2
    assert "a specimen is missing" in capsys.readouterr().err


@pytest.mark.deep
def test_fleet_and_report_judge_a_limit_on_the_same_quantity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    runs = tmp_path / "runs"
    dwell = ["run", "sine-dwell", "--bench", "ideal", "--speed", "max", "--seed", "3", "--specimen", "T1"]
    assert main([*dwell, "--set", "frequencies_hz=50,100,140,150,160,180,220", "--out", str(runs)]) == 0
    names = ("natural_frequency", "damped_frequency", "peak_frequency")
    limits = runs / "limits.toml"
    limits.write_text("".join(f"[limits.{name}]\nlow = 152\nhigh = 156\n" for name in names))
    capsys.readouterr()
    assert main(["fleet", str(runs), "--simulated", "--json"]) == 0
    table = json.loads(capsys.readouterr().out)["quantities"]
    means, outside = (dict(zip(table["quantity"], table[column], strict=True)) for column in ("mean", "outside"))
    assert means["peak_frequency"] < means["damped_frequency"] < means["natural_frequency"]
    assert [outside[name] for name in names] == ["1", "0", "1"]
    assert main(["report", "T1", "--folder", str(runs), "--out", str(tmp_path / "out"), "--json"]) == 1
    answer = json.loads(capsys.readouterr().out.strip().splitlines()[-1])
    merits = {merit["name"]: merit["value"] for merit in answer["merits"]}
    assert [merits[name] for name in names] == pytest.approx([means[name] for name in names], rel=1e-9)


@pytest.mark.parametrize(
    ("name", "value", "unit", "shown"),
    [
        ("overshoot, after a step", 0.45, "1", "45.0 ± 1.0 %"),
        ("ratio", 22.5, "1", "22.500 ± 0.010"),
        ("gain", 1e-4, "m/V", "100 ± 10000 µm/V"),
    ],
)
def test_a_figure_in_a_table_has_the_unit_of_its_quantity(name: str, value: float, unit: str, shown: str) -> None:
    assert _typeset(RunFigure(name, value, 0.0, 0.01, unit)).replace("\u00a0", " ") == shown
