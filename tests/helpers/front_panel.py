"""Second connection to a generator: a change at its front panel, or another program."""

from drivers.generators.burst import BurstGenerator
from drivers.transport.scpi import Link
from sim_hardware.bench import SimulatedBench
from sim_hardware.clock import VirtualClock
from tests.helpers.generators import BOXES, truth


def made(model: str) -> tuple[BurstGenerator, SimulatedBench, Link]:
    bench = SimulatedBench(truth(model), VirtualClock())
    link = bench.link()
    driver = next(driver for driver in BOXES.values() if driver.supports_model(model))
    return driver(link, bench.clock), bench, bench.link()


def press(panel: Link, command: str) -> None:
    panel.write(command)
    panel.write("*IDN?")  # a message of its own: a wrong command may leave the rest of its message unread
    panel.read()


def panel_reads(panel: Link, *questions: str) -> list[float]:
    return [float(asked(panel, question)) for question in questions]


def asked(panel: Link, question: str) -> str:
    panel.write(question)
    return panel.read()
