"""Commissioning of simulated generators: every deviation that shows at the output is found, and nothing else."""

import math

import pytest

from app.config.bench_file import BenchConfig
from app.config.driver_registry import SOURCES, built_in_names, load_driver
from app.session.bench_connection import connect
from drivers.evidence.assumption import Assumption, OutputCheck
from drivers.evidence.evidence_files import assumptions, assumptions_about
from drivers.transport.observed_link import ObservedLink
from protocols.commissioning.messages import MessageKind, MessageLog, message_kind
from protocols.commissioning.sequence import PLANNED_S, commission_bench
from protocols.commissioning.verdict import CheckedOutput, CommandTime, OutputVerdict, checked_assumptions
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.registry import deviations_of
from sim_hardware.generators.traits import DEVIATIONS
from tests.helpers.commissioning import (
    PROPERTIES,
    OffSwitch,
    commissioned,
    commissioned_bench,
    contradicted,
    deviating,
    draw_deviations,
)
from tests.helpers.simulated_bench import simulated

MODELS = (
    "33511B",
    "33622A",
    "33220A",
    "33250A",
    "EDU33212A",
    "FG33532A",
    "G5100A",
    "DG1032Z",
    "DG811",
    "DG2052",
    "DG4162",
    "SDG1032X",
    "SDG2122X",
    "SDG6022X",
    "AFG31052",
    "AFG3102",
    "AFG1022",
)
LEVELS = {OutputCheck.REST, OutputCheck.OFFSET, OutputCheck.SETTINGS, OutputCheck.LONG_LEVEL}

FAMILIES = ("33622A", "33220A", "DG1032Z", "SDG1032X", "AFG3102")


def test_an_instrument_as_assumed_passes() -> None:
    found = commissioned_bench(simulated(generator={"model": "33511B"}), rate_hz=20e3)
    assert deviating(found) == set(), found.checks
    assert 0.05 < found.times.stop_s < 1.0
    assert found.times.start_s < 0.01


@pytest.mark.deep
@pytest.mark.parametrize("model", MODELS)
def test_every_model_as_assumed_passes_whatever_its_unknown_traits(model: str) -> None:
    for seed in (1, 2):
        found = commissioned(model, seed=seed)
        assert deviating(found) == set(), found.checks


@pytest.mark.deep
@pytest.mark.parametrize(
    ("model", "name", "option"),
    [
        (model, trait.name, option)
        for model in FAMILIES
        for trait in deviations_of(model)
        for option in trait.options[1:]
    ],
)
def test_one_deviation_is_found_and_nothing_else(model: str, name: str, option: str) -> None:
    """Two instruments that differ in one trait are told apart, by the property in which they differ."""
    found = commissioned(model, f"{name}={option}")
    assert deviating(found) == contradicted(model, {name: option}), found.checks


@pytest.mark.deep
@pytest.mark.parametrize(
    ("model", "seed"), [*((model, 0) for model in MODELS), *((model, seed) for model in FAMILIES for seed in (1, 2))]
)
def test_deviations_drawn_blind_are_found_and_nothing_else(model: str, seed: int) -> None:
    chosen = draw_deviations(model, seed)
    found = commissioned(model, " ".join(f"{n}={o}" for n, o in chosen.items()), seed)
    assert deviating(found) == contradicted(model, chosen), (chosen, found.checks)


@pytest.mark.deep
@pytest.mark.parametrize(("trait", "order"), [("byte-order=big", "big-endian"), ("byte-order=little", "little-endian")])
def test_both_byte_orders_are_tried_where_the_documents_disagree(trait: str, order: str) -> None:
    found = commissioned("SDG6022X", trait)
    assert deviating(found) == set(), found.checks
    assert found.byte_order == order
    wrong = commissioned("SDG6022X", f"{trait} scale=fourfold output-polarity=inverted")
    assert OutputCheck.SCALE in deviating(wrong)
    assert wrong.byte_order == order, "an instrument that differs otherwise keeps its order"


def test_an_instrument_of_one_byte_order_is_not_asked_for_the_other() -> None:
    assert commissioned("SDG2122X").byte_order == ""


@pytest.mark.deep
@pytest.mark.parametrize("model", ["DG812", "SDG2122X", "AFG3102"])
@pytest.mark.parametrize("retime", ["continues", "at-next-burst", "restarts"])
def test_whether_stop_may_hasten_the_end_of_a_level_is_measured_and_is_no_deviation(model: str, retime: str) -> None:
    found = commissioned(model, f"retime={retime}")
    assert deviating(found) == set(), found.checks
    assert (found.times.level_stop_s < 1.5) is (retime == "continues")
    assert math.isnan(found.times.level_stop_s) is (retime != "continues")
    assert 0 < found.times.upload_s < 10


@pytest.mark.deep
def test_progress_names_what_is_measured_and_grows() -> None:
    begun: list[tuple[str, float]] = []
    with connect(simulated(generator={"model": "SDG1032X"}), None, 0.1) as lab:
        assert lab.control is not None
        switch, messages = OffSwitch(lab.control), MessageLog()
        commission_bench(lab.bench, switch, 20e3, messages, lambda name, fraction: begun.append((name, fraction)))
    names = [name for name, _ in begun]
    assert names == [name for name in PLANNED_S if name != "second connection"]
    fractions = [fraction for _, fraction in begun]
    assert fractions == sorted(fractions)
    assert 0.0 == fractions[0] < fractions[-1] < 1.0


@pytest.mark.deep
@pytest.mark.parametrize("exercise", ["larger sine", "level above rest", "long level", "Stop in mid-level"])
def test_stop_in_the_middle_of_an_exercise_leaves_the_source_at_rest(exercise: str) -> None:
    class Stopped(Exception):
        pass

    now: list[str] = []
    blocks = [0]

    def check_stop() -> None:
        blocks[0] += now[-1:] == [exercise]
        if blocks[0] > 8:  # not before it plays
            raise Stopped

    with connect(simulated(generator={"model": "SDG1032X"}), None, 0.1) as lab:
        assert lab.control is not None
        switch, messages = OffSwitch(lab.control), MessageLog()
        with pytest.raises(Stopped):
            commission_bench(lab.bench, switch, 20e3, messages, lambda name, _: now.append(name), check_stop=check_stop)
        assert now[-1] == exercise
        assert lab.bench.amplifier.is_source_at_rest()
        lab.bench.clock.sleep(0.1)
        assert abs(lab.control.report().end_v - 2.5) < 0.02


@pytest.mark.deep
@pytest.mark.parametrize("late", [(0.05, 0.1), (0.9, 0.04)], ids=["seldom, up to 0.1 s", "nearly always, up to 40 ms"])
@pytest.mark.parametrize(
    ("model", "traits"),
    [(model, "") for model in FAMILIES]
    + [("33622A", "abort=drops offset=low output-polarity=inverted"), ("33220A", "range=switches")]
    + [("DG1032Z", "abort=drops")],
)
def test_late_messages_and_replies_change_no_check(model: str, traits: str, late: tuple[float, float]) -> None:
    """A burst that begins late is found, and steps of Stop are never sent ahead, so that each transient has its cause."""
    found = commissioned_bench(simulated(generator={"model": model, "traits": traits}), late)
    chosen = dict(pair.split("=") for pair in traits.split())
    assert deviating(found) == contradicted(model, chosen), found.checks


@pytest.mark.deep
@pytest.mark.parametrize(("kind", "unmeasured"), [("card-output", set()), ("dc-supply", set(OutputCheck) - LEVELS)])
def test_other_sources_pass_in_what_they_can_play(kind: str, unmeasured: set[OutputCheck]) -> None:
    found = commissioned_bench(BenchConfig.model_validate({**simulated().model_dump(), "source": {"kind": kind}}))
    assert deviating(found) == set()
    assert {check.check for check in found.checks} == set(OutputCheck) - unmeasured - {
        OutputCheck.START_ROUTE,
        OutputCheck.INTERLOCK,
    }
    if kind == "dc-supply":
        rows = checked_assumptions(assumptions_about("E36312A"), found.checks)
        assert not [row for row in rows if row.verdict not in (OutputVerdict.PASS, OutputVerdict.HIDDEN)]


@pytest.mark.deep
def test_every_command_of_a_driver_is_sent_as_in_a_run() -> None:
    """Commissioning observes the link; it adds no command of its own."""
    heard: list[str] = []
    with connect(simulated(), None, 0.1) as plain:
        plain.bench.amplifier.initialize_at_rest()
    with connect(simulated(), None, 0.1, lambda link, _: ObservedLink(link, heard.append)) as observed:
        observed.bench.amplifier.initialize_at_rest()
    assert plain.control is not None
    assert observed.control is not None
    assert heard
    assert len(plain.control.history.entries()) == len(observed.control.history.entries())  # type: ignore[attr-defined]


def test_every_deviation_contradicts_an_assumption() -> None:
    found = {trait.name for trait in DEVIATIONS}
    for model in MODELS:
        quantities = {each.quantity for each in assumptions_about(model)}
        assert {PROPERTIES[trait.name] for trait in deviations_of(model)} <= quantities, model
        found |= {trait.name for trait in deviations_of(model)}
    assert found == set(PROPERTIES)


def test_the_table_is_about_every_model_by_its_own_driver() -> None:
    for model in MODELS:
        driver = next(n for n in built_in_names(SOURCES) if load_driver(SOURCES, n).supports_model(model))  # type: ignore[attr-defined]
        assert {each.driver for each in assumptions_about(model)} == {driver}
    unused = [
        a
        for a in assumptions()
        if a.driver not in ("dc-supply", "card", "card-output", "interlock", "labjack-t7", "labjack-output")
        and not any(a.is_about(m) for m in (*MODELS, "33522B", "FG33532A", "DG952"))
    ]
    assert not unused


@pytest.mark.parametrize(
    ("model", "hidden"),
    [
        ("E36312A", {"over-current protection"}),
        ("E36103A", {"channel lists"}),
        ("E3631A", {"tracking", "output off"}),
        ("E3632A", {"over-current protection"}),
        ("E3640A", {"commands"}),
        ("E3646A", {"commands", "tracking"}),
        ("DP832", {"over-current protection", "tracking"}),
        ("SPD3303X", set()),
    ],
)
def test_what_a_supply_shows_at_the_output_has_rows_and_the_rest_is_listed_by_name(
    model: str, hidden: set[str]
) -> None:
    checks = [CheckedOutput(check, 0.0, "V", None, 0.1) for check in LEVELS]
    found = checked_assumptions(assumptions_about(model), checks)
    assert {each.assumption.driver for each in found} == {"dc-supply"}
    verdicts = {each.assumption.quantity: each.verdict for each in found}
    assert {name for name, verdict in verdicts.items() if verdict is OutputVerdict.HIDDEN} == hidden
    measured = {"volts of the level", "output while the level is stepped", "fall of the output"}
    assert {name for name, verdict in verdicts.items() if verdict is OutputVerdict.PASS} >= measured


def test_what_cannot_show_is_listed_by_name() -> None:
    checks = [CheckedOutput(check, 0.0, "V", None, 0.1) for check in OutputCheck]
    found = checked_assumptions(assumptions_about("SDG1032X"), checks)
    hidden = {each.assumption.quantity for each in found if each.verdict is OutputVerdict.HIDDEN}
    assert {"largest upload", "end of a waveform's message", "LAN clients"} <= hidden
    assert all(bool(each.assumption.checks) == (each.verdict is OutputVerdict.PASS) for each in found)


def test_an_assumption_has_the_worst_verdict_of_its_checks() -> None:
    both = Assumption("x", "x", "volts", "x", checks=(OutputCheck.REST, OutputCheck.OFFSET))
    checks = [
        CheckedOutput(OutputCheck.REST, 0.7, "V", -0.1, 0.1),
        CheckedOutput(OutputCheck.OFFSET, 1.0, "1", 0.9, 1.1),
    ]
    assert checked_assumptions([both], checks)[0].verdict is OutputVerdict.DANGEROUS
    assert checked_assumptions([both], checks[1:])[0].verdict is OutputVerdict.NOT_MEASURED


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("VOLT 0.500000;:SYST:ERR?", MessageKind.AMPLITUDE),
        ("VOLT?", MessageKind.OTHER),
        ("VOLT:OFFS 2.500000;:SYST:ERR?", MessageKind.OTHER),
        ("FUNC:ARB TB2;:SYST:ERR?", MessageKind.UPLOAD),
        ("FUNC:ARB:SRAT 40000;:SYST:ERR?", MessageKind.OTHER),
        (":SOUR1:BURS:TRIG;:SYST:ERR?", MessageKind.TRIGGER),
        (":SOUR1:BURS:TRIG:SOUR MAN;:SYST:ERR?", MessageKind.OTHER),
        ("C1:BTWV MTRIG", MessageKind.TRIGGER),
        ("ABOR;:SYST:ERR?", MessageKind.ABORT),
        ("BURS:STAT OFF;:SYST:ERR?", MessageKind.ABORT),
    ],
)
def test_a_message_is_known_by_what_it_changes(text: str, kind: MessageKind) -> None:
    assert message_kind(text) is kind


def test_the_time_of_each_command_is_from_its_message_to_its_reply() -> None:
    log, clock = MessageLog(), VirtualClock()

    class Slow:
        name = "slow"

        def write(self, message: str) -> None:
            clock.sleep(
                0.4 if message.startswith("DATA") else 0.01 if message.endswith("?") and ";" not in message else 0.02
            )

        def read(self) -> str:
            return "0"

    link = log.observe(Slow(), clock)  # type: ignore[arg-type]
    for message in (":VOLT 0.5;:SYST:ERR?", "VOLT 0.25;:SYST:ERR?", "DATA:ARB TB1,#12ab;:SYST:ERR?", "VOLT?"):
        link.write(message)
        link.read()
    assert log.command_times() == (
        CommandTime("DATA:ARB", 1, pytest.approx(0.4), pytest.approx(0.4)),
        CommandTime("VOLT", 2, pytest.approx(0.02), pytest.approx(0.02)),
        CommandTime("VOLT?", 1, pytest.approx(0.01), pytest.approx(0.01)),
    )


def test_what_follows_from_a_found_cause_is_not_measured() -> None:
    lost = CheckedOutput(OutputCheck.START, 12.0, "drives lost", 0.0, 0.0)
    level = CheckedOutput(OutputCheck.LONG_LEVEL, 0.2, "V", None, 0.05)
    offset = CheckedOutput(OutputCheck.OFFSET, 0.5, "1", 0.9, 1.1)
    rows = [
        Assumption("x", "x", name, "x", checks=(check,))
        for name, check in (("trigger", lost.check), ("held", level.check), ("scale", offset.check))
    ]
    verdicts = [each.verdict for each in checked_assumptions(rows, [lost, level, offset])]
    assert verdicts == [OutputVerdict.DIFFERS, OutputVerdict.NOT_MEASURED, OutputVerdict.DIFFERS]
    assert checked_assumptions(rows, [level, offset])[1].verdict is OutputVerdict.DANGEROUS
