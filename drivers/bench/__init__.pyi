from .drive_limits import DriveLimits as DriveLimits
from .drive_limits import HvAmplifier as HvAmplifier
from .watchdog_interface import HEARTBEAT_PERIOD_S as HEARTBEAT_PERIOD_S
