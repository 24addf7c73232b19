"""VISA libraries: GPIB through a vendor's, the errors where it is missing, and connections that do not close each other."""

import pytest
import pyvisa

from drivers.errors import LinkError
from drivers.generators.keysight import Keysight33200, Keysight33500
from drivers.transport.visa import VisaLink
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.drivers.test_keysight_33500 import Tapped
from tests.helpers.simulated_bench import simulated


class StandIn:
    """A vendor's VISA library with one instrument, as PyVISA shows it: a stand-in, nothing of its real wires."""

    def __init__(self, bench: SimulatedBench) -> None:
        self._link = bench.link()
        self.opened: list[str] = []

    def open_resource(self, name: str, **_: object) -> "StandIn":
        self.opened.append(name)
        return self

    def write(self, message: str, **_: object) -> None:
        self._link.write(message)

    def read(self) -> str:
        return self._link.read()

    def clear(self) -> None:
        self._link.clear()

    def close(self) -> None: ...


def test_a_33250a_on_gpib_is_armed_through_a_vendors_library(monkeypatch: pytest.MonkeyPatch) -> None:
    bench = SimulatedBench(simulated(generator={"model": "33250A"}).simulation_parameters, VirtualClock())
    library, backends = StandIn(bench), []
    monkeypatch.setattr(pyvisa, "ResourceManager", lambda backend: (backends.append(backend), library)[1])
    source = Keysight33200(VisaLink("GPIB0::10::INSTR", backend="@ivi"), bench.clock)
    source.initialize_at_rest(2.5, 0.0, 5.0)
    assert source.is_at_rest(2.5, 0.0, 5.0)
    assert (backends, library.opened) == (["@ivi"], ["GPIB0::10::INSTR"])
    source.close()


def test_gpib_with_the_built_in_library_says_what_it_needs() -> None:
    with pytest.raises(
        LinkError, match=r'GPIB needs a vendor\'s VISA library .* set backend = "@ivi" in the bench file'
    ):
        VisaLink("GPIB0::10::INSTR")


@pytest.mark.parametrize(("platform", "named"), [("win32", True), ("linux", False)])
def test_a_usb_instrument_that_windows_does_not_release_names_the_backend(
    platform: str, named: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Held:
        def open_resource(self, *_: object, **__: object) -> None:
            raise ValueError("No device found")

        def close(self) -> None: ...

    monkeypatch.setattr("drivers.transport.visa.sys.platform", platform)
    monkeypatch.setattr(pyvisa, "ResourceManager", lambda _: Held())
    with pytest.raises(LinkError, match=r"cannot be reached \(No device found\); check the cable") as raised:
        VisaLink("USB0::0x2A8D::0x8D01::MY1::INSTR")
    assert ("@ivi" in str(raised.value)) is named


def test_a_missing_vendors_library_is_a_sentence_with_the_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
    def missing(backend: str) -> None:
        raise OSError("Could not open VISA library")

    monkeypatch.setattr(pyvisa, "ResourceManager", missing)
    with pytest.raises(
        LinkError, match=r"NI-VISA.* is not installed on this computer .*; install it, or connect the .* by LAN"
    ):
        VisaLink("GPIB0::10::INSTR", backend="@ivi")


def test_a_long_waveform_is_refused_over_usb() -> None:
    bench = SimulatedBench(simulated().simulation_parameters, VirtualClock())
    link = Tapped(bench.link())
    link.name = "USB0::0x2A8D::0x1301::MY1::INSTR"
    assert Keysight33500(link, bench.clock).playable.max_points == 200_000
