"""Front panel lock: locked while the bench is open if the bench file asks for it, and a sentence where it cannot be."""

import pytest

from app.config.bench_file import BenchConfig
from app.session.bench_connection import connect
from tests.helpers.front_panel import asked, made
from tests.helpers.simulated_bench import simulated

LOCKED = {
    "33511B": ("SYST:COMM:RLST?", "REM", "LOC"),
    "DG1032Z": (":SYST:KLOC?", "ON", "OFF"),
    "DG812": (":SYST:KLOC?", "ON", "OFF"),
    "AFG3022C": ("SYST:KLOC:STAT?", "1", "0"),
}
"""By model: the query of the lock, its reply when locked and when not."""


def asking(model: str, *, lock: bool) -> BenchConfig:
    config = simulated(generator={"model": model})
    return BenchConfig.model_validate({**config.model_dump(), "generator": {"panel_lock": lock}})


@pytest.mark.parametrize("model", LOCKED)
def test_a_front_panel_is_locked_and_unlocked(model: str) -> None:
    query, locked, unlocked = LOCKED[model]
    source, _, panel = made(model)
    assert asked(panel, query) == unlocked
    assert source.lock_panel() == ""
    assert asked(panel, query) == locked
    source.unlock_panel()
    assert asked(panel, query) == unlocked


def test_a_generator_that_refuses_says_so_and_works_on() -> None:
    source, _, _ = made("AFG1022")
    assert "its front panel is not locked: function generator AFG1022" in source.lock_panel()
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)


@pytest.mark.deep
@pytest.mark.parametrize(
    ("model", "lock", "warning"),
    [
        ("33511B", True, ""),
        ("SDG1032X", True, "generator.panel_lock: this driver knows no command for it. Lock the front panel by hand"),
        ("SDG1032X", False, ""),
    ],
)
def test_the_bench_locks_the_panel_if_its_file_asks_for_it(model: str, lock: bool, warning: str) -> None:
    with connect(asking(model, lock=lock), None, 0.1) as connection:
        assert connection.bench.panel_warning.startswith(warning)
        assert bool(connection.bench.panel_warning) == bool(warning)
