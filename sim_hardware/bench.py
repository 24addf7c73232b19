"""The simulated bench: one clock, one history, one plant, and the instruments that share them."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from drivers.clock import Clock, WallClock
from sim_hardware.generators.generator import Generator, Make
from sim_hardware.generators.registry import box
from sim_hardware.nidaq.analog_output import AnalogOutput
from sim_hardware.nidaq.card import Card
from sim_hardware.nidaq.in_process_digitizer import SimDigitizer
from sim_hardware.plant.faults import Faults
from sim_hardware.plant.history_report import HistoryReport, report_on
from sim_hardware.plant.laser_view import Sight
from sim_hardware.plant.parameters import BenchTruth
from sim_hardware.plant.plant import Plant
from sim_hardware.plant.segments import Open, Segment
from sim_hardware.plant.setup_state import SPECIMEN, altered, check
from sim_hardware.plant.voltage_history import History
from sim_hardware.supplies.dialects import engine_of
from sim_hardware.supplies.supply import Supply
from sim_hardware.wires.in_process_link import DirectLink
from sim_hardware.wires.port import Port
from sim_hardware.wires.scpi_engine import Engine


class _Cable:
    """From the generator to the amplifier's input. Off, the input is pulled; the generator does not notice."""

    def __init__(self, history: History, clock: Clock, pulled_v: float) -> None:
        self._history = history
        self._clock = clock
        self._open = Open(pulled_v)
        self._from_generator: Segment = self._open
        self._plugged = True

    def carry(self, make: Make) -> None:
        """Put the generator's next segment on the line."""
        with self._history.instant(self._clock) as t:
            self._from_generator = make(t)
            self._history.append(t, self._from_generator if self._plugged else self._open)

    def plug(self, plugged: bool) -> None:
        """Pull the plug or put it back."""
        with self._history.instant(self._clock) as t:
            self._plugged = plugged
            self._history.append(t, self._from_generator if plugged else self._open)


class VirtualBench:
    """A bench that is not there.

    Args:
        truth: what it is made of.
        clock: whose time it lives in; default is the wall clock at the truth's speed.
    """

    def __init__(self, truth: BenchTruth | None = None, clock: Clock | None = None) -> None:
        self.truth = truth = truth or BenchTruth()
        self.clock: Clock = clock or WallClock(truth.speed)
        self.faults = Faults()
        self.history = History(truth.amplifier.open_v)
        self.plant = Plant(truth, self.history, self.faults)
        self._cable = _Cable(self.history, self.clock, truth.amplifier.open_v)
        outputs = [AnalogOutput(self._wired(name)) for name in ("ao0", "ao1")]
        self.sight = Sight(truth, self.plant)
        self.card = Card(truth, self.history, self.plant, self.sight, self.faults, outputs)
        g = truth.generator
        self.generator = Generator(self._wired("generator"), truth.seed, g.clock_ppm, g.relay_s, truth.amplifier.open_v)
        self.generator.reset()
        self._box = box(g, self.generator, self.clock.now)
        engine = Engine(self._box)
        self._box.report = engine.report
        self.port = Port(engine, self.faults)
        self.supply = Supply(self._wired("supply"), self.clock.now, truth.supply)
        if truth.source == "supply":  # the wire of the bench is that of the source at the cable
            self.port = Port(engine_of(truth.supply.model, self.supply, truth.supply.serial), self.faults)
        self._listeners: list[Callable[[], None]] = []
        if truth.amplifier.enabled:
            self.enable_hv()

    def _wired(self, source: str) -> Callable[[Make], None]:
        """Where an output's segments go: down the cable to the amplifier, or nowhere."""
        return self._cable.carry if self.truth.source == source else self._nowhere

    def _nowhere(self, make: Make) -> None:
        make(self.clock.now())

    def link(self, timeout_s: float = 2.0) -> DirectLink:
        """A link to the generator, or to the supply in its place, in this process."""
        g = self.truth.generator
        model = self.truth.supply.model if self.truth.source == "supply" else g.model
        return DirectLink(self.port, self.clock, f"generator {model} (simulated)", g.command_s, timeout_s)

    def digitizer(self, buffer_s: float = 10.0) -> SimDigitizer:
        """The card in this process."""
        return SimDigitizer(self.card, self.clock, self.faults, buffer_s)

    def laser_sees(self) -> float | None:
        """Displacement as a laser sensor's own display shows it now; None where it is out of range."""
        sensor, now = self.truth.sensor, self.clock.now()
        seen = float(self.sight.seen(np.array([min(self.plant.ready_until(now), now)]))[0])
        return None if abs(seen) > sensor.range_m or self.faults.active("sensor-out-of-range") else seen

    def enable_hv(self) -> None:
        """The operator turns high voltage on."""
        with self.history.instant(self.clock) as t:
            self.history.switch(t, hv=True)

    def disable_hv(self) -> None:
        """The operator turns high voltage off."""
        with self.history.instant(self.clock) as t:
            self.history.switch(t, hv=False)

    def now(self) -> float:
        """Bench time."""
        return self.clock.now()

    def hands(self, action: str, values: Mapping[str, float]) -> float:
        """Do by hand what `sim_hardware.plant.setup_state.HANDS` names; bench time when it is done. Weights take a moment.

        Raises:
            ValueError: no such action, a number is missing or makes no sense, or the specimen is live.
        """
        check(action, values)
        done_s = now_s = self.clock.now()
        if action in SPECIMEN:
            how = partial(altered, action=action, values=values, truth=self.truth)
            if how(self.plant.situation) == self.plant.situation:
                return done_s
            if self.history.live:
                raise ValueError(
                    f"{action}: high voltage is on, nobody reaches for a live specimen; switch it off first"
                )
            weights, hands = action.endswith("-weight"), self.truth.hands
            done_s = self.plant.change(
                self.clock,
                how,
                after_s=hands.reach_s if weights else 0.0,
                over_s=hands.release_s if weights else 0.0,
                landing_m_per_s=hands.landing_m_per_s,
            )
        self.sight.act(now_s, action, values)
        return done_s

    def on_fault(self, listener: Callable[[], None]) -> None:
        """Call `listener` after every break or repair."""
        self._listeners.append(listener)

    def inject(self, fault: str) -> None:
        """Break something (`sim_hardware.plant.faults.FAULTS`). Raises ValueError for an unknown name."""
        if self.faults.active(fault):
            return
        self.faults.inject(fault, self.clock.now())
        if fault == "generator-power-off":
            self.generator.power(on=False)
            self.supply.power(on=False)
        elif fault == "drive-cable-off":
            self._cable.plug(plugged=False)
        elif fault == "output-tripped":
            self.generator.change(on=False)
        elif fault == "clock-drift":
            self.generator.drift(50.0)
        for listener in self._listeners:
            listener()

    def clear(self, fault: str | None = None) -> None:
        """Repair one fault, or all. A generator that gets its power back is in its factory state."""
        for name in self.faults.all_active() if fault is None else (fault,):
            if not self.faults.active(name):
                continue
            self.faults.clear(name, self.clock.now())
            if name == "generator-power-off":
                self.generator.power(on=True)
                self._box.reset()
                self.supply.power(on=True)
            elif name == "drive-cable-off":
                self._cable.plug(plugged=True)
            elif name == "clock-drift":
                self.generator.drift(-50.0)
        for listener in self._listeners:
            listener()

    def broken(self) -> tuple[str, ...]:
        """Names of the faults that are present."""
        return self.faults.all_active()

    def report(self, tolerance_v: float = 0.02) -> HistoryReport:
        """What the amplifier's input really saw until now."""
        rest_v = self.truth.amplifier.map.rest_v
        return report_on(self.history.pieces(), self.clock.now(), self.truth.plant_rate_hz, rest_v, tolerance_v)
