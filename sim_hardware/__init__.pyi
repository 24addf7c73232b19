from .bench import SimulatedBench as SimulatedBench
from .clock import VirtualClock as VirtualClock
from .clock import keep_freed_memory as keep_freed_memory
from .operator import BenchControls as BenchControls
from .operator import SimulatedOperator as SimulatedOperator
from .plant.parameters import GeneratorParameters as GeneratorParameters
from .plant.parameters import SimulationParameters as SimulationParameters
from .wires.scpi_engine import ScpiCommand as ScpiCommand
