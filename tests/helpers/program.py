"""`tactor-bench run` in its own process, on a bench file that names a simulated bench of the test."""

import math
import os
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from app.common import remember_conditions
from app.session.commissioning_record import save_record
from drivers import ScpiSession, VisaLink
from drivers.clock import WallClock
from drivers.evidence.assumption import OutputCheck
from protocols.commissioning.sequence import Commissioned
from protocols.commissioning.verdict import CheckedOutput, MeasuredTimes
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.history_report import VoltageReport
from sim_hardware.service.served_bench import ServedBench
from tests.helpers.simulated_bench import assert_safe_voltage, simulated

ROOT = Path(__file__).resolve().parents[2]


class Program:
    """`tactor-bench run` as in a terminal, on a bench file with real addresses."""

    def __init__(self, bench: SimulatedBench, process: subprocess.Popen[str], keyboard: int) -> None:
        """`keyboard` is the other end of the pseudo-terminal that the program has as standard input."""
        self.bench, self.process, self._keyboard = bench, process, keyboard
        self.said: list[str] = []
        self.said_s: list[float] = []
        """When each line arrived, on the monotonic clock."""
        self._grew = threading.Condition()
        self._reader = threading.Thread(target=self._listen)
        self._reader.start()

    def _listen(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            with self._grew:
                self.said.append(line.rstrip())
                self.said_s.append(time.monotonic())
                self._grew.notify_all()

    def wait_for(self, words: str) -> None:
        """Wait until the program has printed `words`."""
        with self._grew:
            found = self._grew.wait_for(lambda: any(words in line for line in self.said), timeout=90)
        assert found, "\n".join(self.said)

    def answer(self, words: str, act: object = None, say: str = "") -> None:
        """Perform the action of a prompt, then type its answer and press Enter."""
        self.wait_for(words)
        if callable(act):
            act()
        time.sleep(0.4)  # until the prompt is complete
        for _ in range(30):  # what is typed before the program reads is discarded, as a safety prompt demands
            count = len(self.said)
            os.write(self._keyboard, f"{say}\n".encode())
            with self._grew:
                if self._grew.wait_for(lambda count=count: len(self.said) > count, timeout=2):  # type: ignore[misc]
                    return
        raise AssertionError("\n".join(self.said))

    def arm(self) -> None:
        self.answer("high voltage OFF", self.bench.disable_hv)
        self.answer("must be ON now", self.bench.enable_hv, "on")

    def go_live(self) -> None:
        """Until a drive has been on the specimen for a while."""
        self.arm()
        self.wait_for("high voltage is on")
        while self.bench.report().outside_rest_s < 0.2:
            assert self.process.poll() is None, self.text
            time.sleep(0.1)

    def end(self) -> int:
        code = self.process.wait(timeout=120)
        self._reader.join()
        return code

    def close(self) -> None:
        self.process.kill()
        self.end()
        os.close(self._keyboard)
        assert self.process.stdout is not None
        self.process.stdout.close()

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.said).split())

    @property
    def file(self) -> Path:
        return next(self.folder.glob("*.h5"))

    folder: Path


@contextmanager
def program(
    folder: Path, *settings: str, watchdog: str = "", script: str = "", model: str = "33511B"
) -> Iterator[tuple[Program, ServedBench]]:
    """`tactor-bench run sine-dwell` with settings, or in its place a Python script that finds `bench.toml` where it runs."""
    bench = SimulatedBench(simulated(generator={"model": model}).simulation_parameters, WallClock(1.0))
    with ServedBench(bench) as served:
        file = folder / "bench.toml"
        file.write_text(
            f'name = "bench under test"\n'
            f'[generator]\nresource = "TCPIP::127.0.0.1::{served.scpi.port}::SOCKET"\ntimeout_s = 2.0\n'
            f'[card]\nserver = "127.0.0.1:{served.card.port}"\n'
            f"[sensor]\ndelay_s = 1e-4\n"
            f"[watchdog]\n{watchdog}\n"
        )
        running = start(bench, folder, *settings, script=script)
        try:
            yield running, served
        finally:
            running.close()


def start(
    bench: SimulatedBench, folder: Path, *settings: str, script: str = "", protocol: str = "sine-dwell"
) -> Program:
    """Start the program on the `bench.toml` of the folder; close it afterwards."""
    command = [sys.executable, "-c", "from app.cli.main import entry; entry()"]
    options = ["--bench", str(folder / "bench.toml"), "--out", str(folder), "run", protocol]
    options += ["--without-commissioning", "simulated bench on its wires"]
    chosen = [part for setting in settings for part in ("--set", setting)]
    remember_conditions("test operator")  # the first run of a day on a real bench asks for it
    keyboard, terminal = os.openpty()  # a run on a real bench without a terminal is refused: nobody could answer
    process = subprocess.Popen(
        [sys.executable, "-c", script] if script else [*command, *options, *chosen],
        cwd=folder if script else None,
        stdin=terminal,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        env={**os.environ, "COLUMNS": "400", "PYTHONUNBUFFERED": "1", "PYTHONPATH": str(ROOT)},
    )
    os.close(terminal)
    running = Program(bench, process, keyboard)
    running.folder = folder
    return running


def store_commissioning(resource: str, level_stop_s: float = math.nan) -> None:
    """Store a commissioning record of the instrument at an address: without one, a level is held by the offset.

    `level_stop_s` is the measured duration of Stop from a level whose end may be hastened; NaN where it may not.
    """
    link = VisaLink(resource)
    identity = ScpiSession(link, "generator").identify()
    link.close()
    times = MeasuredTimes(0.2, 0.0, 0.0, level_stop_s=level_stop_s)
    passed = Commissioned((CheckedOutput(OutputCheck.UNEVEN, 1.0, "1", 0.97, 1.03),), times, (), ())
    save_record(identity, simulated=False, rate_hz=1e5, result=passed)


def safe(bench: SimulatedBench) -> VoltageReport:
    report = bench.report()
    assert_safe_voltage(report)
    return report
