from .t7_output import SimulatedT7Output as SimulatedT7Output
from .t7_server import SimulatedT7 as SimulatedT7
