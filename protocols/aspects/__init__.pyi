from .guarded import guarded_aspects as guarded_aspects
from .run_points import RunPoints as RunPoints
