from .lock import lock_as_watchdog as lock_as_watchdog
from .observed_link import ObservedLink as ObservedLink
from .safe_ramp_down import RampDown as RampDown
from .scpi import Link as Link
from .scpi import ScpiSession as ScpiSession
from .scpi import join_commands as join_commands
from .serial_port import SerialPort as SerialPort
from .visa import VisaLink as VisaLink
