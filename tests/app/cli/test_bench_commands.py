"""Commands check, devices, bench new, faults, run --fault: printed output and exit codes."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from app.archive.description import injected_faults
from app.cli.main import main
from app.common.exit_codes import ExitCode, UsageError
from app.config.bench_file import load_bench
from app.config.discovery import find_devices
from app.session.bench_connection import connect
from app.session.simulation import FaultPlan
from drivers.clock import WallClock
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS, InstrumentError
from drivers.transport.visa import list_resources
from protocols.base import LogMessage, Quality, RunStatus
from protocols.measurements.sine_dwell import SineDwell
from protocols.runfile.reader import Run
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS
from sim_hardware.service.served_bench import ServedBench
from tests.drivers.test_generator_models import NamedLink
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import laboratory, run, simulated
from tests.wires.usbtmc_bus import PRODUCT, SERIAL, VENDOR, UsbTmcBus

QUICK = ("--speed", "max", "--set", "record_s=0.5", "--set", "wait_s=0.1")


def test_the_check_passes_on_a_sound_bench_and_shows_every_figure(tmp_path: Path, capsys: Any) -> None:
    assert main(["check", *QUICK, "--out", str(tmp_path)]) == ExitCode.DONE
    out = capsys.readouterr().out
    for text in ("gain above rest", "latency beyond", "noise floor", "drive read back", "polarity", "rest confirmed"):
        assert text in out
    assert "FAIL" not in out
    assert out.count("pass") == 14  # all checks of the verdict, and rest


@pytest.mark.parametrize(("interlock", "recommended"), [("", True), ("[interlock]\nline = 'port0/line0'\n", False)])
def test_the_check_of_a_real_bench_recommends_an_interlock_where_there_is_none(
    interlock: str, recommended: bool, tmp_path: Path, capsys: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "bench.toml").write_text(f"[generator]\nresource = 'TCPIP::192.0.2.1::5025::SOCKET'\n{interlock}")
    monkeypatch.setattr("app.cli.bench.run_headless", lambda *_: (ExitCode.FAILED, None))
    assert main(["check", "--bench", str(tmp_path / "bench.toml"), "--out", str(tmp_path)]) == ExitCode.FAILED
    assert ("build-an-interlock" in "".join(capsys.readouterr())) == recommended
    assert main(["check", "--bench", str(tmp_path / "bench.toml"), "--out", str(tmp_path), "--json"]) == ExitCode.FAILED
    assert json.loads(capsys.readouterr().out)["interlock"] != recommended


@pytest.mark.one_in(100)
@pytest.mark.parametrize(
    ("fault", "failing", "remedy"),
    [
        ("sensor-out-of-range", "recordings out of range", "move the sensor"),
        ("sensor-stuck", "gain above rest", "check the sensor's distance and wiring"),
    ],
)
def test_what_does_not_pass_is_named_with_what_to_look_at(
    fault: str, failing: str, remedy: str, tmp_path: Path, capsys: Any
) -> None:
    assert main(["check", *QUICK, "--json", "--fault", f"{fault}@1", "--out", str(tmp_path)]) == ExitCode.FAILED
    result = json.loads(capsys.readouterr().out)
    assert result["status"] == "completed"
    assert not result["passed"]
    line = next(check for check in result["checks"] if check["name"] == failing)
    assert not line["passed"]
    assert remedy in line["remedy"]


@pytest.mark.breaks_the_drive
def test_a_check_that_ends_unsafe_says_so_by_its_exit_code(tmp_path: Path, capsys: Any) -> None:
    assert main(["check", *QUICK, "--fault", "drive-cable-off@2", "--out", str(tmp_path)]) == ExitCode.UNSAFE
    captured = capsys.readouterr()
    assert MANUAL_SHUTDOWN_INSTRUCTIONS in " ".join(captured.err.split())
    assert "The check was not completed" in captured.out


@pytest.mark.deep
def test_a_fault_from_the_command_line_breaks_at_its_second(tmp_path: Path, capsys: Any) -> None:
    arguments = ["run", "sine-dwell", "--speed", "max", "--out", str(tmp_path), "--set", "frequencies_hz=100,150,200"]
    assert main([*arguments, "--fault", "card-overrun@3"]) == ExitCode.UNSAFE
    with Run(next(tmp_path.glob("*.h5"))) as file:
        assert 2.0 < file.trace.duration_s <= 3.1
        path, ((fault, words, from_s, until_s),) = file.path, injected_faults(file)
        assert (fault, words, until_s) == ("card-overrun", FAULT_DESCRIPTIONS["card-overrun"], None)
        assert from_s == pytest.approx(3.0, abs=0.15)
        assert "lost" in file.record.reason.split()
        reason = " ".join(file.record.reason.split())
    output = " ".join(capsys.readouterr().err.split())
    assert reason in output
    assert FAULT_DESCRIPTIONS["card-overrun"] in output
    assert main(["show", str(path)]) == ExitCode.DONE
    assert f"FAULT INJECTED, {from_s:.2f} s to its end: {FAULT_DESCRIPTIONS['card-overrun']} (card-overrun)" in (
        capsys.readouterr().out
    )
    assert main(["show", str(path), "--json"]) == ExitCode.DONE
    assert json.loads(capsys.readouterr().out)["broken_on_purpose"][0]["fault"] == "card-overrun"


@pytest.mark.parametrize(
    ("fault", "says"),
    [
        ("coffee", "'coffee'"),
        ("scpi-late@soon", "write NAME@SECONDS"),
        ("scpi-late@-1", "write NAME@"),
    ],
)
def test_a_fault_that_makes_no_sense_is_a_sentence(fault: str, says: str, tmp_path: Path, capsys: Any) -> None:
    assert main(["run", "sine-dwell", "--fault", fault, "--out", str(tmp_path)]) == ExitCode.USAGE
    assert says in capsys.readouterr().err


def test_a_real_bench_cannot_be_broken_on_purpose(tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / "bench.toml"
    file.write_text('[generator]\nresource = "TCPIP::192.0.2.1::5025::SOCKET"\n')
    assert main(["--bench", str(file), "run", "sine-dwell", "--fault", "scpi-late"]) == ExitCode.USAGE
    assert "--fault" in capsys.readouterr().err


def test_the_faults_are_listed_with_words(capsys: Any) -> None:
    assert main(["faults"]) == ExitCode.DONE
    out = capsys.readouterr().out
    assert all(name in out and words in out for name, words in FAULT_DESCRIPTIONS.items())


def test_a_plan_reaches_the_hands_of_an_open_bench_for_the_window() -> None:
    plan = FaultPlan()
    with plan.wrap(lambda: connect(simulated(), None))() as lab:
        plan.inject("sensor-stuck")
        assert lab.control.active_faults() == ("sensor-stuck",)
        plan.clear()
        assert lab.control.active_faults() == ()
    with pytest.raises(UsageError):
        plan.inject("sensor-stuck")


# -- finding ----------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def served() -> Iterator[ServedBench]:
    with ServedBench(SimulatedBench(clock=WallClock(1.0))) as bench:
        yield bench


@pytest.fixture
def addresses(served: ServedBench, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    monkeypatch.setattr("drivers.list_resources", lambda: ([], []))  # its search of the LAN takes a second
    return ["--host", f"127.0.0.1:{served.scpi.port}", "--server", f"127.0.0.1:{served.card.port}"]


def test_devices_finds_what_is_there(addresses: list[str], capsys: Any) -> None:
    assert main(["devices", "--json", *addresses]) == ExitCode.DONE
    found = json.loads(capsys.readouterr().out)["found"]
    generator, card = found[:2]
    assert (generator["role"], generator["driver"], generator["serial"]) == (
        "generator",
        "keysight-33500",
        "MY00000001",
    )
    assert (card["role"], card["where"], card["serial"]) == ("card", "Dev1", "1A2B3C4")
    assert main(["devices", *addresses]) == ExitCode.DONE
    told = capsys.readouterr().err
    assert f"Next: tactor-bench bench new bench1.toml {' '.join(addresses)}, then tactor-bench commission" in told


def test_devices_warns_of_a_generator_that_must_not_drive_the_amplifier(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("drivers.list_resources", lambda: (["GPIB0::10::INSTR"], []))
    monkeypatch.setattr("drivers.VisaLink", lambda *_: NamedLink("HEWLETT-PACKARD,33120A,0,8.0-5.0-1.0"))
    (found, *_), notes = find_devices()
    assert (found.role, found.driver) == ("instrument", "")
    assert any("it is advised against (Agilent/HP 33120A): its output cannot be switched off" in note for note in notes)


def test_what_is_missing_is_a_sentence_and_no_failure(addresses: list[str], capsys: Any) -> None:
    assert main(["devices", "--host", "127.0.0.1:9"]) == ExitCode.DONE
    output = capsys.readouterr().err
    assert "Next:" not in output
    assert_names(output, "TCPIP::127.0.0.1::9::SOCKET", "refused", "NI-DAQmx")


@pytest.mark.deep
def test_the_search_of_visa_itself_tells_what_it_could_not_look_for() -> None:
    names, notes = list_resources()
    assert all("::" in name for name in names)
    assert all(note.endswith(("libusb-1.0)", "a host that is given is queried")) for note in notes)


@pytest.mark.deep
def test_a_box_on_usb_is_found_with_the_driver_that_knows_it() -> None:
    with UsbTmcBus(SimulatedBench().message_port) as bus:
        found, _ = find_devices()
    (box,) = [one for one in found if one.where.startswith("USB")]
    assert (box.role, box.driver, box.serial) == ("generator", "keysight-33500", SERIAL)
    assert [int(number, 0) for number in box.where.split("::")[1:3]] == [VENDOR, PRODUCT]
    assert bus.resource.split("::")[3:] == box.where.split("::")[3:]


def test_a_first_bench_file_is_written_once_and_can_be_read(addresses: list[str], tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / "bench1.toml"
    assert main(["bench", "new", str(file), *addresses]) == ExitCode.DONE
    config = load_bench(str(file))
    assert config.generator.serial == "MY00000001"
    assert config.card.device == "Dev1"
    assert config.watchdog.own_connection
    before = file.read_text()
    told = capsys.readouterr().err
    assert main(["bench", "new", str(file), *addresses]) == ExitCode.USAGE
    assert file.read_text() == before
    assert str(file) in capsys.readouterr().err
    assert f"Next: tactor-bench commission --bench {file}, with high voltage off" in told


def test_a_first_bench_file_of_nothing_can_be_read_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("app.cli.bench.find_devices", lambda hosts, server: ([], []))
    assert main(["bench", "new", str(tmp_path / "b.toml")]) == ExitCode.DONE
    assert not load_bench(str(tmp_path / "b.toml")).simulated


def test_another_instrument_at_the_address_is_refused() -> None:
    config = simulated()
    wrong = config.model_copy(update={"generator": config.generator.model_copy(update={"serial": "MY99999999"})})
    with (
        pytest.raises(InstrumentError, match=r"#MY00000001 answers where .* serial number MY99999999; .*\[generator\]"),
        laboratory(wrong),
    ):
        pass


# -- calibration --------------------------------------------------------------------------------------------------------


@pytest.mark.one_in(100)
@pytest.mark.parametrize(("day", "flagged"), [("2020-01-31", True), ("2999-01-31", False), ("", False)])
def test_an_expired_calibration_is_a_warning_in_events_points_and_file(day: str, flagged: bool, tmp_path: Path) -> None:
    config = simulated()
    config = config.model_copy(update={"sensor": config.sensor.model_copy(update={"expires": day})})
    with laboratory(config) as lab:
        ran = run(SineDwell(frequencies_hz=(200,), record_s=0.1), tmp_path, lab)
    assert ran.status == RunStatus.COMPLETED
    warnings = [e.text for e in ran.events if isinstance(e, LogMessage) and "expired" in e.text]
    assert bool(warnings) == flagged
    for warning in warnings:
        assert_names(warning, day)
    quality = Quality(ran.points[0].quality)
    assert (Quality.CALIBRATION_EXPIRED in quality) == flagged
    assert quality.usable
    with Run(ran.path) as file:
        assert file.record.configuration["sensor"]["expires"] == day
        assert any(event.kind == "Noted" for event in file.events()) == flagged


def test_a_day_that_is_none_is_a_fault_of_the_bench_file(tmp_path: Path, capsys: Any) -> None:
    file = tmp_path / "bench.toml"
    file.write_text('[generator]\nresource = "x"\n[sensor]\nexpires = "next year"\ncalibrated = 2026-01-31\n')
    assert main(["--bench", str(file), "check"]) == ExitCode.USAGE
    assert "line 4: sensor.expires" in capsys.readouterr().err
