"""Commissioning of simulated cards and DC supplies: every deviation that shows is found, and nothing else."""

import random

import pytest

from app.config.bench_file import BenchConfig
from drivers.evidence.assumption import OutputCheck
from drivers.evidence.evidence_files import CARD_OUTPUT, assumptions_about, assumptions_about_card
from protocols.commissioning.verdict import OutputVerdict, checked_assumptions
from sim_hardware.nidaq.card import CARD_DEVIATIONS
from sim_hardware.supplies.supply import supply_deviations_of
from tests.helpers.commissioning import commissioned_bench, contradicted, deviating, draw_deviations
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import simulated

CARD_INPUTS = assumptions_about_card(plays=False)
CARD_OUTPUTS = tuple(each for each in assumptions_about_card(plays=True) if each.driver == CARD_OUTPUT)


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(2))
@pytest.mark.parametrize("model", ["33511B", "SDG1032X"])
def test_deviations_of_the_card_s_inputs_are_found_beside_those_of_the_source(model: str, seed: int) -> None:
    """Drawn blind: the skew, whether an input settles and by how much not, and what the source does otherwise."""
    draw = random.Random(f"inputs {model} {seed}")
    share = draw.choice((0.0, 0.02, 0.05))
    skew = draw.choice(("as-reported", "together", "double"))
    chosen = draw_deviations(model, seed) if draw.random() < 0.5 else {}
    traits = " ".join(f"{n}={o}" for n, o in chosen.items())
    card = {"unsettled_share": share, "traits": f"skew={skew}"}
    found = commissioned_bench(simulated(generator={"model": model, "traits": traits}, seed=seed, card=card))
    expected = contradicted(model, chosen) | ({OutputCheck.CROSSTALK, OutputCheck.SETTLING} if share else set())
    expected |= {OutputCheck.SKEW} if skew != "as-reported" else set()
    assert deviating(found) == expected, (share, skew, chosen, found.checks)
    rows = {row.assumption.quantity: row.verdict for row in checked_assumptions(CARD_INPUTS, found.checks)}
    hidden = {name for name, verdict in rows.items() if verdict is OutputVerdict.HIDDEN}
    assert hidden == {"time of the first scan", "scaling"}


def of_card(traits: str, seed: int = 1, start_trigger: str = "ai/SampleClock") -> BenchConfig:
    """Return a simulated bench whose source is the output of the card."""
    config = simulated(seed=seed, source="ao0", card={"traits": f"start-route=present {traits}"})
    source = {"kind": "card-output", "start_trigger": start_trigger}
    return BenchConfig.model_validate({**config.model_dump(), "source": source})


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize("start_trigger", ["", "ai/SampleClock"])
def test_the_output_of_a_card_passes_whatever_its_queue(seed: int, start_trigger: str) -> None:
    found = commissioned_bench(of_card("", seed, start_trigger))
    assert deviating(found) == set(), found.checks
    rows = {row.assumption.quantity: row.verdict for row in checked_assumptions(CARD_OUTPUTS, found.checks)}
    assert rows.pop("start route") is (OutputVerdict.PASS if start_trigger else OutputVerdict.NOT_MEASURED)
    assert set(rows.values()) == {OutputVerdict.PASS}


CARD_CHECKS = {
    "skew": {OutputCheck.SKEW},
    "settling": {OutputCheck.CROSSTALK, OutputCheck.SETTLING},
    "start-edge": {OutputCheck.START_ROUTE},
    "queue": {OutputCheck.STOP},
    "rewrite": {OutputCheck.STOP, OutputCheck.LONG_LEVEL},  # the latter is not measured then: it could not be renewed
}
"""Checks that measure what a deviation of the simulated card contradicts."""


def contradicted_of_card(chosen: dict[str, str]) -> set[OutputCheck]:
    """Return the checks that deviate: none where the driver deals with a rewrite that waits, and reports it in the detail of Stop."""
    if ("rewrite", "waits") in chosen.items():  # a queue does not matter to what is not rewritten
        chosen = {name: option for name, option in chosen.items() if name not in ("rewrite", "queue")}
    return set().union(*(CARD_CHECKS[name] for name in chosen))


def test_every_deviation_of_the_card_has_a_check_that_is_of_an_assumption() -> None:
    assert {trait.name for trait in CARD_DEVIATIONS} == set(CARD_CHECKS)
    measured = {check for each in (*CARD_INPUTS, *CARD_OUTPUTS) for check in each.checks}
    assert set().union(*CARD_CHECKS.values()) <= measured


@pytest.mark.deep
@pytest.mark.parametrize(
    "trait", [f"{trait.name}={option}" for trait in CARD_DEVIATIONS for option in trait.options[1:]]
)
def test_one_deviation_of_a_card_is_found_and_nothing_else(trait: str) -> None:
    found = commissioned_bench(of_card(trait))
    name, _, option = trait.partition("=")
    assert deviating(found) == contradicted_of_card({name: option}), found.checks
    stop = next(check for check in found.checks if check.check is OutputCheck.STOP)
    assert ("holds rewritten samples back" in stop.detail) == (name == "rewrite")
    if option == "waits":
        assert found.times.stop_s < 1.0


@pytest.mark.deep
@pytest.mark.parametrize("seed", range(5))
def test_deviations_of_a_card_drawn_blind_are_found_and_nothing_else(seed: int) -> None:
    draw = random.Random(f"card {seed}")
    some = draw.sample(CARD_DEVIATIONS, draw.randint(1, 4))
    chosen = {trait.name: draw.choice(trait.options[1:]) for trait in some}
    found = commissioned_bench(of_card(" ".join(f"{n}={o}" for n, o in chosen.items()), seed))
    assert deviating(found) == contradicted_of_card(chosen), (chosen, found.checks)


@pytest.mark.deep
def test_a_card_without_the_start_route_differs_in_it_with_the_remedy() -> None:
    config = of_card("")
    simulation = {**(config.simulation or {}), "card": {"traits": "start-route=absent"}}
    found = commissioned_bench(config.model_copy(update={"simulation": simulation}))
    route = next(check for check in found.checks if check.check is OutputCheck.START_ROUTE)
    assert route.verdict is OutputVerdict.DIFFERS
    assert_names(route.detail, "start_trigger")


SUPPLY_PROPERTIES = {
    "level": ("volts of the level",),
    "step": ("output while the level is stepped",),
    "series": ("pairing of outputs", "series or parallel"),
    "fall": ("fall of the output",),
}
"""What each deviation of a simulated supply contradicts in the table of assumptions, by model."""

SUPPLIES = ("E36312A", "E36103A", "E3631A", "E3632A", "E3640A", "E3646A", "DP832", "SPD3303X")


def of_supply(model: str, traits: str, seed: int = 1) -> BenchConfig:
    """Return a simulated bench whose source is a DC supply."""
    config = simulated(seed=seed, source="supply", supply={"model": model, "traits": traits})
    return BenchConfig.model_validate({**config.model_dump(), "source": {"kind": "dc-supply"}})


def contradicted_of_supply(model: str, chosen: dict[str, str]) -> set[OutputCheck]:
    table = {each.quantity: each.checks for each in assumptions_about(model)}
    rows = [row for name in chosen for row in SUPPLY_PROPERTIES[name] if row in table]
    return {check for row in rows for check in table[row]}


@pytest.mark.deep
@pytest.mark.parametrize("model", SUPPLIES)
def test_deviations_of_a_supply_are_found_alone_and_nothing_else(model: str) -> None:
    assert deviating(commissioned_bench(of_supply(model, ""))) == set()
    for trait in supply_deviations_of(model):
        for option in trait.options[1:]:
            found = commissioned_bench(of_supply(model, f"{trait.name}={option}"))
            assert deviating(found) == contradicted_of_supply(model, {trait.name: option}), (option, found.checks)


@pytest.mark.deep
@pytest.mark.parametrize(("seed", "model"), list(enumerate(SUPPLIES)))
def test_deviations_of_a_supply_drawn_blind_are_found_and_nothing_else(model: str, seed: int) -> None:
    draw = random.Random(f"{model} {seed}")
    deviations = supply_deviations_of(model)
    some = draw.sample(deviations, draw.randint(1, len(deviations)))
    chosen = {trait.name: draw.choice(trait.options[1:]) for trait in some}
    found = commissioned_bench(of_supply(model, " ".join(f"{n}={o}" for n, o in chosen.items()), seed))
    assert deviating(found) == contradicted_of_supply(model, chosen), (chosen, found.checks)
