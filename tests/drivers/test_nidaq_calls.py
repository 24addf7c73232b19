"""Every call and ordering rule of an NI card's input and output, compared with data that name their sources."""

import tomllib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from nidaqmx.constants import AcquisitionType, Edge, TerminalConfiguration, VoltageUnits, WriteRelativeTo

from drivers.drive_shapes import Sine
from drivers.nidaq.analog_input import NiDigitizer
from drivers.nidaq.analog_output import NiAnalogOutput
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.nidaq.task import SimulatedNiDevice
from sim_hardware.plant.parameters import CardParameters, SimulationParameters
from tests.helpers.simulated_bench import assert_safe_voltage, installed
from tests.wires.ni_library import NiLibrary

pytestmark = pytest.mark.deep

DATA = tomllib.loads((Path(__file__).parents[1] / "data" / "ni_daqmx_calls.toml").read_text("utf-8"))


@dataclass(frozen=True)
class Call:
    """A call of a C function: in which phase, of which task (0: none), and its text as in the data."""

    phase: str
    task: int
    text: str


class RecordingLibrary(NiLibrary):
    """NI's functions, which note each call; one that the stand-in does not have is noted, too."""

    def __init__(self, device: SimulatedNiDevice) -> None:
        self.calls: list[Call] = []
        self.phase = ""
        super().__init__(device)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("DAQmx"):
            self.calls.append(Call(self.phase, 0, name.removeprefix("DAQmx")))
        raise AttributeError(name)

    def _function(self, name: str, call: Callable[..., Any], arguments: tuple[Any, ...]) -> Any:
        def noted(*values: Any) -> Any:
            handle = values[0] if values and isinstance(values[0], int) else 0
            about_card = "SystemInfo" in name or "Error" in name or "Device" in name
            self.calls.append(Call(self.phase, 0 if about_card else handle, text_of(name, values)))
            result = call(*values)
            if name == "CreateTask":  # its handle is what it gives back
                self.calls[-1] = Call(self.phase, values[1][0], name)
            return result

        return super()._function(name, noted, arguments)


def text_of(name: str, values: tuple[Any, ...]) -> str:
    """Return a call as the data have it: the function, and what matters of its arguments."""
    match name:
        case "CreateAIVoltageChan":
            _, channel, _, terminal, low, high, units, _ = values
            return f"{name} {local(channel)} {TerminalConfiguration(terminal).name} {low:g} {high:g} {VoltageUnits(units).name}"
        case "CreateAOVoltageChan":
            _, channel, _, low, high, units, _ = values
            return f"{name} {local(channel)} {low:g} {high:g} {VoltageUnits(units).name}"
        case "CfgSampClkTiming":
            _, source, _, edge, mode, _ = values
            return f"{name} {local(source) or 'onboard'} {AcquisitionType(mode).name} {Edge(edge).name}"
        case "CfgDigEdgeStartTrig":
            return f"{name} {local(values[1])} {Edge(values[2]).name}"
        case "WriteAnalogF64":
            return f"{name} {'started' if values[2] else 'not started'}"
        case "SetWriteAttribute" if values[1] == 0x190C:
            return f"{name} {attribute(values[1])} {WriteRelativeTo(values[2]).name}"
        case _ if name.endswith("Attribute"):
            at = {"GetSystemInfoAttribute": 0, "GetChanAttribute": 2, "SetChanAttribute": 2}.get(name, 1)
            return f"{name} {attribute(values[at])}"
    return name


def local(terminal: bytes) -> str:
    return terminal.decode().strip("/").partition("/")[2]


def attribute(number: int) -> str:
    return str(DATA["attributes"].get(str(number), f"{number:#x}"))


@cache
def recorded() -> tuple[Call, ...]:
    """Return the calls of arm, acquire, play, stop, hold, renew, rest, restart, reconnect and release, with the kind of task."""
    bench = SimulatedBench(
        SimulationParameters(source="ao0", card=CardParameters(traits="start-route=present")), VirtualClock()
    )
    library = RecordingLibrary(SimulatedNiDevice(bench.card, bench.clock, bench.faults))
    with installed(library):
        for library.phase in act(bench):
            pass
    assert_safe_voltage(bench.report())
    tasks: dict[int, list[str]] = {}
    for call in library.calls:
        tasks.setdefault(call.task, []).append(call.text)
    return tuple(Call(c.phase, c.task, f"{kind_of(c.task, tasks[c.task])} {c.text}") for c in library.calls)


def act(bench: SimulatedBench) -> Iterator[str]:
    """Work with both drivers; yield the name of each phase before it."""
    yield "arm"
    source = NiAnalogOutput("Dev1", "ao0", bench.clock, start_trigger="ai/SampleClock")
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    bench.enable_hv()
    yield "acquire"
    digitizer = NiDigitizer("Dev1", ("ai0", "ai1"), bench.clock, terminal="DIFF")
    stream = digitizer.stream(5000.0, 250)
    stream.read()
    yield "play"
    source.start_drive(Sine(50.0, 1.0, 2.5, 10))
    bench.clock.sleep(0.3)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    yield "stop"
    source.start_drive(Sine(50.0, 1.0, 2.5, 500))
    bench.clock.sleep(1.0)
    source.stop()
    yield "hold"
    source.ramp_to(3.0, 0.1)
    yield "renew"
    bench.clock.sleep(2.0)
    source.renew_hold()
    yield "rest"
    source.ramp_to(2.5, 0.1)
    yield "restart"
    stream.restart()
    stream.newest_drive_volts(5.0)
    yield "reconnect"
    source.reconnect()
    yield "release"
    stream.close()
    digitizer.close()
    source.close()


def kind_of(task: int, texts: list[str]) -> str:
    if not task:
        return "card"
    is_output = any(text.startswith("CreateAOVoltageChan") for text in texts)
    is_clocked = any(text.startswith("CfgSampClkTiming") for text in texts)
    return {(True, True): "output", (True, False): "level", (False, True): "input", (False, False): "read-back"}[
        is_output, is_clocked
    ]


def tasks_of(kind: str) -> list[list[str]]:
    """Return the calls of each task of a kind, in order, without the kind."""
    tasks: dict[int, list[str]] = {}
    for call in recorded():
        if call.text.startswith(kind + " "):
            tasks.setdefault(call.task, []).append(call.text.removeprefix(kind + " "))
    return list(tasks.values())


def first_index(calls: list[str], text: str) -> int | None:
    return next((i for i, call in enumerate(calls) if is_call(call, text)), None)


def is_call(call: str, text: str) -> bool:
    return call == text or call.startswith(text + " ")


def test_every_call_has_a_source_and_no_source_is_of_a_call_that_is_not_made() -> None:
    made = {call.text for call in recorded()}
    assert made <= {name for each in DATA["sources"] for name in each["calls"]}
    assert made >= {name for each in DATA["sources"] if not each.get("optional") for name in each["calls"]}


def test_every_source_and_rule_names_where_it_comes_from_or_is_unproven() -> None:
    marks = ("python, ", "grpc", "help: ", "ni.com, ", "knowledge base", " at ", "issue ", "unproven")
    texts = [each["source"] for each in DATA["sources"]]
    texts += [rule["why"] for part in ("never", "order", "phases") for rule in DATA[part]]
    assert not [text for text in texts if not any(mark in text for mark in marks)]


@pytest.mark.parametrize("rule", DATA["never"], ids=lambda rule: rule["calls"][0])
def test_what_would_take_the_output_away_is_never_called(rule: dict[str, Any]) -> None:
    texts = {call.text.removeprefix("card ") for call in recorded()}
    assert not [text for text in texts for never in rule["calls"] if is_call(text, never)], rule["why"]


@pytest.mark.parametrize("rule", DATA["order"], ids=lambda rule: f"{rule['task']} {rule['first']}, {rule['then']}")
def test_the_calls_of_a_task_are_in_order(rule: dict[str, Any]) -> None:
    compared = 0
    for calls in tasks_of(rule["task"]):
        then = first_index(calls, rule["then"])
        if then is None or ("among" in rule and first_index(calls, rule["among"]) is None):
            continue
        first = first_index(calls, rule["first"])
        assert first is not None, (rule, calls)
        assert first < then, (rule, calls)
        compared += 1
    assert compared, rule


@pytest.mark.parametrize("rule", DATA["phases"], ids=lambda rule: rule["phase"])
def test_the_tasks_of_a_phase_are_in_order(rule: dict[str, Any]) -> None:
    calls = iter([call.text for call in recorded() if call.phase == rule["phase"]])
    for step in rule["steps"]:
        assert any(is_call(call, step) for call in calls), (step, rule["why"])


def test_every_task_is_cleared_once_and_an_output_only_where_its_last_value_is_known() -> None:
    for kind in ("output", "level", "input", "read-back"):
        for calls in tasks_of(kind):
            assert calls.count("ClearTask") == 1
            assert calls[-1] == "ClearTask"
            if kind == "output" and "StartTask" in calls:
                assert calls[-2] in ("GetWriteAttribute TOTAL_SAMP_PER_CHAN_GENERATED", "IsTaskDone")


def test_a_task_on_the_output_is_created_after_the_one_before_it_was_cleared() -> None:
    """A task reserves its output; see the rule of the phase "rest"."""
    open_task = 0
    for call in recorded():
        kind, _, text = call.text.partition(" ")
        if kind in ("output", "level") and text == "CreateTask":
            assert not open_task, call
            open_task = call.task
        elif call.task == open_task and text == "ClearTask":
            open_task = 0
    assert not open_task
