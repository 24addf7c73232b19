from .guarded import guarded_aspects as guarded_aspects
from .run_points import ONE_TEMPERATURE_K as ONE_TEMPERATURE_K
from .run_points import RunPoints as RunPoints
