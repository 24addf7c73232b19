from .laser_sensors import SimulatedKeyenceLkg as SimulatedKeyenceLkg
from .laser_sensors import SimulatedOptoNcdt as SimulatedOptoNcdt
