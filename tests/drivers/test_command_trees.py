"""Every header of a family's command tree is set, asked, neutral for a reason, seen by the self-test, or unproven."""

import pytest

from tests.drivers.command_trees import DRIVERS, EFFECTS, plain, rule, status, tree, used
from tests.drivers.test_instrument_commands import FILES
from tests.drivers.test_self_test import Switch, hidden, refusal
from tests.helpers.simulated_bench import laboratory, simulated

SEEN = [(driver, header) for driver in DRIVERS for header in tree(driver)["card"]]
MODELS = {driver: FILES[driver]["models"][0] for driver in DRIVERS} | {"siglent-sdg": "SDG1032X"}


def test_every_family_has_a_tree() -> None:
    assert set(DRIVERS) == set(FILES)


@pytest.mark.parametrize("driver", DRIVERS)
def test_no_header_of_a_tree_is_unaccounted(driver: str) -> None:
    assert not [header for header in tree(driver)["headers"] if not status(driver, header)[0]]
    assert all(reason for part in ("neutral", "card", "unproven") for reason in tree(driver)[part].values())


@pytest.mark.parametrize("driver", DRIVERS)
def test_every_header_that_a_driver_uses_is_in_its_tree(driver: str) -> None:
    known = {header if " " in header else plain(header) for header in tree(driver)["headers"]}
    sent, asked = used(driver)
    assert not (sent | asked) - known


@pytest.mark.one_in(1)
@pytest.mark.parametrize("driver", DRIVERS)
def test_every_rule_is_of_a_header(driver: str) -> None:
    rules = {key for part in ("neutral", "card", "unproven") for key in tree(driver)[part]}
    headers = tree(driver)["headers"]
    assert not [key for key in rules if not any(h == key or h.startswith((f"{key}:", f"{key} ")) for h in headers)]


@pytest.mark.parametrize(("driver", "header"), SEEN)
def test_a_setting_that_the_driver_does_not_know_is_refused_before_high_voltage(driver: str, header: str) -> None:
    """Its effect is planted in the output stage at each trigger, and no query tells."""
    settings, words = EFFECTS[tree(driver)["card"][header]]
    with laboratory(simulated(generator={"model": MODELS[driver]})) as lab:
        with hidden(lab, **settings):
            assert words in refusal(lab, Switch(lab.control))
        assert lab.control.report().live_s == 0


def test_a_header_that_nobody_thought_of_is_unaccounted() -> None:
    assert rule("keysight-33500", "WARP:DRIV") == ("", "")
