from .air_sensors import SimulatedEspec as SimulatedEspec
from .air_sensors import SimulatedHmt330 as SimulatedHmt330
from .laser_sensors import SimulatedOptoNcdt as SimulatedOptoNcdt
from .laser_sensors import simulated_keyence as simulated_keyence
from .network_sensors import SimulatedMicroEpsilon as SimulatedMicroEpsilon
