from .environment import HIGHEST_C as HIGHEST_C
from .environment import LOWEST_C as LOWEST_C
from .environment import EnvironmentSensor as EnvironmentSensor
from .laser_sensor import PRESETS as PRESETS
from .laser_sensor import LaserSensor as LaserSensor
from .meter_dialects import BLOCK_DIALECTS as BLOCK_DIALECTS
