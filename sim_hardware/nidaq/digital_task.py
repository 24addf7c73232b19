"""NI-DAQmx tasks of one static digital line on the simulated card; a line keeps its level when its task ends."""

import re

from sim_hardware.nidaq.errors import NiError
from sim_hardware.nidaq.task import FINITE, NiTask, SimulatedNiDevice


class NiDigitalTask(NiTask):
    """A static digital line, output or input; it has neither clock nor buffer."""

    max_rate_hz = 0.0

    def __init__(self, device: SimulatedNiDevice, name: str, text: str, output: bool) -> None:
        own, _, self._line = text.strip().lower().partition("/")
        if own != device.name.lower():
            raise NiError(-200220, f"Device Specified: {own}")
        if not re.fullmatch(r"port0/line[0-7]", self._line):
            raise NiError(-200170, f"Physical Channel Name: {text}")
        super().__init__(device, name, FINITE, 1)
        self._output = output

    def write(self, high: bool) -> None:
        """Set the line. Raises NiError: an input, unplugged, or in use by another task."""
        self.start()
        if not self._output:
            raise NiError(-200452, f"Task Name: {self.name}")
        self.device.card.interlock.write_line(self._line, high)

    def read(self) -> bool:
        """Return the line's level. Raises NiError like `write`."""
        self.start()
        return self.device.card.interlock.read_line(self._line)

    def start(self) -> None:
        self.device.check_present()
        if self.device.line_owners.setdefault(self._line, self) is not self:
            raise NiError(-50103, f"Task Name: {self.name}")

    def stop(self) -> None:
        if self.device.line_owners.get(self._line) is self:
            del self.device.line_owners[self._line]

    def is_done(self) -> bool:
        """A static line has nothing to do."""
        return True

    def wait_until_done(self, _timeout_s: float) -> bool:
        return True

    def set_buffer(self, _scans: int) -> None:
        raise NiError(-200452, f"Task Name: {self.name}")

    def _divided_rate(self, rate_hz: float) -> float:
        return rate_hz
