"""Runs on the simulated bench by `tb.connect`: results, exceptions, and safe voltage in every case."""

import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

import tactor_bench as tb
from app.config import load_bench
from app.services.console import STILL_ON
from app.services.prompts import prompts_of_run
from app.session.bench_connection import connect
from app.session.session import SessionEvent
from app.session.simulation import FaultPlan, parse_planned_fault
from drivers.errors import MANUAL_SHUTDOWN_INSTRUCTIONS
from drivers.watchdog.log import LOG_NAME
from protocols.base import PointMeasured
from protocols.measurements.sine_dwell import SineDwell
from sim_hardware.bench import SimulatedBench
from tactor_bench import _bench
from tactor_bench._frontend import NotebookFrontEnd
from tests.helpers.messages import assert_names
from tests.helpers.program import ROOT, Program, program, safe

SHORT = {"record_s": "100 ms", "min_cycles": 10}
Event = SessionEvent


def listen(monkeypatch: pytest.MonkeyPatch, observer: Callable[[Event], object]) -> None:
    """Call `observer` with every event of every bench, in the session's thread."""
    observe = tb.BenchSession._observe

    def both(self: tb.BenchSession, event: Event) -> None:
        observe(self, event)
        observer(event)

    monkeypatch.setattr(tb.BenchSession, "_observe", both)


def break_it(monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    plan = FaultPlan([parse_planned_fault(fault)])
    monkeypatch.setattr(
        _bench, "open_instruments", lambda *given, **named: plan.wrap(lambda: connect(*given, **named))()
    )
    listen(monkeypatch, plan)


def test_benches_leave_no_threads_and_share_the_one_that_closes_them_at_exit(tmp_path: Path) -> None:
    for _ in range(2):
        tb.connect("sim", folder=tmp_path, speed="max").close()
    assert sum(thread.name == _bench._CLOSER.name for thread in threading.enumerate()) == 1
    for thread in threading.enumerate():
        if thread.name in ("bench", "session supervisor", "way to rest"):
            thread.join(30.0)
            assert not thread.is_alive(), thread.name


def test_a_run_is_returned_opened_and_its_progress_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with tb.connect("sim", folder=tmp_path, speed="max", seed=5, specimen="T7") as bench:
        assert (bench.name, bench.simulated, bench.identities["card"][:2]) == (load_bench("sim").name, True, "NI")
        first = bench.run("sine-dwell", frequencies_hz=np.array([100, 160]), **SHORT)
        second = bench.run(SineDwell(frequencies_hz=(120,)), specimen="T8", folder=tmp_path / "more")
    measured = first.points["frequency"]
    with h5py.File(first.path) as file:
        np.testing.assert_array_equal(measured, file["entry/points/frequency"][:])
    assert (first.status, first.specimen, first.path.parent) == ("completed", "T7", tmp_path)
    assert first.points["frequency"] == pytest.approx([100, 160], abs=0.01)
    assert first.parameters["record_s"] == 0.1
    assert first.configuration["simulation"]["seed"] == 5
    assert (second.specimen, second.path.parent) == ("T8", tmp_path / "more")
    captured = capsys.readouterr()
    assert_names(captured.err, "160.002")  # the generator's clock is 14 ppm fast
    assert captured.err.count("good: all points measured") == 2
    assert captured.out == ""
    with pytest.raises(tb.BenchError, match=rf"{bench.name}.*\bclosed\b"):
        bench.run("sine-dwell", **SHORT)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"protocol": "cheese"}, "there is no protocol 'cheese'; the protocols are: "),
        ({"protocol": "sine-dwell", "volts": 3}, "sine-dwell has no parameter 'volts'; it has: "),
        ({"protocol": "sine-dwell", "mains_shift": 3}, "'mains_shift'; mains_shift_hz"),
        ({"protocol": "sine-dwell", "peak_to_peak_v": "7 V"}, "peak_to_peak_v: must be at most 5 V, not 7 V"),
        ({"protocol": "sine-dwell", "parameters": {"record_s": "3 kg"}}, "record_s: '3 kg' is not a quantity in s"),
        ({"protocol": SineDwell(), "record_s": 1.0}, "give them there, or give the protocol's name"),
    ],
)
def test_wrong_parameters_are_a_value_error_before_anything_moves(
    given: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with (
        tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench,
        pytest.raises(ValueError, match=message),
    ):
        bench.run(**given)
    assert list(tmp_path.iterdir()) == []


def test_a_wrong_bench_is_a_value_error_and_an_absent_one_a_bench_error(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="cannot be read: No such file"):
        tb.connect(tmp_path / "gone.toml")
    with pytest.raises(ValueError, match=r"^speed 99: .*\b1 to 20\b.*'max'"):
        tb.connect("sim", speed=99)
    real = tmp_path / "bench.toml"
    real.write_text('[generator]\nresource = "TCPIP::127.0.0.1::9::SOCKET"\n')
    with pytest.raises(ValueError, match=r"^speed\b.*\bsimulated\b"):
        tb.connect(real, speed=2)
    with pytest.raises(tb.BenchError, match=r"\bNI-DAQmx\b.*\binstall"):
        tb.connect(real, progress=False)


@pytest.mark.deep
def test_a_run_that_fails_raises_with_what_was_measured(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    break_it(monkeypatch, "scpi-dropped@4")
    with tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench:
        with pytest.raises(tb.RunFailedError, match=r"\b33511B\b.*\blost\b") as failed:
            bench.run("sine-dwell")
        assert failed.value.path is not None
        failure = tb.open_run(failed.value.path)
        assert failure.status == "failed"
        assert len(failure.points["frequency"]) > 0


@pytest.mark.deep
def test_a_failed_run_is_returned_where_that_is_wanted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    break_it(monkeypatch, "scpi-dropped@4")
    with tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench:
        assert bench.run("sine-dwell", check=False).status == "failed"


def test_a_run_that_cannot_be_stored_fails_without_a_file() -> None:
    with tb.connect("sim", folder="/proc/nowhere", speed="max", progress=False) as bench:
        with pytest.raises(tb.RunFailedError, match=r"/proc/nowhere\b") as failed:
            bench.run("sine-dwell", check=False)
        assert failed.value.path is None


@pytest.mark.one_in(100)
@pytest.mark.breaks_the_drive
@pytest.mark.parametrize("check", [True, False])
def test_unsafe_always_raises_and_says_what_to_do(check: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    break_it(monkeypatch, "generator-power-off@2")
    with (
        tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench,
        pytest.raises(tb.UnsafeError, match=re.escape(MANUAL_SHUTDOWN_INSTRUCTIONS)) as unsafe,
    ):
        bench.run("sine-dwell", check=check)
    assert str(next(tmp_path.glob("*.h5"))) in unsafe.value.__notes__[0]


def test_an_exception_in_the_body_closes_the_bench_at_rest(tmp_path: Path) -> None:
    def body() -> None:
        with tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench:
            bench.run("sine-dwell", frequencies_hz=[100], **SHORT)
            raise ZeroDivisionError

    with pytest.raises(ZeroDivisionError):
        body()
    assert not [thread for thread in threading.enumerate() if thread.name == "bench"]


def test_a_bench_that_is_closed_from_another_thread_ends_the_run_at_rest(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    closing = []

    def close(event: Event) -> None:
        if isinstance(event, PointMeasured) and not closing:
            closing.append(threading.Thread(target=bench.close))
            closing[0].start()

    listen(monkeypatch, close)
    bench = tb.connect("sim", folder=tmp_path, speed="max", progress=False)
    with pytest.raises(tb.RunFailedError, match=r"\boperator\b.*\bof 18\b") as stopped:
        bench.run("sine-dwell")
    closing[0].join()
    assert stopped.value.path is not None
    assert tb.open_run(stopped.value.path).status == "stopped"


@pytest.mark.deep
def test_a_second_run_beside_the_first_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    caught: list[Exception] = []

    def again(event: Event) -> None:
        if isinstance(event, PointMeasured) and not caught:
            try:
                bench.run("sine-dwell")
            except tb.BenchError as error:
                caught.append(error)

    listen(monkeypatch, again)
    with tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench:
        assert bench.run("sine-dwell", frequencies_hz=[100], **SHORT).status == "completed"
    assert [type(error) for error in caught] == [tb.BenchError]
    assert_names(str(caught[0]), "run", "progress")
    assert len(list(tmp_path.glob("*.h5"))) == 1


def test_ctrl_c_brings_the_bench_to_rest_and_is_a_keyboard_interrupt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    interrupted: list[Event] = []

    def interrupt(event: Event) -> None:
        if isinstance(event, PointMeasured) and not interrupted:
            interrupted.append(event)
            signal.raise_signal(signal.SIGINT)

    listen(monkeypatch, interrupt)
    before = signal.getsignal(signal.SIGINT)
    with tb.connect("sim", folder=tmp_path, speed="max", progress=False) as bench:
        with pytest.raises(KeyboardInterrupt, match=r"\boperator\b.*\b[1-9]\d* of 18\b.*\bat rest\b"):
            bench.run("sine-dwell")
        assert signal.getsignal(signal.SIGINT) is before
        assert bench.run("sine-dwell", frequencies_hz=[100], **SHORT).status == "completed"
    stopped = tb.runs(tmp_path, status="stopped")
    assert [run.points > 0 for run in stopped] == [True]


@pytest.mark.deep
def test_a_bench_that_was_left_open_does_not_keep_python_from_ending(tmp_path: Path) -> None:
    code = "import tactor_bench as tb; bench = tb.connect('sim', speed='max', progress=False); print(bench)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, timeout=180, check=True
    )
    assert done.stdout.strip() == "<simulated bench, SIMULATED: at rest>"


# -- in a notebook: IPython is not among the test's packages, so `input` and the display are stand-ins ------------------


class Notebook:
    """Answers the prompts of a virtual bench as a notebook user does; `says` is called for each."""

    def __init__(self, says: Callable[[str, SimulatedBench], str]) -> None:
        self.says, self.asked = says, list[str]()
        self.bench: SimulatedBench

    @contextmanager
    def connect(self, *given: Any, **named: Any) -> Iterator[Any]:
        with connect(*given, **named) as laboratory:
            self.bench = laboratory.control
            yield replace(laboratory, operator=None)

    def input(self, prompt: str) -> str:
        self.asked.append(prompt)
        return self.says(prompt, self.bench)

    def run(self, monkeypatch: pytest.MonkeyPatch, folder: Path, *given: Any, **more: Any) -> tb.MeasuredRun:
        monkeypatch.setattr("builtins.input", self.input)
        monkeypatch.setattr(_bench, "open_instruments", self.connect)
        monkeypatch.setattr(_bench, "front_end", NotebookFrontEnd)
        with tb.connect("sim", folder=folder, speed="max", progress=False) as bench:
            bench._front_end._real = True
            return bench.run(*given, **more)


def switch(prompt: str, bench: SimulatedBench) -> str:
    """Switch high voltage as the prompt says."""
    if "'on'" in prompt:
        bench.enable_hv()
        return "on"
    bench.disable_hv()
    return ""


def until_interrupted() -> str:
    """Wait as `input` of a kernel does: in pieces, between which a signal is handled."""
    end_s = time.monotonic() + 30
    while time.monotonic() < end_s:
        time.sleep(0.01)
    raise AssertionError("the prompt was not withdrawn")


def test_prompts_are_answered_by_input(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    typed = iter(["", "no"])

    def says(prompt: str, bench: SimulatedBench) -> str:
        wrong = next(typed, None) if "'on'" in prompt else None
        return switch(prompt, bench) if wrong is None else wrong

    notebook = Notebook(says)
    run = notebook.run(monkeypatch, tmp_path, "sine-dwell", frequencies_hz=[100], **SHORT)
    assert run.status == "completed"
    off, on = prompts_of_run(SineDwell(), 2.5)[:2]
    assert notebook.asked[0].startswith(off.text)
    assert notebook.asked[0].endswith("(press Enter when it is done; interrupting the kernel stops the run) ")
    assert notebook.asked[1].startswith(on.text)
    assert notebook.asked[-1].partition(". ")[2].startswith(on.text), "asked again, after a refusal"
    assert capsys.readouterr().out == f"{STILL_ON}\n"


@pytest.mark.deep
def test_a_prompt_that_the_laser_answers_is_withdrawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def says(prompt: str, bench: SimulatedBench) -> str:
        if "Place the 100 g" in prompt or "Take the 100 g" in prompt:
            action = "place-weight" if "Place" in prompt else "remove-weight"
            bench.perform_action(action, {"mass_kg": 0.1, "side": 1.0})
            return until_interrupted()
        if "MFC side up" in prompt:
            bench.perform_action("turn-side", {"side": 1.0, "offset_kg": 0.0, "shorted": 1.0})
            return ""
        return switch(prompt, bench)

    notebook = Notebook(says)
    weights = {"weights_kg": [0.1], "weight_class": "own", "weight_errors_kg": [1e-6]}
    run = notebook.run(
        monkeypatch, tmp_path, "static-loading", **weights, repeats=1, sides="MFC up", offset_kg=0, check=False
    )
    assert run.status == "completed"
    answers = [entry.fields["words"] for entry in run.log if "words" in entry.fields and "ask_id" in entry.fields]
    assert answers[-2:] == ["seen by the laser"] * 2


@pytest.mark.deep
def test_a_notebook_may_run_it_in_a_thread(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    runs: list[tb.MeasuredRun] = []
    notebook = Notebook(switch)
    thread = threading.Thread(
        target=lambda: runs.append(
            notebook.run(monkeypatch, tmp_path, "sine-dwell", frequencies_hz=[100], **SHORT, check=False)
        )
    )
    thread.start()
    thread.join()
    assert [run.status for run in runs] == ["completed"]


def test_an_interrupt_at_a_prompt_ends_the_run_at_rest(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def says(_prompt: str, _bench: SimulatedBench) -> str:
        signal.raise_signal(signal.SIGINT)
        return until_interrupted()

    with pytest.raises(KeyboardInterrupt, match=r"\boperator\b.*\b0 of 18\b"):
        Notebook(says).run(monkeypatch, tmp_path, "sine-dwell")


def test_where_nobody_can_type_the_run_fails_with_the_prompt(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def says(_prompt: str, _bench: SimulatedBench) -> str:
        raise EOFError("no standard input")

    with pytest.raises(tb.RunFailedError, match=r"no operator can answer in this notebook .*: Switch the amplifier"):
        Notebook(says).run(monkeypatch, tmp_path, "sine-dwell")


# -- a script in a process of its own, on real wires ------------------------------------------------------------------

SCRIPT = """
import tactor_bench as tb
with tb.connect("bench.toml", folder=".", without_commissioning="simulated bench on its wires") as bench:
    run = bench.run("sine-dwell", frequencies_hz={frequencies}, settle_limit_s=2, record_s={record_s})
    print("rows:", len(run.points["frequency"]), flush=True)
    {then}
"""
PATIENT = "silence_s = 5"


def script(
    folder: Path, frequencies: str = "[100, 150, 160, 170]", record_s: float = 0.5, then: str = "", watchdog: str = ""
) -> Any:
    code = SCRIPT.format(frequencies=frequencies, record_s=record_s, then=then)
    return program(folder, script=code, watchdog=watchdog)


def live(run: Program) -> None:
    run.go_live()
    run.wait_for("100.0")


@pytest.mark.deep
def test_sigint_in_mid_run_is_a_keyboard_interrupt_after_rest(tmp_path: Path) -> None:
    with script(tmp_path, watchdog=PATIENT) as (run, _):
        live(run)
        run.process.send_signal(signal.SIGINT)
        assert run.end() in (1, 130, -signal.SIGINT), run.text
        assert re.search(r"KeyboardInterrupt: .*\boperator\b", run.text)
        assert STILL_ON in run.text
        assert run.text.index("At rest: the card sees 2.500 V") < run.text.index("KeyboardInterrupt")
        safe(run.bench)
    assert tb.open_run(run.file).status == "stopped"


@pytest.mark.deep
def test_an_exception_in_the_body_leaves_rest_on_real_wires(tmp_path: Path) -> None:
    with script(tmp_path, frequencies="[100]", then="raise RuntimeError('mine')", watchdog=PATIENT) as (run, _):
        run.arm()
        assert run.end() == 1
        assert "rows: 1 " in run.text
        assert run.text.endswith("RuntimeError: mine")
        assert safe(run.bench).outside_rest_s > 0.3


@pytest.mark.deep
def test_sigterm_in_mid_run_ends_the_script_after_rest(tmp_path: Path) -> None:
    with script(tmp_path, watchdog=PATIENT) as (run, _):
        live(run)
        run.process.send_signal(signal.SIGTERM)
        assert run.end() == -signal.SIGTERM, run.text
        assert "At rest: the card sees 2.500 V" in run.text
        safe(run.bench)
    assert tb.open_run(run.file).status == "stopped"


@pytest.mark.deep
def test_a_script_that_is_killed_while_live_is_brought_to_rest_by_the_watchdog(tmp_path: Path) -> None:
    with script(tmp_path, frequencies="[100]", record_s=60, watchdog=PATIENT) as (run, served):
        run.go_live()
        run.process.kill()
        deadline, log = time.monotonic() + 90, tmp_path / LOG_NAME
        while not (log.exists() and "was brought to rest" in log.read_text()):
            assert time.monotonic() < deadline
            time.sleep(0.02)
        report = served.bench.report()
        assert report.ends_at_rest
        assert report.outside_rest_s < 60.0
        safe(run.bench)
