from .dialects import make_supply_engine as make_supply_engine
from .supply import SimulatedSupply as SimulatedSupply
from .supply import draw_supply_traits as draw_supply_traits
