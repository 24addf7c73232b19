"""Simulated interlock: a retriggerable monostable at a digital line of the card, and the relay in the amplifier's enable or supply."""

import math

from drivers import Clock, WallClock
from sim_hardware.plant import INTERLOCK_FAULTS, FaultState, InterlockParameters, VoltageHistory

LINE_OFF, RELAY_STUCK, NEVER_DROPS = INTERLOCK_FAULTS


class SimulatedInterlock:
    """Permits high voltage from each rising edge of the heartbeat for the monostable's time and the relay's and amplifier's release.

    Without a line there is none. On a virtual clock, where bench and program end together, it is bridged.
    """

    def __init__(
        self, parameters: InterlockParameters, history: VoltageHistory, clock: Clock, faults: FaultState
    ) -> None:
        self._parameters, self._history, self._clock, self._faults = parameters, history, clock, faults
        self._levels: dict[str, bool] = {}
        self._closed_until_s, self._triggered = -math.inf, False
        self._is_wired = bool(parameters.line) and isinstance(clock, WallClock)
        self.update_from_faults()

    def write_line(self, line: str, high: bool) -> None:
        """Set an output line of the card; a rising edge on the heartbeat's line triggers the monostable."""
        rises = high and not self._levels.get(line, False)
        self._levels[line] = high
        if self._is_wired and rises and line == self._parameters.line and not self._faults.is_active(LINE_OFF):
            self._triggered = True
            self._permit()

    def read_line(self, line: str) -> bool:
        """Return an input line of the card; the relay's second contact pulls its line up while it is closed."""
        if self._is_wired and line == self._parameters.state_line:
            return self._clock.now() < self._closed_until_s
        return self._levels.get(line, False)

    def update_from_faults(self) -> None:
        """Apply the faults of monostable and relay from now on."""
        if self._is_wired:
            self._permit(renew=False)

    def _permit(self, renew: bool = True) -> None:
        speed, own = float(getattr(self._clock, "speed", 1.0)), self._parameters
        with self._history.at_instant(self._clock) as now_s:
            stuck = self._faults.is_active(RELAY_STUCK) and self._closed_until_s > now_s
            if stuck or (self._triggered and self._faults.is_active(NEVER_DROPS)):
                self._closed_until_s = math.inf
            elif renew:
                self._closed_until_s = now_s + own.monostable_s * speed
            elif self._closed_until_s == math.inf:
                self._closed_until_s = now_s
            self._history.permit_high_voltage(now_s, self._closed_until_s + own.release_s * speed)
