"""Simulated bench in one process: each fault has the described effect."""

import numpy as np
import pytest

from drivers.drive_shapes import Sine
from drivers.errors import InstrumentError, LinkError
from drivers.generators.keysight import Keysight33500
from drivers.transport.scpi import Link
from protocols.base import DISABLE_HIGH_VOLTAGE, ENABLE_HIGH_VOLTAGE, Operator, Prompt
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from sim_hardware.operator import SimulatedOperator
from sim_hardware.plant.faults import FAULT_DESCRIPTIONS
from sim_hardware.plant.parameters import AmplifierParameters, SimulationParameters


@pytest.fixture
def source(bench):
    source = Keysight33500(bench.link(), bench.clock)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    return source


@pytest.mark.parametrize("fault", ["scpi-silent", "scpi-late", "scpi-half", "scpi-dropped", "generator-power-off"])
def test_broken_wires_are_link_errors_and_mend(bench, source, fault):
    bench.inject(fault)
    with pytest.raises(LinkError):
        source.idle_level_v()
    bench.clear(fault)
    source.reconnect()
    assert source.identity.model == "33511B"


def test_a_garbled_answer_is_no_number(bench, source):
    bench.inject("scpi-garbled")
    with pytest.raises(InstrumentError, match=r"'VOLT:OFFS\?'.*which is not a number; check the cable at"):
        source.idle_level_v()


def test_each_answer_is_the_one_to_the_query_before(bench):
    link = bench.link()

    def asked(question: str) -> str:
        link.write(question)
        return link.read()

    first = asked("VOLT:OFFS?")
    bench.inject("scpi-previous")
    assert asked("*IDN?") == first
    assert asked("VOLT?").startswith("Keysight")


def test_another_model_answers_and_obeys_in_place_of_the_generator_and_is_recognised_by_its_name(bench, source):
    bench.inject("scpi-other-model")
    assert source.idle_level_v() == 0.0
    source.dialect.offset_command(1.0).send()
    assert source.idle_level_v() == 1.0
    with pytest.raises(LinkError, match="now answers as 'Agilent Technologies 33220A"):
        source.reconnect()
    bench.clear()
    assert source.idle_level_v() == 2.5
    assert bench.report().outside_rest_s == 0


def test_a_silent_generator_does_not_obey_and_plays_on(bench, source):
    link = bench.link()
    bench.inject("scpi-silent")
    link.write("OUTP OFF")
    bench.clear()
    assert bench.generator.settings.on
    assert bench.report().lowest_v == 2.5


def test_a_late_answer_is_taken_for_the_next_one_unless_the_link_is_cleared(bench):
    link = bench.link(timeout_s=1.0)
    bench.inject("scpi-late")
    link.write("FREQ?")
    with pytest.raises(LinkError, match=r"\b1 s\b.*cable"):
        link.read()
    bench.clear()
    bench.clock.sleep(5.0)
    link.write("*IDN?")
    assert link.read().startswith("+1.0000")  # the answer to FREQ?
    link.write("VOLT?")
    assert link.read().startswith("Keysight")  # and so on, one behind
    link.clear()
    link.write("*IDN?")
    assert link.read().startswith("Keysight")


def test_a_dropped_connection_stays_refused(bench):
    link = bench.link()
    bench.inject("scpi-dropped")
    for call in (lambda: link.write("*IDN?"), link.read, link.reopen):
        with pytest.raises(LinkError, match="connection"):
            call()
    bench.clear("scpi-dropped")
    link.reopen()
    link.close()
    with pytest.raises(LinkError, match="closed"):
        link.write("*IDN?")


def test_power_loss_and_a_pulled_cable_drop_the_amplifiers_input(bench, source):
    bench.clock.sleep(1.0)
    bench.inject("drive-cable-off")
    bench.clock.sleep(0.5)
    source.ramp_to(3.0, 0.1)  # the generator does not notice
    assert bench.report().end_v == 0.0
    bench.clear("drive-cable-off")
    bench.clock.sleep(0.1)
    assert float(bench.history.volts([bench.clock.now()])[0]) == 3.0
    report = bench.report()
    assert report.lowest_v == 0.0
    assert report.outside_rest_s == pytest.approx(0.7, abs=0.1)
    bench.inject("generator-power-off")
    assert bench.report().end_v == 0.0
    bench.clear()
    assert bench.report().end_v == 0.0  # power comes back with the output off


def test_the_input_is_pulled_to_where_the_truth_says():
    bench = SimulatedBench(
        SimulationParameters(amplifier=AmplifierParameters(open_v=2.5, enabled=True)), VirtualClock()
    )
    bench.clock.sleep(1.0)
    assert bench.report().ends_at_rest
    assert bench.report().live_s == 1.0


def test_high_voltage_off_leaves_the_tactor_still(bench, source):
    bench.disable_hv()
    source.ramp_to(5.0, 0.5)
    bench.clock.sleep(0.5)
    assert abs(bench.plant.displacement(np.array([bench.clock.now() - 0.1]))[0]) < 1e-12
    assert bench.report().outside_rest_s == 0.0


def test_simulated_operator_performs_actions_and_answers_first_choice(bench):
    operator: Operator = SimulatedOperator(bench)
    bench.clock.sleep(1.0)
    operator.show(1, ENABLE_HIGH_VOLTAGE)
    bench.clock.sleep(1.0)
    operator.show(2, DISABLE_HIGH_VOLTAGE)
    bench.clock.sleep(1.0)
    assert bench.report().live_s == 1.0
    assert [operator.answer(k) for k in (1, 1, 2)] == ["done", None, "done"]
    choices = ("go on", "stop")
    operator.show(3, Prompt("drifted", "The zero has moved.", choices=choices))
    assert operator.answer(3) == choices[0]


def test_the_direct_link_is_a_drivers_link(bench):
    link: Link = bench.link()
    assert "33511B" in link.name


def test_every_fault_has_words_and_can_be_broken_and_mended(bench):
    for name in FAULT_DESCRIPTIONS:
        bench.inject(name)
        bench.inject(name)
    assert bench.faults.active_faults() == tuple(FAULT_DESCRIPTIONS)
    bench.clear()
    assert bench.faults.active_faults() == ()
    with pytest.raises(ValueError, match="choose from drive-cable-off"):
        bench.inject("coffee")


def test_a_tripped_output_stays_open_until_it_is_switched_on(bench, source):
    bench.inject("output-tripped")
    assert bench.report().end_v == 0.0
    assert not source.is_at_rest(2.5, 0.0, 5.0)
    bench.clear()
    assert bench.report().end_v == 0.0


def test_a_drifting_clock_is_heard_from_the_next_trigger_on(bench, source):
    bench.inject("clock-drift")
    source.start_drive(Sine(100.0, 1.0, 2.5, 1000))
    bench.clock.sleep(1.0)
    burst = bench.history.entries()[-1].segment
    assert burst.constant_from_s - bench.clock.now() == pytest.approx(9.0 - 10 * 50e-6, abs=2e-3)
    assert burst.constant_from_s - bench.history.entries()[-1].start_s == pytest.approx(10 / (1 + 50e-6), rel=1e-7)


def test_an_amplifier_at_its_limit_moves_the_tactor_less(bench, source):
    source.start_drive(Sine(100.0, 2.5, 2.5, 1000))
    bench.clock.sleep(1.0)
    bench.inject("amplifier-limited")
    bench.clock.sleep(1.0)
    t = np.arange(-0.02, 0.0, 1e-4) + bench.clock.now() - 0.01
    assert np.ptp(bench.plant.displacement(t - 1.0)) > 10 * np.ptp(bench.plant.displacement(t))


def test_a_stuck_sensor_shows_where_it_was_however_it_is_read(bench, source):
    source.start_drive(Sine(100.0, 2.5, 2.5, 1000))
    bench.clock.sleep(0.503)
    bench.inject("sensor-stuck")
    bench.clock.sleep(0.5)
    t = np.arange(0.0, 0.9, 1e-3)
    volts = np.concatenate([bench.card.channel_voltage(1, part)[0] for part in np.array_split(t, 7)])
    stuck = volts[t > 0.8]
    assert np.ptp(stuck) == 0
    assert np.ptp(volts[t < 0.4]) > 0.1
