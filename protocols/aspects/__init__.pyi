from .run_points import RunPoints as RunPoints
