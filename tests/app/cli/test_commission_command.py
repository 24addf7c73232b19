"""The command `commission` and its records."""

import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.common import ExitCode
from app.config import BenchConfig
from app.session import commissioning_record, connect
from app.session.commissioning import commission
from app.session.commissioning_gate import REMEDY, commissioning_state
from app.session.commissioning_record import load_record, record_path, save_record, simulated_bench_key
from drivers import Identity, NoWatchdog, Sine, WallClock, WatchdogConfig
from drivers.evidence.assumption import OutputCheck
from protocols.base import BenchArmed, RunStatus
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes, OutputVerdict
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated

IDENTITY = Identity("Keysight Technologies", "33511B", "MY/12 34", "5.02-3.02")


@pytest.fixture(autouse=True)
def _own_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(commissioning_record, "user_data_path", lambda *_, **__: tmp_path / "data")


def result(level_v: float = 0.0) -> Commissioned:
    checks = (
        CheckedOutput(OutputCheck.REST, level_v, "V", -0.05, 0.05, "before 'sine'"),
        CheckedOutput(OutputCheck.SCALE, 1.0, "1", 0.97, 1.03),
    )
    return Commissioned(checks, MeasuredTimes(0.2, 1e-3, float("nan"), 0.4), (), ())


def test_a_record_is_that_of_the_instrument_and_its_firmware() -> None:
    assert load_record(IDENTITY) is None
    path = save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result())
    found = load_record(IDENTITY)
    assert found is not None
    assert found.path == path
    assert found.is_valid
    assert found.times.stop_s == 0.2
    assert found.times.reply_s == 0.4
    for other in (
        Identity("Keysight Technologies", "33511B", "MY/12 34", "5.03-3.02"),
        Identity("Keysight Technologies", "33511B", "MY/12 35", "5.02-3.02"),
        Identity("Keysight Technologies", "33511B", "MY 12/34", "5.02-3.02"),  # the same file name
    ):
        assert load_record(other) is None


def test_a_record_of_what_differs_is_not_valid_and_says_what() -> None:
    save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result(0.7))
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


def test_a_simulated_bench_is_exempt() -> None:
    stored = {"status": "exempt", "why": "simulated bench"}
    state = commissioning_state(IDENTITY, simulated=True)
    assert not state.refusal
    assert state.stored == stored


def test_high_voltage_needs_a_record_or_a_reason_that_is_stored() -> None:
    state = commissioning_state(IDENTITY, simulated=False)
    assert state.refusal.startswith(
        "There is no commissioning record of Keysight Technologies 33511B #MY/12 34 with firmware"
    )
    assert state.refusal.endswith(f". {REMEDY}")
    assert_names(REMEDY, "--without-commissioning")
    state = commissioning_state(IDENTITY, simulated=False, reason="first look")
    assert not state.refusal
    assert state.note.startswith("High voltage without a valid commissioning of the source: first look. ")
    assert state.stored["status"] == "overridden"
    assert state.stored["reason"] == "first look"
    save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result())
    state = commissioning_state(IDENTITY, simulated=False)
    assert not state.refusal
    assert state.stored["status"] == "commissioned"
    assert state.stored["stop_s"] == 0.2
    assert (state.stop_s, state.reply_s) == (0.2, 0.4)
    assert state.note.endswith("Stop took 0.20 s; its slowest reply took 0.40 s")


def test_a_record_without_a_reply_time_is_read(tmp_path: Path) -> None:
    path = save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result())
    stored = json.loads(path.read_text())
    del stored["times"]["reply_s"]
    path.write_text(json.dumps(stored))
    state = commissioning_state(IDENTITY, simulated=False)
    assert (state.refusal, state.stop_s, state.reply_s) == ("", 0.2, 0.0)


def test_measured_times_are_stated_when_the_bench_is_armed_and_lengthen_the_way_to_rest(tmp_path: Path) -> None:
    said = []
    for measured_s in (0.0, 1.5):
        with laboratory() as lab:
            lab.bench.amplifier.measured_stop_s = measured_s
            ran = run(SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path, lab)
        said += [e.safety for e in ran.events if isinstance(e, BenchArmed)]
    assert "(Stop" not in said[0]
    assert "the way to rest takes up to 2.0 s (Stop measured 1.50 s at commissioning)" in said[1]


def test_a_firmware_change_invalidates_the_record() -> None:
    save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result())
    updated = replace(IDENTITY, firmware="5.03")
    assert (
        "was commissioned with firmware 5.02_3.02, and now has 5.03"
        in commissioning_state(updated, simulated=False).refusal
    )


def test_a_record_that_did_not_pass_or_is_of_a_simulated_instrument_admits_no_high_voltage() -> None:
    save_record(IDENTITY, simulated=False, rate_hz=1e5, result=result(0.7))
    assert (
        "did not pass (dangerous: level between bursts 0.7 V" in commissioning_state(IDENTITY, simulated=False).refusal
    )
    save_record(IDENTITY, simulated=True, rate_hz=1e5, result=result())
    assert "is of a simulated instrument" in commissioning_state(IDENTITY, simulated=False).refusal


def test_records_of_a_simulated_bench_are_kept_apart_and_count_for_the_same_one_only(tmp_path: Path) -> None:
    config = simulated(generator={"model": "SDG1032X"})
    key = simulated_bench_key(config)
    assert key != simulated_bench_key(simulated(generator={"model": "SDG1032X", "traits": "retime=restarts"}))
    assert key == simulated_bench_key(simulated(generator={"model": "SDG1032X"}, speed=20.0))
    assert key != simulated_bench_key(simulated(generator={"model": "SDG1032X"}, interlock={"release_s": 0.2}))
    times = MeasuredTimes(0.2, 1e-3, float("nan"), 0.4, 1.25, interlock_s=0.58)
    path = save_record(
        IDENTITY, simulated=True, rate_hz=1e5, result=replace(result(), times=times), simulated_bench=key
    )
    assert path.relative_to(tmp_path / "data" / "commissioning").parts[:2] == ("simulated", key)
    assert load_record(IDENTITY) is None
    assert commissioning_state(IDENTITY, simulated=False).refusal.startswith("There is no commissioning record")
    state = commissioning_state(IDENTITY, simulated=True, simulated_bench=key)
    assert (state.level_stop_s, state.interlock_s, state.stored["interlock_s"]) == (1.25, 0.58, 0.58)
    assert commissioning_state(IDENTITY, simulated=True, simulated_bench="other").level_stop_s == 0.0


@pytest.mark.deep
def test_a_commissioned_simulated_bench_hastens_the_end_of_a_level(tmp_path: Path) -> None:
    for retime, hastens in (("continues", True), ("restarts", False)):
        config = simulated(generator={"model": "SDG1032X", "traits": f"retime={retime}"})
        with connect(config, None) as before:
            assert not before.bench.amplifier.hastens_levels
        commission(config, None, lambda _: None)
        with connect(config, None) as after:
            assert after.bench.amplifier.hastens_levels is hastens
            assert (after.bench.configuration["commissioning"]["level_stop_s"] is not None) is hastens


@pytest.mark.parametrize("order", ["big-endian", "little-endian"])
def test_the_byte_order_of_the_record_is_used_from_the_first_waveform_on(order: str) -> None:
    config = simulated(generator={"model": "SDG6022X", "traits": f"byte-order={order.removesuffix('-endian')}"})
    with connect(config, None) as before:
        identity = before.bench.amplifier.identity
        assert before.bench.amplifier.byte_order() == "big-endian"
    found = replace(result(), byte_order=order)
    save_record(identity, True, 1e5, found, simulated_bench_key(config))
    with connect(config, None) as after:
        assert after.bench.amplifier.byte_order() == order
        after.bench.amplifier.initialize_at_rest()
        after.bench.amplifier.start_drive(Sine(10.0, 0.5, 2.5, 3))
        began_s = after.bench.clock.now()
        after.bench.clock.sleep(0.3)
        played = after.control.history.volts(began_s + np.arange(0, 0.2, 1e-3))
    assert (played.min(), played.max()) == pytest.approx((2.0, 3.0), abs=0.02)
    save_record(identity, False, 1e5, found)
    assert commissioning_state(identity, simulated=False).byte_order == order


def test_a_bench_that_is_not_commissioned_never_switches_high_voltage_on(tmp_path: Path) -> None:
    config = simulated(amplifier={"enabled": False})
    with laboratory(config) as lab:
        lab.bench.high_voltage_refusal = "There is no commissioning record"
        ran = run(SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path, lab)
    assert ran.status is RunStatus.FAILED
    assert "high voltage is not switched on: There is no commissioning record" in ran.reason
    assert "Armed" not in ran.kinds()


def test_the_reason_is_stored_in_the_run_and_logged(tmp_path: Path) -> None:
    state = commissioning_state(IDENTITY, simulated=False, reason="first look")
    with laboratory() as lab:
        lab.bench.commissioning_note = state.note
        lab.bench.configuration = {**lab.bench.configuration, "commissioning": state.stored}
        ran = run(SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5), tmp_path, lab)
    with Run(ran.path) as stored:
        assert stored.record.configuration["commissioning"]["reason"] == "first look"
    assert any(state.note in getattr(e, "text", "") for e in ran.events)


@pytest.mark.parametrize("command", [["run", "sine-dwell"], ["check"]])
def test_a_reason_is_refused_on_the_simulated_bench(command: list[str], capfd: pytest.CaptureFixture[str]) -> None:
    assert main([*command, "--without-commissioning", "why"]) == ExitCode.USAGE
    assert_names(capfd.readouterr().err, "--without-commissioning", "simulated")


def bench_file(folder: Path, traits: str) -> str:
    path = folder / "bench.toml"
    path.write_text(f'name = "b"\n[simulation.generator]\nmodel = "33511B"\ntraits = "{traits}"\n', encoding="utf-8")
    return str(path)


@pytest.mark.deep
def test_commission_passes_or_names_what_differs(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    assert main(["commission", "--speed", "max", "--json"]) == ExitCode.DONE
    record = json.loads(capfd.readouterr().out)
    assert record["verdict"] == "pass"
    assert record["commands"][0]["longest_s"] == record["times"]["reply_s"]
    assert {"*TRG", "VOLT", "ABOR", "DATA:ARB"} <= {each["command"] for each in record["commands"]}
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
    picture = tmp_path / "page.png"
    assert main(["commission", "--bench", bench, "--speed", "max", "--picture", str(picture)]) == ExitCode.FAILED
    assert picture.stat().st_size > 10_000
    page = capfd.readouterr().out
    assert "33511B" in page
    assert "dangerous" in page
    assert "The simulated bench needs no commissioning" in " ".join(page.split())


def test_an_unknown_trait_is_refused_with_those_that_the_model_has(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    assert main(["commission", "--bench", bench_file(tmp_path, "no-such=trait"), "--speed", "max"]) == ExitCode.USAGE
    assert "'no-such=trait' is no trait of a 33511B; it has" in capfd.readouterr().err


@pytest.mark.deep
@pytest.mark.parametrize(("model", "answers_two"), [("33511B", True), ("SDG1032X", False)])
def test_a_source_on_its_wires_is_commissioned_and_admits_high_voltage(
    model: str, answers_two: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[WatchdogConfig] = []

    def start(config: WatchdogConfig) -> NoWatchdog:
        given.append(config)
        return NoWatchdog()

    monkeypatch.setattr("drivers.WatchdogClient", start)
    control = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, WallClock(1.0))
    with ServedBench(control) as served:
        config = BenchConfig.model_validate(
            {
                "generator": {"resource": f"TCPIP::127.0.0.1::{served.scpi.port}::SOCKET"},
                "card": {"server": f"127.0.0.1:{served.card.port}"},
                "sensor": {"delay_s": 1e-4},
            }
        )
        with connect(config) as before:
            assert before.bench.high_voltage_refusal.startswith("There is no commissioning record")
        done = commission(config, 1.0, lambda _: control.disable_hv())
        assert not [check for check in done.result.checks if not check.passed]
        assert math.isfinite(done.result.times.second_client_s) == answers_two
        with connect(config) as after:
            assert after.bench.high_voltage_refusal == ""
            assert after.bench.amplifier.measured_stop_s == done.result.times.stop_s
            assert (given[0].measured_stop_s, given[0].measured_reply_s) == (0.0, 0.0)
            assert given[-1].measured_stop_s == done.result.times.stop_s
            assert given[-1].measured_reply_s == done.result.times.reply_s
            assert after.bench.configuration["commissioning"]["reply_s"] == done.result.times.reply_s > 0
        assert after.bench.configuration["commissioning"]["status"] == "commissioned"
