"""Terminal: input during prompts, output, machine-readable output, non-interactive use."""

import io
import json
import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from app.cli.headless import SelectedBench, headless_session
from app.plotting.run_picture import run_figure
from app.services import KEY_HELP, ConsoleObserver, ConsoleOperator, JsonObserver
from app.session import BenchFollower
from app.session.session import BenchOpened, Observation, RunRejected
from drivers import CardReading
from model import Specimen
from protocols.base import (
    DISABLE_HIGH_VOLTAGE,
    ENABLE_HIGH_VOLTAGE,
    BenchArmed,
    InterferenceLine,
    InterferenceMeasured,
    LogMessage,
    PointMeasured,
    Prompt,
    PromptAnswered,
    RunPaused,
    RunStarted,
)
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.wiring_check import WiringCheck, WiringPoint
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from tests.helpers.messages import assert_names
from tests.helpers.session_events import LIVE, OPENED, SEEN_AT_REST, STOPPED
from tests.helpers.simulated_bench import laboratory, run, simulated

SHORT = SineDwell(frequencies_hz=(200,), record_s=0.05, min_cycles=5)


@pytest.fixture
def keyboard(monkeypatch: pytest.MonkeyPatch) -> Any:
    """A terminal; what is called types on it."""
    if os.name == "nt":
        pytest.skip("a pseudo-terminal needs POSIX")
    ours, theirs = os.openpty()
    with os.fdopen(theirs, "r") as stdin:
        monkeypatch.setattr(sys, "stdin", stdin)
        yield lambda text: os.write(ours, text.encode())
        os.write(ours, b"\x04")  # ends a thread that still waits for a line
    os.close(ours)


def waited(said: Callable[[], str | None], seconds: float) -> str | None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        if (words := said()) is not None:
            return words
        threading.Event().wait(0.005)
    return None


def test_enter_pressed_before_the_question_is_no_answer(keyboard: Any) -> None:
    operator = ConsoleOperator()
    keyboard("\n\non\n")
    operator.show(1, DISABLE_HIGH_VOLTAGE)
    assert waited(lambda: operator.answer(1), 0.2) is None
    keyboard("\n")
    assert waited(lambda: operator.answer(1), 30) == "done"


def test_high_voltage_is_enabled_by_a_word_and_not_by_enter(keyboard: Any, capsys: Any) -> None:
    operator = ConsoleOperator()
    operator.show(2, ENABLE_HIGH_VOLTAGE)
    keyboard("\n")
    assert waited(lambda: operator.answer(2), 0.2) is None
    keyboard("ON\n")
    assert waited(lambda: operator.answer(2), 30) == "ON"
    output = capsys.readouterr().err
    assert "type 'on' and press Enter; Ctrl-C stops the run" in output
    assert "that is not an answer: type 'on'" in output


def test_one_of_several_choices_is_told_by_its_beginning(keyboard: Any) -> None:
    operator = ConsoleOperator()
    operator.show(3, Prompt("drifted", "Continue, or stop?", choices=("go on", "stop")))
    keyboard("\n")
    assert waited(lambda: operator.answer(3), 0.2) is None
    keyboard("s\n")
    assert waited(lambda: operator.answer(3), 30) == "stop"


class Told:
    """Records pause and resume requests, in order."""

    def __init__(self) -> None:
        self.wishes: list[str] = []

    @property
    def pause_requested(self) -> bool:
        return self.wishes[-1:] == ["pause"]

    def pause(self) -> None:
        self.wishes.append("pause")

    def resume(self) -> None:
        self.wishes.append("resume")

    def stop(self) -> None:
        self.wishes.append("stop")

    def after(self, count: int) -> list[str] | None:
        return list(self.wishes) if len(self.wishes) == count else None


@pytest.mark.parametrize("again", ["", "P"])
def test_p_pauses_and_enter_or_p_goes_on(again: str, keyboard: Any) -> None:
    told = Told()
    with ConsoleOperator().listening(told):
        for count, typed, wish in ((1, "p", "pause"), (2, again, "resume"), (3, "p", "pause")):
            keyboard(f"{typed}\n")
            assert waited(lambda n=count: told.after(n), 5)[-1] == wish


def test_what_is_typed_at_a_prompt_answers_it_and_pauses_nothing(keyboard: Any, capsys: Any) -> None:
    operator, told = ConsoleOperator(), Told()
    with operator.listening(told):
        keyboard("\nwhat\n")
        assert waited(lambda: capsys.readouterr().err or None, 5) == f"  no prompt is open; {KEY_HELP}\n"
        operator.show(5, DISABLE_HIGH_VOLTAGE)
        keyboard("p\n")
        assert waited(lambda: operator.answer(5), 0.2) is None
        keyboard("\n")
        assert waited(lambda: operator.answer(5), 30) == "done"
        operator.show(6, ENABLE_HIGH_VOLTAGE)
        operator(PromptAnswered(6, "seen by the laser"))
        keyboard("p\n")
        assert waited(lambda: told.after(1), 5) == ["pause"]
    assert operator.answer(6) is None


def test_a_run_is_paused_and_goes_on_by_the_keyboard(keyboard: Any, tmp_path: Path, capsys: Any) -> None:
    kinds: list[str] = []
    measured: list[str] = []

    def watch(event: Any) -> None:
        kinds.append(event.kind)
        if isinstance(event, RunPaused):
            measured.append(event.words)
        if kinds.count("EntryBegan") == 2 and kinds[-1] == "EntryBegan":
            keyboard("p\n")
            waited(lambda: front.session.pause_requested or None, 5)
        elif kinds[-1] == "Paused":
            keyboard("\n")

    with headless_session(SelectedBench("sim", simulated(), None), False, [watch]) as front:
        protocol = SineDwell(frequencies_hz=(150, 200), record_s=0.05, min_cycles=5)
        front.session.run(RunRequest(protocol, tmp_path, "T1"))
        front.wait()
        assert front.session.outcome is not None
        assert (front.session.outcome.status, front.session.outcome.reason) == ("completed", "all points measured")
    kept = [kind for kind in kinds if kind in ("EntryBegan", "PointMeasured", "Paused", "Resumed")]
    assert kept == ["EntryBegan", "PointMeasured", "EntryBegan", "Paused", "Resumed", "EntryBegan", "PointMeasured"]
    output = capsys.readouterr().err
    assert f".h5; {KEY_HELP}" in output
    (rest,) = measured
    assert_names(rest, "2.500", "V")
    assert rest in " ".join(output.split())
    assert "continues" in output


def test_a_prompt_at_a_terminal_that_is_closed_stops_the_run(monkeypatch: pytest.MonkeyPatch) -> None:
    other_end, terminal = os.openpty()
    operator, told = ConsoleOperator(), Told()
    with open(terminal, encoding="utf-8") as standard_input:  # noqa: PTH123 - a descriptor
        monkeypatch.setattr(sys, "stdin", standard_input)
        with operator.listening(told):
            assert operator.unreachable_reason == ""
            operator.show(5, DISABLE_HIGH_VOLTAGE)
            os.close(other_end)
            assert waited(lambda: told.after(1), 30) == ["stop"]
            assert operator.unreachable_reason == "the terminal has been closed"
            operator.show(6, ENABLE_HIGH_VOLTAGE)
            assert told.after(2) == ["stop", "stop"]


def test_an_ended_input_is_no_answer(monkeypatch: pytest.MonkeyPatch, capsys: Any) -> None:
    monkeypatch.setattr(sys, "stdin", io.StringIO(""))
    operator = ConsoleOperator()
    operator._read_answer(4, DISABLE_HIGH_VOLTAGE)
    assert "standard input has ended, so nobody can answer" in capsys.readouterr().err
    assert operator.answer(4) is None


@pytest.mark.parametrize(
    ("needed", "says"), [(True, "high voltage is on"), (False, "high voltage is off and stays off")]
)
def test_an_armed_bench_is_told_with_its_high_voltage(needed: bool, says: str) -> None:
    out = io.StringIO()
    with ConsoleObserver(Console(file=out, width=200)) as told:
        told(BenchArmed(needed))
    assert says in out.getvalue()


def test_the_remedy_for_hum_is_an_option_of_the_command_line() -> None:
    out = io.StringIO()
    with ConsoleObserver(Console(file=out, width=400)) as told:
        told(InterferenceMeasured((0, 100), (InterferenceLine(50.0, 1e-6, 1e-8),)))
    assert "mains_shift_hz" in out.getvalue()
    assert SineDwell.model_fields["mains_shift_hz"]


def test_a_name_in_brackets_is_printed_and_not_obeyed() -> None:
    out = io.StringIO()
    with ConsoleObserver(Console(file=out, width=200)) as told:
        told(BenchOpened("bench [red]1[/]", True, {"sensor": "LK [bold]G82"}))
        told(RunStarted("sine-dwell", "/runs/[red]x.h5", 1.0, 1, True))
        told(LogMessage("a :warning: [/nothing] note"))
        told(RunRejected("cannot write [1:2] to [green]here"))
    for text in (
        "bench [red]1[/]",
        "LK [bold]G82",
        "/runs/[red]x.h5",
        "a :warning: [/nothing] note",
        "[1:2] to [green]here",
    ):
        assert text in out.getvalue()


def test_the_last_line_of_a_run_has_the_volts_at_its_end_and_not_their_age() -> None:
    out, follower = io.StringIO(), BenchFollower()
    with ConsoleObserver(Console(file=out, width=200), follower=follower) as told:
        follower.observe = lambda: SEEN_AT_REST
        for event in (OPENED, *LIVE, *STOPPED):
            told(event)
        # Nothing measures any more while the picture of the run is drawn.
        follower.observe = lambda: Observation(CardReading((2.5, 2.5), (2.5, 2.5), time.monotonic() - 4.0))
    assert out.getvalue().rstrip().endswith("0/18  AT REST 0 V")


def test_a_number_that_is_none_is_null_for_a_machine(tmp_path: Path, capsys: Any) -> None:
    point = WiringPoint(*[float("nan")] * 12, float("inf"), 0)
    JsonObserver()(PointMeasured(0, point))
    event = json.loads(capsys.readouterr().out, parse_constant=lambda word: pytest.fail(f"{word} is no JSON"))
    assert event["point"]["latency"] is None
    assert event["point"]["noise"] is None


def test_the_rows_of_a_run_file_are_json_too(tmp_path: Path) -> None:
    with laboratory() as lab:
        ran = run(WiringCheck(record_s=0.5, wait_s=0.1), tmp_path, lab)
    assert np.isnan(ran.points[0].latency)
    with Run(ran.path) as file:
        rows = b"".join(row["text"] for row in file._entry["events"][:])
    assert b"null" in rows
    assert b"NaN" not in rows


@pytest.mark.deep
@pytest.mark.parametrize(("gone", "more"), [("stderr", []), ("stdout", ["--json"])])
def test_a_run_goes_on_when_nobody_listens_any_more(gone: str, more: list[str], tmp_path: Path) -> None:
    read, write = os.pipe()
    os.close(read)
    there = "stdout" if gone == "stderr" else "stderr"
    ours: Any = {gone: write, there: subprocess.PIPE}
    settings = ["--set", "frequencies_hz=200", "--set", "record_s=0.05", "--set", "min_cycles=5"]
    command = [sys.executable, "-m", "app.cli.main", "run", "sine-dwell", "--speed", "max", "--out", str(tmp_path)]
    done = subprocess.run([*command, *settings, *more], timeout=180, text=True, **ours)
    os.close(write)
    assert "Traceback" not in (done.stderr or "")
    with Run(next(tmp_path.glob("*.h5"))) as file:
        assert file.record.state == "completed"


@pytest.mark.deep
def test_a_full_disk_under_the_answer_is_a_sentence() -> None:
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "app.cli.main", "faults"]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, timeout=180)
    assert done.returncode == 1
    assert "No space left on device" in done.stderr
    assert "Traceback" not in done.stderr


@pytest.mark.deep
def test_the_picture_has_the_amplifier_that_the_run_had(tmp_path: Path) -> None:
    tops = []
    for factor in (1, 2):
        config = simulated()
        table = config.amplifier.model_copy(update={"slope_above": 600.0 / factor, "slope_below": 200.0 / factor})
        with laboratory(config.model_copy(update={"amplifier": table})) as lab:
            ran = run(SHORT, tmp_path, lab)
        with Run(ran.path) as file:
            lines = run_figure(file, Specimen()).axes[0].lines
            curve = next(line for line in lines if line.get_linestyle() == "--")
        tops.append(curve.get_ydata().max())
    assert tops[1] == pytest.approx(tops[0] / 2, rel=1e-6)
