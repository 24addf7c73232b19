"""Every message of a session in a file, by one line of the bench file; the driver works on its replay without the instrument."""

import json
from pathlib import Path
from typing import Any

import pytest

from app.config import BenchConfig
from app.session.bench_connection import connect
from drivers.drive_shapes import Sine
from drivers.errors import InstrumentError
from drivers.generators.burst import BurstGenerator
from drivers.generators.keysight import Keysight33500
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_self_test import Switch, refusal
from tests.helpers.generators import BOXES, truth
from tests.helpers.simulated_bench import simulated
from tests.sim_hardware.test_outside import outside as outside  # a fixture


def recording(path: Path) -> BenchConfig:
    config = simulated()
    return config.model_copy(update={"source": config.source.model_copy(update={"record_messages": str(path)})})


def session(path: Path) -> list[dict[str, Any]]:
    first, *lines = [json.loads(line) for line in path.read_text("utf-8").splitlines()]
    assert first["format"] == "tactor-bench messages 1"
    return lines


class Replayed:
    """A link that answers as in a record, and fails at the first other message."""

    def __init__(self, path: Path) -> None:
        self.name = json.loads(path.read_text("utf-8").splitlines()[0])["address"]
        self.left = session(path)

    def _next(self, what: str) -> str:
        line = self.left.pop(0)
        assert what in line, (what, line)
        return str(line[what])

    def write(self, message: str) -> None:
        assert self._next("sent") == message

    def read(self) -> str:
        return self._next("received")

    def read_bytes(self, count: int) -> bytes:
        data = self._next("bytes").encode("latin-1")
        assert len(data) == count
        return data

    def clear(self) -> None:
        assert self._next("did") == "clear"

    def close(self) -> None:
        assert self._next("did") == "close"


def work(source: BurstGenerator) -> None:
    source.initialize_at_rest(2.5, 0.0, 5.0)
    source.start_drive(Sine(50.0, 0.5, 2.5, 10))
    source.stop()
    assert source.is_at_rest(2.5, 0.0, 5.0)
    source.close()


@pytest.mark.parametrize("model", BOXES)
def test_a_recorded_session_is_replayed_to_the_driver(model: str, tmp_path: Path) -> None:
    from drivers import MessageRecord

    bench = SimulatedBench(truth(model), VirtualClock())
    path = tmp_path / "messages.jsonl"
    with MessageRecord(path) as record:
        work(BOXES[model](record.around(bench.link(), bench.clock.now), bench.clock))
    times = [line["t"] for line in session(path)]
    assert times == sorted(times)
    replayed = Replayed(path)
    work(BOXES[model](replayed, VirtualClock()))
    assert not replayed.left


def test_a_session_with_a_generator_of_somebody_else_is_replayed(outside: BenchConfig, tmp_path: Path) -> None:
    """It shares no code with the simulators here; its record drives the driver alone, and a changed reply is noticed."""
    from drivers import MessageRecord

    bench = SimulatedBench(outside.simulation_parameters, VirtualClock())
    path = tmp_path / "messages.jsonl"
    with MessageRecord(path) as record:
        work(Keysight33500(record.around(bench.link(), bench.clock.now), bench.clock))
    assert len(session(path)) > 100
    replayed = Replayed(path)
    work(Keysight33500(replayed, VirtualClock()))
    assert not replayed.left
    changed = Replayed(path)
    changed.left[1]["received"] = "HEWLETT-PACKARD,33120A,0,7.0"
    with pytest.raises((AssertionError, InstrumentError)):
        work(Keysight33500(changed, VirtualClock()))


def test_one_line_of_the_bench_file_records_a_session(tmp_path: Path) -> None:
    path = tmp_path / "messages.jsonl"
    with connect(recording(path)) as lab:
        assert refusal(lab, Switch(lab.control)) == ""
    sent = [line["sent"] for line in session(path) if "sent" in line]
    assert sent[0] == "*IDN?"
    assert any(message.startswith("*TRG") for message in sent)
    assert session(path)[-1] == session(path)[-1] | {"did": "close"}


def test_a_record_that_cannot_be_written_is_one_sentence(tmp_path: Path) -> None:
    config = recording(tmp_path / "no such folder" / "x")
    with pytest.raises(InstrumentError, match="correct record_messages in the bench file"), connect(config):
        pass


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a full disk is shown by Linux only")
def test_a_full_disk_ends_the_record_and_keeps_no_message_from_the_instrument(caplog: pytest.LogCaptureFixture) -> None:
    from drivers import MessageRecord

    bench = SimulatedBench(truth("33511B"), VirtualClock())
    with MessageRecord(Path("/dev/full")) as record:
        work(BOXES["33511B"](record.around(bench.link(), bench.clock.now), bench.clock))
    assert "The record of messages ends here: No space left on device" in caplog.text
