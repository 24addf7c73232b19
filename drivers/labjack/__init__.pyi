from .digitizer import T7Digitizer as T7Digitizer
from .output import T7Output as T7Output
from .t7_registers import T7Registers as T7Registers
