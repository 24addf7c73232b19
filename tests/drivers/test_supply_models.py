"""Settings of DC supplies that the previous user left, and the models that each row of the dialects is for."""

import re

import pytest

from drivers.errors import InstrumentError
from drivers.supplies.dc_supply import DcSupply
from drivers.supplies.dialects import SUPPLY_DIALECTS
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.helpers.simulated_bench import assert_safe_voltage, simulated

ARMED = 2.5, 0.0, 5.0

ROWS = {
    "E36312A": "Keysight E36200/E36300",
    "E36233A": "Keysight E36200/E36300",
    "E36103A": "Keysight E36100/E36200 with one output",
    "E36231A": "Keysight E36100/E36200 with one output",
    "E3631A": "Keysight E3631A",
    "E3632A": "Keysight E3632A/E3633A/E3634A",
    "E3634A": "Keysight E3632A/E3633A/E3634A",
    "E3641A": "Keysight E3640A-E3645A",
    "E3649A": "Keysight E3646A-E3649A",
    "DP832": "Rigol DP800",
    "SPD3303X": "Siglent SPD",
}
SIMULATED = ("E36312A", "E36103A", "E3631A", "E3632A", "E3640A", "E3646A", "DP832", "SPD3303X")
WITH_OCP = ("E36312A", "E36103A", "E3632A", "DP832")
WITH_TRACKING = ("E36312A", "E3631A", "E3646A", "DP832", "SPD3303X")


def opened(model: str, **supply: object) -> tuple[DcSupply, SimulatedBench]:
    config = simulated(source="supply", supply={"model": model, **supply})
    bench = SimulatedBench(config.simulation_parameters, VirtualClock())
    return DcSupply(bench.link(), bench.clock), bench


def step_up_and_back(source: DcSupply, bench: SimulatedBench) -> None:
    bench.enable_hv()
    source.ramp_to(3.3, 0.1)
    bench.clock.sleep(0.1)
    source.ramp_to(2.5, 0.1)
    bench.clock.sleep(0.5)
    report = bench.report()
    assert_safe_voltage(report)
    assert report.lowest_v > 2.48, "the output was taken away"
    assert report.highest_v == pytest.approx(3.3, abs=0.02)


@pytest.mark.parametrize("model", ROWS)
def test_each_model_has_one_row(model: str) -> None:
    assert [d.name for d in SUPPLY_DIALECTS if re.match(d.model_pattern, model)] == [ROWS[model]]


@pytest.mark.parametrize("model", SIMULATED)
def test_every_model_is_armed_and_steps(model: str) -> None:
    source, bench = opened(model)
    source.initialize_at_rest(*ARMED)
    assert source.is_at_rest(*ARMED)
    step_up_and_back(source, bench)


@pytest.mark.parametrize("model", WITH_OCP)
def test_over_current_protection_is_switched_off_before_the_output_comes_on(model: str) -> None:
    """At the inrush of a step it would switch the output off: 0 V at the amplifier, -500 V on the specimen."""
    source, bench = opened(model, ocp=True)
    source.initialize_at_rest(*ARMED)
    assert not bench.supply.ocp_enabled
    step_up_and_back(source, bench)


@pytest.mark.parametrize("model", WITH_OCP)
def test_over_current_protection_switched_on_between_two_runs_is_noticed(model: str) -> None:
    source, bench = opened(model)
    source.initialize_at_rest(*ARMED)
    bench.supply.ocp_enabled = True
    assert not source.is_at_rest(*ARMED)
    source.initialize_at_rest(*ARMED)
    step_up_and_back(source, bench)


@pytest.mark.parametrize("model", WITH_TRACKING)
def test_outputs_in_series_are_separated_before_the_output_comes_on(model: str) -> None:
    source, bench = opened(model, tracking=True)
    source.initialize_at_rest(*ARMED)
    assert not bench.supply.tracking
    step_up_and_back(source, bench)
    bench.disable_hv()
    bench.supply.tracking = True
    assert not source.is_at_rest(*ARMED)


@pytest.mark.parametrize(("model", "setting"), [("E36312A", "ocp"), ("SPD3303X", "tracking")])
def test_a_supply_that_keeps_such_a_setting_is_refused(
    model: str, setting: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, bench = opened(model, **{setting: True})
    handle = bench.message_port.handle
    monkeypatch.setattr(
        bench.message_port,
        "handle",
        lambda message: handle(
            "*CLS;:SYST:ERR?" if "PROT:STAT OFF" in message else "*CLS" if "TRACK 0" in message else message
        ),
    )
    with pytest.raises(
        InstrumentError, match=r"its (over-current protection is 1|outputs are in series).* switch it off at the front"
    ):
        source.initialize_at_rest(*ARMED)
    assert not bench.supply.output_on
