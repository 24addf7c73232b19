from .generator import SegmentFactory as SegmentFactory
from .generator import SimulatedGenerator as SimulatedGenerator
from .registry import draw_traits as draw_traits
from .registry import make_generator as make_generator
from .scpi_generator import accept_keywords as accept_keywords
from .traits import Trait as Trait
from .traits import draw_options as draw_options
