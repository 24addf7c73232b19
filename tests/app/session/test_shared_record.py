"""Shared commissioning records: without private facts, refused in a sentence, and counted in the table of assumptions."""

import getpass
import json
import re
import socket
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.cli.main import main
from app.common import ExitCode, UsageError
from app.session import commissioning_record
from app.session.commissioning_record import make_record
from app.session.shared_record import FORMAT, proven_boxes, read_shared_records, shared_record
from docs.make_reference import HERE, with_assumptions
from drivers import Identity
from drivers.evidence.assumption import OutputCheck
from drivers.evidence.evidence_files import assumptions, assumptions_about
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, CommandTime, MeasuredTimes
from tests.helpers.messages import assert_names

SERIAL = "SDG6XFCC900309"
BOX = Identity("Siglent Technologies", "SDG6022X", SERIAL, f"6.01.01.38R3-{SERIAL}")
ADDRESS, PERSON, FOLDER = "TCPIP::192.0.2.7::5025::SOCKET", "Jane Doe", "/home/jane/benches"
LEVELS = "output while a waveform is uploaded and selected"


def found(settings_v: float = 0.003, scale: float = 1.004) -> Commissioned:
    checks = (
        CheckedOutput(OutputCheck.SETTINGS, settings_v, "V", None, 0.04, f"'{ADDRESS}' of {PERSON} in {FOLDER}"),
        CheckedOutput(OutputCheck.SCALE, scale, "1", 0.97, 1.03),
        CheckedOutput(OutputCheck.WIRE, float("nan"), "V", None, 0.03, f"{ADDRESS} was silent"),
    )
    commands = (CommandTime("C1:BSWV", 12, 0.001, 0.02), CommandTime(f"C1:WVDT WVNM,{PERSON}", 1, 0.1, 0.1))
    times = MeasuredTimes(0.2, 1e-3, float("nan"), 0.4)
    return Commissioned(checks, times, (), (f"{ADDRESS}: silent",), True, commands, "big-endian")


def shared(result: Commissioned | None = None, box: Identity = BOX) -> dict[str, Any]:
    return shared_record(make_record(box, False, 1e5, result or found()))


def write(folder: Path, name: str, record: Any) -> Path:
    folder.mkdir(exist_ok=True)
    path = folder / name
    path.write_text(record if isinstance(record, str) else json.dumps(record), "utf-8")
    return path


def test_a_shared_record_holds_the_figures_and_no_private_fact() -> None:
    record = shared()
    text = json.dumps(record)
    private = (
        SERIAL,
        ADDRESS,
        "192.0.2",
        PERSON,
        "Jane",
        FOLDER,
        "/home",
        "silent",
        getpass.getuser() + " ",
        socket.gethostname() + " ",
    )
    assert not [fact for fact in private if fact in text]
    assert not re.search(r"\d\d:\d\d", text), "no time of day"
    assert (record["model"], record["firmware"], record["byte_order"]) == ("SDG6022X", "6.01.01.38R3", "big-endian")
    assert record["checks"][1] == {"name": OutputCheck.SCALE, "value": 1.004, "unit": "1", "low": 0.97, "high": 1.03}
    assert record["times"]["stop_s"] == 0.2
    assert [each["command"] for each in record["commands"]] == ["C1:BSWV"]


@pytest.mark.deep
def test_commission_writes_a_record_that_is_accepted_but_for_its_simulation(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(commissioning_record, "user_data_path", lambda *_, **__: tmp_path / "data")
    bench = write(tmp_path, "bench.toml", f'name = "{PERSON}s bench"\n[simulation.generator]\nmodel = "SDG6022X"\n')
    file = tmp_path / "boxes" / "box.json"
    file.parent.mkdir()
    assert (
        main(["commission", "--bench", str(bench), "--speed", "max", "--json", "--share", str(file)]) == ExitCode.DONE
    )
    stored = json.loads(capfd.readouterr().out)
    text = file.read_text("utf-8")
    for fact in (stored["serial"], PERSON, str(tmp_path), stored["date"], stored["file"]):
        assert fact
        assert fact not in text
    with pytest.raises(UsageError) as refused:
        read_shared_records(file.parent)
    assert_names(str(refused.value), file, "simulated")
    write(file.parent, "box.json", {**json.loads(text), "simulated": False})
    boxes = proven_boxes(read_shared_records(file.parent))
    assert {row.quantity for row in boxes} == {
        each["property"]
        for each in stored["assumptions"]
        if each["verdict"] == "pass" and each["property"] in {r.quantity for r in assumptions_about("SDG6022X")}
    }


def test_records_raise_an_assumption_to_proven_on_so_many_boxes(tmp_path: Path) -> None:
    page = (HERE / "generators.md").read_text("utf-8")
    before = with_assumptions(page, tmp_path)
    write(tmp_path, "one.json", shared())
    one = with_assumptions(page, tmp_path)
    write(tmp_path, "two.json", shared(found(scale=1.011)))
    write(tmp_path, "three.json", shared(found(settings_v=0.2)))
    three = with_assumptions(page, tmp_path)
    unproven, row = re.compile(r"and (\d+) are only \*unproven\*"), re.compile(rf"siglent-sdg.*\| {LEVELS} \|.*")
    at_first, later = (int(unproven.search(text)[1]) for text in (before, one))  # type: ignore[index]
    assert at_first == len([each for each in assumptions() if each.is_unproven])
    assert later == at_first - 1
    texts = [row.search(text)[0] for text in (before, one, three)]  # type: ignore[index]
    assert ["proven on 1 box*" in text for text in texts] == [False, True, False]
    assert "proven on 2 boxes*" in texts[2], "a box that differs does not count"
    assert "*unproven*" in texts[0]
    assert "*unproven*" not in texts[2]
    boxes = proven_boxes(read_shared_records(tmp_path))
    assert {each.driver for each in boxes} == {"siglent-sdg"}


def test_the_same_box_counts_once(tmp_path: Path) -> None:
    write(tmp_path, "a.json", shared())
    write(tmp_path, "b.json", {**shared(), "day": "2026-01-01"})
    with pytest.raises(UsageError) as refused:
        read_shared_records(tmp_path)
    assert_names(str(refused.value), tmp_path / "b.json", "a.json", "same")


BAD = {
    "no JSON": "nonsense",
    "a list": [],
    "another format": {"format": "tactor-bench shared commissioning 9"},
    "a further field": {"serial": SERIAL},
    "an address": {"firmware": "TCPIP::192.0.2.7::inst0 of jane@example.org"},
    "a long text": {"maker": "x" * 100},
    "a time of day": {"day": "2026-11-28T10:11:12"},
    "no day": {"day": "2026-13-99"},
    "an unknown model": {"model": "WG-1"},
    "an unknown check": {"checks": [{"name": "smell", "value": 1.0, "unit": "V", "low": None, "high": None}]},
    "a detail": {"checks": [{"name": "polarity", "value": 1.0, "unit": "1", "low": 1, "high": 1, "detail": PERSON}]},
    "a text for a figure": {"checks": [{"name": "polarity", "value": "1", "unit": "1", "low": 1, "high": 1}]},
    "an infinite figure": {"checks": [{"name": "polarity", "value": float("inf"), "unit": "1", "low": 1, "high": 1}]},
    "a name among the times": {"times": {PERSON: 1.0}},
    "a waveform's name": {
        "commands": [{"command": f"WVDT WVNM,{PERSON}", "count": 1, "median_s": 0.1, "longest_s": 0.1}]
    },
    "a switch for a rate": {"rate_hz": True},
    "simulated": {"simulated": True},
}


@pytest.mark.one_in(1)
@pytest.mark.parametrize("bad", BAD)
def test_a_bad_record_is_refused_in_a_sentence(bad: str, tmp_path: Path) -> None:
    change = BAD[bad]
    write(tmp_path, "bad.json", {**shared(), **change} if isinstance(change, dict) else change)
    with pytest.raises(UsageError) as refused:
        read_shared_records(tmp_path)
    sentence = str(refused.value)
    assert_names(sentence, tmp_path / "bad.json", "anew")
    assert len(sentence.removeprefix(str(tmp_path))) < 200
    assert "\n" not in sentence


def test_a_record_that_lacks_a_field_is_refused(tmp_path: Path) -> None:
    for name in shared():
        write(tmp_path, "bad.json", {key: value for key, value in shared().items() if key != name})
        with pytest.raises(UsageError) as refused:
            read_shared_records(tmp_path)
        assert_names(str(refused.value), f"'{name}'")


def test_the_records_of_this_repository_are_accepted() -> None:
    assert read_shared_records(HERE / "evidence" / "boxes") is not None
    assert shared()["format"] == FORMAT
    assert shared(replace(found(), byte_order=""))["byte_order"] == ""
