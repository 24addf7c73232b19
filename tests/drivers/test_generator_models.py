"""Differences between the models of a family: supported or not, converter, smallest amplitude, size of a packet."""

from dataclasses import replace

import numpy as np
import pytest

from app.config.discovery import _role_of
from app.config.driver_registry import SOURCES, built_in_names, load_driver, open_generator
from drivers.drive_shapes import LinearSweep, Sine
from drivers.errors import InstrumentError
from drivers.generators.burst import BurstGenerator
from drivers.generators.rigol import Dg1000zDialect
from drivers.generators.unsuitable import reason_unsuitable
from drivers.interfaces import Identity
from sim_hardware.clock import VirtualClock
from sim_hardware.generators.scpi_levels import OutputLevels
from tests.drivers.test_generator_foreign_settings import opened
from tests.helpers.simulated_bench import assert_safe_voltage

ARMED = 2.5, 0.0, 5.0

SUPPORTED = {
    "33511B": "keysight-33500",
    "33522A": "keysight-33500",
    "33622A": "keysight-33500",
    "EDU33211A": "keysight-33500",
    "EDU33212A": "keysight-33500",
    "FG33531A": "keysight-33500",
    "FG33532A": "keysight-33500",
    "G5100A": "keysight-33200",
    "33210A": "keysight-33200",
    "33220A": "keysight-33200",
    "33250A": "keysight-33200",
    "DG1022Z": "rigol-dg",
    "DG1062Z": "rigol-dg",
    "DG811": "rigol-dg800",
    "DG832": "rigol-dg800",
    "DG952": "rigol-dg800",
    "DG992": "rigol-dg800",
    "DG2052": "rigol-dg800",
    "DG2102": "rigol-dg800",
    "DG4062": "rigol-dg800",
    "DG4202": "rigol-dg800",
    "SDG1032X": "siglent-sdg",
    "SDG2122X": "siglent-sdg",
    "SDG6052X": "siglent-sdg",
    "T3AFG80": "siglent-sdg",
    "AFG3022C": "tektronix-afg",
    "AFG31021": "tektronix-afg",
    "AFG31052": "tektronix-afg",
    "AFG31102": "tektronix-afg",
    "AFG1022": "tektronix-afg",
}

RELATIVES = (
    "33509B",
    "33510B",
    "33519B",
    "33520B",
    "DG1022",
    "DG1022U",
    "DG1022A",
    "DG812 Pro",
    "DG832 Pro",
    "DG922 Pro",
    "DG5072",
)
"""Without arbitrary waveforms, or with another command set: named like supported models, but none of them."""


UNSUITABLE = {
    "HEWLETT-PACKARD,33120A,0,8.0-5.0-1.0": r"Agilent/HP 33120A\): its output cannot be switched off",
    "Agilent Technologies,33120A,0,10.0-5.0-1.0": r"33120A\): its output cannot be switched off",
    "*IDN SDG,SDG805,SDG00003140697,5.01.01.12": r"SDG830\) and Teledyne T3AFG5, T3AFG10\): it has a USB port only",
    "Teledyne,T3AFG10,1,1": r"T3AFG10\): it has a USB port only",
    "TEKTRONIX,AFG31252,C013019,SCPI:99.0 FV:1.6.1": r"its open output ends at 5 V",
    "TEKTRONIX,AFG3252C,C010001,SCPI:99.0 FV:1.0.0": r"its open output ends at 5 V",
    "GW INSTEK,AFG-2225,SN:1,V1.0": r"states the level of its output",
    "owon,XDG2035,1,V1": r"states the level of its output",
}
"""Identities of generators that are advised against, and what is said of them."""


class NamedLink:
    """A link to an instrument that answers with its identity; it records what was sent."""

    name = "TCPIP::192.0.2.7::5025::SOCKET"

    def __init__(self, identity: str) -> None:
        self._identity = identity
        self.sent: list[str] = []

    def write(self, message: str) -> None:
        self.sent.append(message)

    def read(self) -> str:
        return self._identity

    def clear(self) -> None: ...

    def reopen(self) -> None: ...

    def close(self) -> None: ...


@pytest.mark.one_in(1)
@pytest.mark.parametrize("identity", UNSUITABLE)
def test_a_generator_whose_idle_level_nothing_guarantees_is_advised_against_before_anything_is_set(
    identity: str,
) -> None:
    for driver in ("auto", "keysight-33200"):
        link = NamedLink(identity)
        with pytest.raises(
            InstrumentError, match=rf"(?i)it is advised against \(.*{UNSUITABLE[identity]}.*Nothing was set"
        ):
            open_generator(driver, link, VirtualClock(), 0.05)
        assert link.sent == ["*IDN?"]
    assert drivers_for(identity.split(",")[1]) == []


def test_relatives_of_an_unsuitable_model_are_not_advised_against() -> None:
    assert not reason_unsuitable(Identity("Agilent Technologies", "33220A"))
    assert not reason_unsuitable(Identity("Siglent Technologies", "SDG810X"))
    assert not reason_unsuitable(Identity("TEKTRONIX", "AFG31052"))
    assert not reason_unsuitable(Identity("TEKTRONIX", "AFG3152C"))


def drivers_for(model: str) -> list[str]:
    return [name for name in built_in_names(SOURCES) if load_driver(SOURCES, name).supports_model(model)]  # type: ignore[attr-defined]


@pytest.mark.parametrize("model", SUPPORTED)
def test_each_supported_model_has_one_driver(model: str) -> None:
    assert drivers_for(model) == [SUPPORTED[model]]


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", RELATIVES)
def test_devices_names_no_driver_for_a_relative(model: str) -> None:
    assert _role_of(Identity("", model)) == ("instrument", "")


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", RELATIVES)
def test_a_relative_with_another_command_set_has_none(model: str) -> None:
    assert drivers_for(model) == []


def test_a_derived_driver_is_for_its_own_models() -> None:
    class RelabelledDialect(Dg1000zDialect):
        capabilities = replace(Dg1000zDialect.capabilities, models="FG20")

    class Relabelled(BurstGenerator):
        dialect_type = RelabelledDialect

    assert Relabelled.supports_model("FG20A")
    assert not Relabelled.supports_model("DG1032Z")


@pytest.mark.one_in(1)
@pytest.mark.parametrize("model", ["33210A", "33220A", "33250A"])
def test_a_332xx_is_armed_at_twenty_millivolts_and_plays(model: str) -> None:
    """Into a high-impedance load 10 mVpp is out of its range, and it says so: it never armed."""
    source, bench, _ = opened(model)
    source.initialize_at_rest(*ARMED)
    assert source.is_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    source.start_drive(Sine(50.0, 2.5, 2.5, 10))
    bench.clock.sleep(0.3)
    report = bench.report()
    assert_safe_voltage(report)
    assert (report.lowest_v, report.highest_v) == (pytest.approx(0.0, abs=2e-3), pytest.approx(5.0, abs=2e-3))


def test_a_drive_below_the_smallest_amplitude_is_refused_before_anything_is_sent() -> None:
    source, bench, _ = opened("33220A")
    source.initialize_at_rest(*ARMED)
    with pytest.raises(InstrumentError, match=r"less than 20 mV peak to peak, not 10 mV; .*Nothing was sent"):
        source.start_drive(Sine(50.0, 0.005, 2.5, 10))
    assert bench.report().outside_rest_s == 0


def test_a_rigol_sweeps_and_then_starts_the_next_drive() -> None:
    """A packet carries 8192 points, and after a burst the trigger source must be set anew."""
    source, bench, _ = opened("DG1032Z")
    source.initialize_at_rest(*ARMED)
    bench.clock.sleep(0.1)
    bench.enable_hv()
    for drive in (LinearSweep(10.0, 60.0, 1.0, 1.0, 2.5), Sine(50.0, 1.0, 2.5, 20), Sine(50.0, 1.0, 2.5, 20)):
        before_s = bench.report().outside_rest_s
        source.start_drive(drive)
        bench.clock.sleep(drive.duration_s + 0.1)
        assert bench.report().outside_rest_s - before_s == pytest.approx(drive.duration_s, rel=0.05), drive
    assert_safe_voltage(bench.report())


@pytest.mark.one_in(1)
@pytest.mark.parametrize("points", [8193, 16_385, 24_577])
def test_no_packet_of_a_rigol_is_too_small(points: int) -> None:
    """Cut at 8192, the last packet of each would have one point, and a real DG1000Z rejects less than eight."""
    source, _, _ = opened("DG1032Z")
    source.initialize_at_rest(*ARMED)
    source.dialect.download_waveform(np.zeros(points))


@pytest.mark.parametrize("model", ["33220A", "DG1032Z"])
def test_a_held_range_without_the_idle_amplitude_is_refused_before_the_output_comes_up(
    model: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(OutputLevels, "min_held_vpp", 0.1)
    source, bench, _ = opened(model)
    with pytest.raises(
        InstrumentError,
        match=r"VOLT 0\.0\d'.*does not take \d+ mV peak to peak.* while its range is held for 5 V; .*analogue output$",
    ):
        source.initialize_at_rest(*ARMED)
    assert not source.is_output_on()
    assert bench.report().live_s == 0
