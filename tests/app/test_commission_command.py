"""The command `commission` and its records."""

import json
from pathlib import Path

import pytest

from app.cli.main import main
from app.common import ExitCode
from app.session import commissioning_record
from app.session.commissioning_record import load_record, record_path, save_record
from drivers import Identity
from drivers.generators.assumptions import OutputCheck
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes, OutputVerdict

IDENTITY = Identity("Keysight Technologies", "33511B", "MY/12 34", "5.02-3.02")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commissioning_record, "user_data_path", lambda *_, **__: tmp_path / "data")


def result(level_v: float = 0.0) -> Commissioned:
    checks = (
        CheckedOutput(OutputCheck.REST, level_v, "V", -0.05, 0.05, "before 'sine'"),
        CheckedOutput(OutputCheck.SCALE, 1.0, "1", 0.97, 1.03),
    )
    return Commissioned(checks, MeasuredTimes(0.2, 1e-3, float("nan")), (), ())


def test_a_record_is_that_of_the_instrument_and_its_firmware() -> None:
    assert load_record(IDENTITY) is None
    path = save_record(IDENTITY, simulated=False, rate_hz=1e5, found=result())
    found = load_record(IDENTITY)
    assert found is not None
    assert found.path == path
    assert found.is_valid
    assert found.stop_s == 0.2
    for other in (
        Identity("Keysight Technologies", "33511B", "MY/12 34", "5.03-3.02"),
        Identity("Keysight Technologies", "33511B", "MY/12 35", "5.02-3.02"),
        Identity("Keysight Technologies", "33511B", "MY 12/34", "5.02-3.02"),  # the same file name
    ):
        assert load_record(other) is None


def test_a_record_of_what_differs_is_not_valid_and_says_what() -> None:
    save_record(IDENTITY, simulated=False, rate_hz=1e5, found=result(0.7))
    found = load_record(IDENTITY)
    assert found is not None
    assert found.verdict is OutputVerdict.DANGEROUS
    assert found.failed == ("dangerous: level between bursts 0.7 V, limit -0.05 to 0.05 V (before 'sine')",)


@pytest.mark.parametrize("text", ["", "{}", "[]", "nonsense", '{"format": 1}', '{"format": 2}'])
def test_a_record_that_cannot_be_read_is_none(text: str) -> None:
    path = record_path(IDENTITY)
    path.parent.mkdir(parents=True)
    path.write_text(text, encoding="utf-8")
    assert load_record(IDENTITY) is None


def bench_file(folder: Path, traits: str) -> str:
    path = folder / "bench.toml"
    path.write_text(f'name = "b"\n[simulation.generator]\nmodel = "33511B"\ntraits = "{traits}"\n', encoding="utf-8")
    return str(path)


@pytest.mark.deep
def test_commission_passes_or_names_what_differs(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["commission", "--speed", "max", "--json"]) == ExitCode.DONE
    record = json.loads(capfd.readouterr().out)
    assert record["verdict"] == "pass"
    assert Path(record["file"]).with_suffix(".npz").stat().st_size > 1000
    bench = bench_file(tmp_path, "output-polarity=inverted")
    assert main(["commission", "--bench", bench, "--speed", "max", "--json"]) == ExitCode.FAILED
    record = json.loads(capfd.readouterr().out)
    wrong = {
        each["property"]: each["verdict"]
        for each in record["assumptions"]
        if each["verdict"] not in ("pass", "cannot be seen")
    }
    assert wrong == {"polarity": "dangerous"}


@pytest.mark.deep
def test_the_page_names_the_instrument_and_what_differs(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    bench = bench_file(tmp_path, "abort=drops")
    assert main(["commission", "--bench", bench, "--speed", "max"]) == ExitCode.FAILED
    page = capfd.readouterr().out
    assert "33511B" in page
    assert "dangerous" in page
    assert "The simulated bench needs no commissioning" in " ".join(page.split())


def test_an_unknown_trait_is_refused_with_those_that_the_model_has(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["commission", "--bench", bench_file(tmp_path, "no-such=trait"), "--speed", "max"]) == ExitCode.USAGE
    assert "'no-such=trait' is no trait of a 33511B; it has" in capfd.readouterr().err
