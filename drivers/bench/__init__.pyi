from .amplifier import DriveLimits as DriveLimits
from .amplifier import HvAmplifier as HvAmplifier
from .watchdog_interface import HEARTBEAT_PERIOD_S as HEARTBEAT_PERIOD_S
