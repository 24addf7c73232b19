"""The paper's seven measurements, shortened, end to end: the true parameters of the simulated tactor are identified."""

from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path

import pytest

from app.campaign.campaign import Campaign
from app.campaign.plan import PAPER_ITEMS
from app.campaign.queue import CampaignRunner
from app.campaign.status import ItemStatus
from app.campaign.summary import identify_campaign_runs
from app.config.bench_file import load_bench
from app.session.bench_connection import UNATTENDED_BLOCK_S, connect
from app.session.session import Session
from sim_hardware.testing.safe_volts import assert_safe_voltage

SHORT = {
    "wiring": {"record_s": 0.5, "wait_s": 0.2},
    "loading": {"weights_kg": (0.05, 0.2), "repeats": 1, "settle_s": 0.5},
    "resonance": {"masses_kg": (2.75e-3, 7.75e-3), "sweep_s": 20.0},
    "steps": {"levels_v": (1.0, 2.0, 3.5, 4.5), "repeats": 1, "rest_s": 0.3, "read_s": 0.3, "hold_s": 0.5},
    "dwell": {"frequencies_hz": (120, 140, 150, 155, 160, 170, 190), "record_s": 0.2},
    "sag": {},
    "membrane": {"elongations_m": (0.0, 6.35e-3), "reference": 0, "frequencies_hz": (100, 120, 140, 160, 200, 250)},
}

pytestmark = pytest.mark.deep


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> tuple[Campaign, list[str]]:
    """The campaign at its end, and every prompt in order."""
    items = tuple(replace(item, settings=SHORT[item.name]) for item in PAPER_ITEMS)
    options: list[str] = []
    with connect(load_bench("ideal"), None, UNATTENDED_BLOCK_S) as lab:
        campaign = Campaign.create(tmp_path_factory.mktemp("runs"), "T1", True, items)
        conductor = CampaignRunner(campaign)

        def listen(event: object) -> None:
            if prompt := getattr(event, "prompt", None):
                options.append(prompt.action)

        session = Session(lambda: nullcontext(lab), [conductor, listen], lab.operator)
        session.start()
        try:
            for _ in items:
                line = campaign.next_item()
                assert line is not None
                conductor.start(session, line)
                assert session.finished.wait(100)
        finally:
            assert session.close(60)
        assert_safe_voltage(lab.control.report())
    return campaign, options


def test_all_seven_are_done_in_the_papers_order(measured) -> None:
    campaign, asked = measured
    assert [line.status for line in campaign.item_states()] == [ItemStatus.DONE] * 7
    begun = [line.started_at for line in campaign.item_states()]
    by_name = {line.item.name: line.started_at for line in campaign.item_states()}
    assert by_name["loading"] < by_name["steps"] < by_name["dwell"] < by_name["membrane"]
    assert len(set(begun)) == 7
    # The mass resonance leaves another mass on, the loading another side up: both are put right before the dwell.
    assert {"turn-side", "fix-mass", "remove-membrane", "stretch-membrane", "place-weight"} <= set(asked)


def test_what_is_identified_is_what_is_there(measured) -> None:
    campaign, _ = measured
    found = identify_campaign_runs(campaign)
    assert not isinstance(found, str), found
    truth = load_bench("ideal").simulation_parameters
    tactor, membrane = truth.tactor, truth.membrane
    by_name = {estimate.name: estimate for estimate in found.estimates}
    for name, value in (("k2", tactor.k2), ("mu", tactor.mu), ("m_add", tactor.m_add), ("c0", tactor.c0)):
        assert by_name[name].value == pytest.approx(value, rel=0.02), name
    assert by_name["E_m"].value == pytest.approx(membrane.E_m, rel=0.03)
    # The slip of the membrane is zero here, at the edge of its prior, and shifts the damping of its elongation.
    damping = by_name["c_s_delta"]
    assert abs(damping.value - membrane.c_s_delta) < 3 * damping.standard_error < 0.09 * membrane.c_s_delta


def test_the_runs_are_read_from_the_disk_alone(measured, tmp_path: Path) -> None:
    campaign, _ = measured
    again = Campaign.open(campaign.path.parent, "T1")
    assert [line.run for line in again.item_states()] == [line.run for line in campaign.item_states()]
