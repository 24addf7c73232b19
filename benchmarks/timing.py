"""What the benchmarks share: how long a call takes, and a table of numbers with their goals, or one JSON object."""

import argparse
import json
import tracemalloc
from collections.abc import Callable, Sequence
from time import perf_counter, process_time


def seconds(call: Callable[[], object], repeats: int) -> list[float]:
    """How long a call took, each time."""
    times = []
    for _ in range(repeats):
        start = perf_counter()
        call()
        times.append(perf_counter() - start)
    return times


def timed(call: Callable[[], object]) -> tuple[float, float]:
    """Seconds of wall clock and of processor that a call took."""
    wall, cpu = perf_counter(), process_time()
    call()
    return perf_counter() - wall, process_time() - cpu


def peak_mb(call: Callable[[], object]) -> float:
    """Most memory that a call held at a time, in MB."""
    tracemalloc.start()
    call()
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def tell(words: str, measure: Callable[[], dict[str, float]], goals: Sequence[tuple[str, str, float]]) -> None:
    """Measure and print; of each goal, `<` or `>=` a number, whether it is met."""
    parser = argparse.ArgumentParser(description=words)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    as_json = parser.parse_args().json
    numbers = measure()
    if as_json:
        print(json.dumps(numbers))
        return
    for name, value in numbers.items():
        print(f"{name:56s} {value:10.4g}")
    for name, sign, goal in goals:
        met = numbers[name] < goal if sign == "<" else numbers[name] >= goal
        print(f"goal {name} {sign} {goal:g}: {'met' if met else 'not met on this machine now'}")
