"""Simulated bench: one clock, voltage history and plant, and the instruments that share them."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from drivers import Clock, WallClock
from sim_hardware import plant
from sim_hardware.generators import (
    OutsideEngine,
    SegmentFactory,
    SimulatedGenerator,
    load_outside_generator,
    make_generator,
)
from sim_hardware.nidaq import SimulatedAnalogOutput, SimulatedCard, SimulatedDigitizer, SimulatedInterlock
from sim_hardware.supplies import SimulatedSupply, make_supply_engine
from sim_hardware.wires import InProcessLink, MessageEngine, MessagePort, ScpiEngine, ScpiInstrument


class _Cable:
    """The cable from the generator to the amplifier's input; unplugged, the input is pulled to `open_circuit_v`."""

    def __init__(self, history: plant.VoltageHistory, clock: Clock, open_circuit_v: float) -> None:
        self._history, self._clock = history, clock
        self._open = plant.ConstantSegment(open_circuit_v)
        self._from_generator: plant.Segment = self._open
        self._connected = True

    def emit(self, make: SegmentFactory) -> None:
        """Output the generator's next segment."""
        with self._history.at_instant(self._clock) as t:
            self._from_generator = make(t)
            self._append(t)

    def set_connected(self, connected: bool) -> None:
        """Unplug the cable or plug it in."""
        with self._history.at_instant(self._clock) as t:
            self._connected = connected
            self._append(t)

    def _append(self, t: float) -> None:
        self._history.append(t, self._from_generator if self._connected else self._open)


class SimulatedBench:
    """A simulated bench (sim_hardware.operator.BenchControls).

    Args:
        parameters: parameters of the plant and the instruments; default: `SimulationParameters()`.
        clock: bench time; default: the wall clock at the speed of `parameters`.
    """

    def __init__(self, parameters: plant.SimulationParameters | None = None, clock: Clock | None = None) -> None:
        self.parameters = parameters = parameters or plant.SimulationParameters()
        self.clock: Clock = clock or WallClock(parameters.speed)
        self.faults = plant.FaultState()
        self.history = plant.VoltageHistory(parameters.amplifier.open_v)
        self.plant = plant.Plant(parameters, self.history, self.faults)
        self._cable = _Cable(self.history, self.clock, parameters.amplifier.open_v)
        outputs = [SimulatedAnalogOutput(self._segment_sink(name)) for name in ("ao0", "ao1")]
        self.dacs = {name: SimulatedAnalogOutput(self._segment_sink(name)) for name in ("DAC0", "DAC1")}
        self.laser_view = plant.LaserView(parameters, self.plant)
        self.interlock = SimulatedInterlock(parameters.interlock, self.history, self.clock, self.faults)
        self.card = SimulatedCard(
            parameters, self.history, self.plant, self.laser_view, self.faults, outputs, self.interlock
        )
        g = parameters.generator
        sink = self._segment_sink("generator")
        self.generator = SimulatedGenerator(
            self._discard_segment if g.outside else sink,
            parameters.seed,
            g.clock_ppm,
            g.relay_s,
            parameters.amplifier.open_v,
        )
        self.generator.reset()
        self.connect_generator(make_generator(g, self.generator, self.clock.now, parameters.seed))
        self._outside: OutsideEngine | None = None
        if g.outside:
            self._outside = OutsideEngine(load_outside_generator(g.outside), sink, self.clock.now)
            self._connect(self._outside)
        self.supply = SimulatedSupply(self._segment_sink("supply"), self.clock.now, parameters.supply)
        if parameters.source == "supply":  # the link leads to the instrument at the cable
            self._connect(make_supply_engine(parameters.supply.model, self.supply, parameters.supply.serial))
        self._listeners: list[Callable[[], None]] = []
        if parameters.amplifier.enabled:
            self.enable_hv()

    def connect_generator(self, model: ScpiInstrument) -> None:
        """Connect an instrument to the link in place of the generator; it sets the output stage `self.generator`."""
        self._generator_model = model
        self._connect(_engine_of(model))

    def _connect(self, engine: MessageEngine) -> None:
        self.message_port = MessagePort(engine, self.faults, self._make_other_instrument)
        self.message_port.set_processing(partial(self.clock.sleep, self.parameters.generator.command_s))

    def _make_other_instrument(self) -> ScpiEngine:
        """Return an instrument of another model with an unconnected output."""
        own = self.parameters.generator
        model = "33511B" if own.model.startswith("3322") else "33220A"
        output = SimulatedGenerator(self._discard_segment, 0, 0.0, own.relay_s, self.parameters.amplifier.open_v)
        output.reset()
        return _engine_of(
            make_generator(plant.GeneratorParameters(model=model, serial="MY00000009"), output, self.clock.now)
        )

    def _segment_sink(self, source: str) -> Callable[[SegmentFactory], None]:
        """Return the sink of an output's segments: the cable to the amplifier, or no sink."""
        return self._cable.emit if self.parameters.source == source else self._discard_segment

    def _discard_segment(self, make: SegmentFactory) -> None:
        make(self.clock.now())

    def link(self, timeout_s: float = 2.0) -> InProcessLink:
        """Return a link in this process to the generator or supply."""
        g = self.parameters.generator
        model = self.parameters.supply.model if self.parameters.source == "supply" else g.model
        return InProcessLink(self.message_port, self.clock, f"generator {model} (simulated)", g.command_s, timeout_s)

    def digitizer(self, buffer_s: float = 10.0, terminals: Sequence[str] = ("ai0", "ai1")) -> SimulatedDigitizer:
        """Return the card in this process, with inputs by the names of their terminals."""
        inputs = [int(terminal.lower().removeprefix("ain").removeprefix("ai")) for terminal in terminals]
        return SimulatedDigitizer(self.card, self.clock, self.faults, buffer_s, inputs)

    def laser_reading_m(self) -> float | None:
        """Return the present displacement of the laser sensor; None out of its range."""
        sensor, now = self.parameters.sensor, self.clock.now()
        seen = float(self.laser_view.displacement(np.array([min(self.plant.available_until(now), now)]))[0])
        return None if abs(seen) > sensor.range_m or self.faults.is_active("sensor-out-of-range") else seen

    def room_reading(self) -> tuple[float, float]:
        """Return the present temperature of the air, degrees Celsius, and its relative humidity from 0 to 1."""
        room = self.plant.room
        return float(room.temperature_at(np.array(self.clock.now()))), room.parameters.humidity

    def enable_hv(self) -> None:
        with self.history.at_instant(self.clock) as t:
            self.history.switch_high_voltage(t, hv=True)

    def disable_hv(self) -> None:
        with self.history.at_instant(self.clock) as t:
            self.history.switch_high_voltage(t, hv=False)

    def now(self) -> float:
        return self.clock.now()

    def perform_action(self, action: str, values: Mapping[str, float]) -> float:
        """Perform one of `sim_hardware.plant.setup_state.OPERATOR_ACTIONS`; return the bench time of its end.

        Raises:
            ValueError: no such action, a missing or invalid number, or high voltage is on.
        """
        plant.check_action(action, values)
        done_s = now_s = self.clock.now()
        if "cycles" in values:
            values = {**values, "cycles": values["cycles"] - self.history.cycles_until(now_s)}
        if action == plant.SET_CHAMBER:
            self.plant.room.set_chamber(now_s, values["temperature_c"])
            return done_s
        if action in plant.SPECIMEN_ACTIONS:
            how = partial(self._changed_setup, action=action, values=values)
            if how(self.plant.setup_state) == self.plant.setup_state:
                if action == "tidy-up":
                    self.laser_view.apply_action(now_s, action, values)
                return done_s
            if self.history.high_voltage_on:
                raise ValueError(
                    f"{action}: high voltage is on, and a live specimen must not be touched; switch it off first"
                )
            weights, hands = action.endswith("-weight"), self.parameters.hands
            done_s = self.plant.schedule_change(
                self.clock,
                how,
                delay_s=hands.reach_s if weights else 0.0,
                transition_s=hands.release_s if weights else 0.0,
                landing_m_per_s=hands.landing_m_per_s,
            )
        self.laser_view.apply_action(now_s, action, values, self.faults.is_active("membrane-missing"))
        return done_s

    def _changed_setup(self, state: plant.SetupState, action: str, values: Mapping[str, float]) -> plant.SetupState:
        if action == "fix-mass" and self.faults.is_active("weight-mislabelled"):
            values = {**values, "mass_kg": plant.labelled_mass_kg(values["mass_kg"])}
        changed = plant.apply_action(state, action, values, self.parameters)
        if self.faults.is_active("membrane-left-on"):
            return plant.with_membrane_left_on(changed, state, self.parameters)
        return changed

    def add_fault_listener(self, listener: Callable[[], None]) -> None:
        """Call `listener` after every change of the active faults."""
        self._listeners.append(listener)

    def inject(self, fault: str) -> None:
        """Inject one of `sim_hardware.plant.faults.FAULT_DESCRIPTIONS`. Raises ValueError for an unknown name."""
        if self.faults.is_active(fault):
            return
        self.faults.inject(fault, self.clock.now())
        self._apply_fault(fault, active=True)
        self._notify_listeners()

    def clear(self, fault: str | None = None) -> None:
        """Clear one fault, or all. A generator whose power returns is in its factory state."""
        for name in self.faults.active_faults() if fault is None else (fault,):
            if not self.faults.is_active(name):
                continue
            self.faults.clear(name, self.clock.now())
            self._apply_fault(name, active=False)
        self._notify_listeners()

    def _apply_fault(self, fault: str, active: bool) -> None:
        """Apply the effects of a fault on instruments that do not read the faults themselves."""
        match fault:
            case "generator-power-off":
                self.generator.set_power(on=not active)
                if self._outside:
                    self._outside.set_power(on=not active)
                if not active:
                    self._generator_model.reset()
                self.supply.set_power(on=not active)
            case "interlock-relay-stuck" | "interlock-never-drops":
                self.interlock.update_from_faults()
            case "drive-cable-off":
                self._cable.set_connected(connected=not active)
            case "output-tripped" if active:
                self.generator.apply_settings(on=False)
            case "membrane-left-on" if active:
                self.plant.schedule_change(
                    self.clock, lambda state: plant.with_membrane_left_on(state, state, self.parameters)
                )
            case "membrane-left-on":
                self.plant.schedule_change(self.clock, lambda state: replace(state, skin=self.parameters.skin))
            case "clock-drift":
                self.generator.detune_clock(50.0 if active else -50.0)

    def _notify_listeners(self) -> None:
        for listener in self._listeners:
            listener()

    def active_faults(self) -> tuple[str, ...]:
        return self.faults.active_faults()

    def report(self, tolerance_v: float = 0.02) -> plant.VoltageReport:
        rest_v = self.parameters.amplifier.map.rest_v
        self.history.settle(self.clock.now())
        return plant.make_voltage_report(
            self.history.entries(), self.clock.now(), self.parameters.plant_rate_hz, rest_v, tolerance_v
        )


def _engine_of(model: ScpiInstrument) -> ScpiEngine:
    """Return the engine of an instrument, which may put errors into its queue."""
    engine = ScpiEngine(model)
    setattr(model, "queue_error", engine.queue_error)  # noqa: B010 - not of every instrument
    return engine
