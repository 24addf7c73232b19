from .analog_output import SimulatedAnalogOutput as SimulatedAnalogOutput
from .card import SimulatedCard as SimulatedCard
from .card import draw_card_traits as draw_card_traits
from .grpc_server import NiGrpcServer as NiGrpcServer
from .in_process_digitizer import SimulatedDigitizer as SimulatedDigitizer
from .interlock import SimulatedInterlock as SimulatedInterlock
from .task import SimulatedNiDevice as SimulatedNiDevice
