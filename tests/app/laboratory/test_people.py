"""Operator of the day, second person, temperature and humidity: stored in runs and found in the list."""

import json
from datetime import datetime
from pathlib import Path

import pytest

from app.archive.notes import write_notes
from app.cli.main import main
from app.common import ExitCode, UsageError, people
from drivers.errors import LinkError
from drivers.sensors.environment import EnvironmentReading, TextEnvironmentSensor, parse_reading
from drivers.transport.serial_port import SerialPort
from protocols.base import RunConditions
from protocols.runfile.names import notes_path
from protocols.runfile.reader import Run
from protocols.runfile.sidecar import read_notes
from sim_hardware.wires.pty import PtyServer


@pytest.fixture(autouse=True)
def own_settings(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("platformdirs.user_config_path", lambda *_, **__: tmp_path / "settings")
    monkeypatch.setattr("platformdirs.user_cache_path", lambda *_, **__: tmp_path / "cache")


def test_a_name_is_remembered_until_midnight() -> None:
    evening = datetime(2026, 11, 22, 23, 50)
    people.remember_conditions("Anna  Muster", now=evening)
    people.remember_conditions(temperature_c=23.5, now=evening)
    assert people.remembered_conditions(evening) == RunConditions(
        "Anna Muster", "given", 23.5, None, "typed 2026-11-22 23:50"
    )
    assert people.remembered_conditions(datetime(2026, 11, 23, 0, 1)) == RunConditions()


@pytest.mark.parametrize("text", ["", "{", "[]", '{"day": 3}', '{"day": "2026-11-22", "operator": 5, "origin": ""}'])
def test_a_damaged_file_names_nobody(text: str) -> None:
    people.operator_path().parent.mkdir(parents=True)
    people.operator_path().write_text(text)
    assert people.remembered_conditions(datetime(2026, 11, 22)) == RunConditions()
    assert people.current_conditions().operator_origin == people.LOGIN


@pytest.mark.parametrize(
    ("text", "celsius"), [("23.4", 23.4), ("23.4 °C", 23.4), ("296.55 K", 23.4), ("-5 degC", -5.0), ("21.", 21.0)]
)
def test_temperatures_are_read(text: str, celsius: float) -> None:
    assert people.read_temperature(text) == pytest.approx(celsius)


@pytest.mark.parametrize("text", ["", "warm", "23.4 V", "500", "nan", "72 F"])
def test_other_temperatures_are_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="temperature"):
        people.read_temperature(text)


@pytest.mark.parametrize("text", ["", "dry", "0.45", "130 %", "45 C"])
def test_other_humidities_are_refused_in_a_sentence(text: str) -> None:
    with pytest.raises(UsageError, match="humidity"):
        people.read_humidity(text)
    assert people.read_humidity("45 %") == 0.45


@pytest.mark.parametrize(
    ("line", "temperature_c", "humidity"),
    [
        ("RH= 98.4 %RH T= 31.1 'C", 31.1, 0.984),  # HMT330, M210566EN p. 102
        ("RH= 16.03%RH T= 74.66'F", 23.7, 0.1603),  # the same
        (
            "RH= 43.0 %RH T= 21.0 'C Tdp= 8.0 'C x= 6.7 g/kg Tw= 13.7 'C h=34.4 kJ/kg",
            21.0,
            0.43,
        ),  # HMP230, M210225en p. 87
        ("+023.5C", 23.5, None),
        ("296.65 K", 23.5, None),
        ("45 %", None, 0.45),
    ],
)
def test_lines_of_transmitters_are_read(line: str, temperature_c: float | None, humidity: float | None) -> None:
    found = parse_reading(line, "COM3")
    assert found == EnvironmentReading(
        None if temperature_c is None else pytest.approx(temperature_c), humidity and pytest.approx(humidity)
    )


@pytest.mark.parametrize("line", ["", "OK", "T= ***.* 'C", "450 C", "300 %RH"])
def test_lines_that_are_no_reading_are_refused(line: str) -> None:
    with pytest.raises(LinkError, match="COM3 sent"):
        parse_reading(line, "COM3")


class _Transmitter:
    def receive(self, data: bytes) -> bytes:
        return b"SEND\r\nRH= 43.0 %RH T= 21.0 'C\r\n" if data == b"SEND\r" else b""

    def unsolicited_output(self) -> bytes:
        return b""


class _Talker(_Transmitter):
    """Sends by itself."""

    def unsolicited_output(self) -> bytes:
        return b"RH= 43.0 %RH T= 21.0 'C\r\n"


@pytest.mark.parametrize(("transmitter", "request_line"), [(_Transmitter, "SEND"), (_Talker, "")])
def test_a_transmitter_on_a_serial_line_is_read(transmitter: type[_Transmitter], request_line: str) -> None:
    with PtyServer(transmitter()) as server:
        sensor = TextEnvironmentSensor(SerialPort(server.port, 9600, 20.0), request_line)
        assert sensor.read() == EnvironmentReading(21.0, 0.43)
        sensor.close()


@pytest.mark.deep
def test_people_and_air_are_stored_in_a_run_and_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    runs = tmp_path / "runs"
    short = ["--speed", "max", "--out", str(runs), "--set", "frequencies_hz=160", "--set", "record_s=0.1"]
    first = ["--operator", "Anna Muster", "--temperature", "23.4 °C", "--humidity", "45 %"]
    assert main(["run", "sine-dwell", *short, *first]) == ExitCode.DONE
    assert main(["run", "sine-dwell", *short, "--specimen", "T2"]) == ExitCode.DONE, "remembered"
    paths = sorted(runs.glob("*.h5"), key=lambda path: "_T2_" in path.name)  # both may be of the same second
    for path in paths:
        with Run(path) as run:
            found = run.record.conditions
        assert (found.operator, found.temperature_c, found.humidity) == ("Anna Muster", 23.4, 0.45)
        assert found.origin.startswith("typed ")
    capsys.readouterr()
    assert main(["checked", str(paths[0]), "--by", "anna muster"]) == ExitCode.USAGE
    assert "a second person has to check it" in capsys.readouterr().err
    assert main(["checked", str(paths[0]), "--by", "Ben", "--remark", "looked at the phase"]) == ExitCode.DONE
    assert main(["show", str(paths[0])]) == ExitCode.DONE
    shown = capsys.readouterr().out
    for text in (
        "measured by Anna Muster",
        "23.4 °C, 45 % relative humidity (typed",
        "checked by Ben on",
        "33511B #MY",
    ):
        assert text in shown

    def listed(*options: str) -> list[dict[str, object]]:
        capsys.readouterr()
        assert main(["runs", str(runs), "--json", *options]) == ExitCode.DONE
        return list(json.loads(capsys.readouterr().out))

    assert len(listed("--operator", "ANNA muster")) == 2
    assert listed("--operator", "Carl") == []
    (checked,) = listed("--checked-by", "ben")
    assert (checked["checked_by"], checked["operator"], checked["temperature_c"]) == (["Ben"], "Anna Muster", 23.4)
    assert [each["specimen"] for each in listed("--checked-by", "nobody")] == ["T2"]
    assert len(listed("--instrument", "my00000001")) == 2
    assert len(listed("--search", "muster 23.4 instrument:33511B")) == 2
    write_notes(paths[0], tags=("good",))
    assert [check.name for check in read_notes(notes_path(paths[0])).checks] == ["Ben"], "a note keeps the check"
    write_notes(paths[0], tags=())
    assert listed("--checked-by", "ben")
