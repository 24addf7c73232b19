from .process import BenchProcess as BenchProcess
from .served_bench import ServedBench as ServedBench
