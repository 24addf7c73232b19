"""Client of a simulated bench in a separate process."""

import contextlib
import json
import queue
import subprocess
import tempfile
import threading
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from drivers import BenchError, Closeable, Deadline, SharedTime
from drivers.watchdog import python_command, python_environment, terminate
from sim_hardware.plant import SimulationParameters, VoltageReport


class BenchProcess(Closeable):
    """A simulated bench (sim_hardware.operator.BenchControls) that serves SCPI and NI's gRPC in a separate process.

    Args:
        parameters: of the simulated bench.
        speed: bench seconds per wall second; default: as in `parameters`.
        timeout_s: longest wait for the start or any reply.
        meanwhile: callback during the start of the process, which takes most of a second.

    Raises:
        BenchError: the process did not start, or an action was rejected; the message has the reason.
    """

    def __init__(
        self,
        parameters: SimulationParameters | None = None,
        speed: float | None = None,
        timeout_s: float = Deadline.SIMULATED_BENCH.seconds,
        meanwhile: Callable[[], object] = lambda: None,
    ) -> None:
        parameters = parameters or SimulationParameters()
        parameters = parameters if speed is None else replace(parameters, speed=speed)
        self._timeout_s = timeout_s
        self._folder = tempfile.TemporaryDirectory(prefix="tactor-bench-", ignore_cleanup_errors=True)
        self.time = (
            SharedTime(Path(self._folder.name, "time"), parameters.speed, new=True) if parameters.speed > 1 else None
        )
        """Bench time, which waits for a late reader; None at real speed."""
        self._lock = threading.Lock()
        self._stderr = tempfile.TemporaryFile("w+", encoding="utf-8", errors="replace")  # noqa: SIM115 - closed in close()
        self._child = subprocess.Popen(  # noqa: S603 - this very Python
            python_command("-m", "sim_hardware.service"),
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=self._stderr,
            text=True,
            encoding="utf-8",
            env=python_environment(),
            start_new_session=True,  # a Ctrl-C at the terminal is handled by the parent
        )
        self._answers: queue.Queue[str | None] = queue.Queue()
        self._reader = threading.Thread(target=self._listen, name="simulated bench answers", daemon=True)
        self._reader.start()
        try:
            time_file = "" if self.time is None else str(self.time.path)
            with self._lock:
                self._send({"truth": parameters.as_record(), "time_file": time_file})
                meanwhile()
                ports = self._receive()
        except BaseException:
            self.close()
            raise
        self.resource = str(ports["source"])
        """VISA resource string of the generator, or address of the LabJack that plays the drives."""
        self.server = str(ports["card"])
        """Address of the card: host:port of its gRPC service, or that of a LabJack."""

    @property
    def pid(self) -> int:
        """Process id of the child."""
        return self._child.pid

    def control(self, verb: str, **arguments: Any) -> Any:
        """Call a method of `BenchControls` in the process.

        Raises:
            BenchError: the call was rejected, or the process has died.
        """
        return self._exchange({"verb": verb, **arguments})

    def enable_hv(self) -> None:
        self.control("enable_hv")

    def disable_hv(self) -> None:
        self.control("disable_hv")

    def perform_action(self, action: str, values: Mapping[str, float]) -> float:
        return float(self.control("perform_action", action=action, values=dict(values)))

    def now(self) -> float:
        return float(self.control("now"))

    def inject(self, fault: str) -> None:
        self.control("inject", fault=fault)

    def clear(self, fault: str | None = None) -> None:
        self.control("clear", fault=fault)

    def active_faults(self) -> tuple[str, ...]:
        return tuple(self.control("active_faults"))

    def report(self, tolerance_v: float = 0.02) -> VoltageReport:
        return VoltageReport(**self.control("report", tolerance_v=tolerance_v))

    def laser_reading_m(self) -> float | None:
        reading: float | None = self.control("laser_reading_m")
        return reading

    def room_reading(self) -> tuple[float, float]:
        temperature_c, humidity = self.control("room_reading")
        return temperature_c, humidity

    def close(self) -> None:
        """End the process and wait for it."""
        terminate(self._child)
        self._reader.join()
        if self._child.stdout is not None:
            self._child.stdout.close()
        self._stderr.close()
        self._folder.cleanup()

    def _listen(self) -> None:
        if self._child.stdout is not None:
            for line in self._child.stdout:
                self._answers.put(line)
        self._answers.put(None)

    def _exchange(self, request: dict[str, Any]) -> Any:
        with self._lock:
            self._send(request)
            return self._receive()

    def _send(self, request: dict[str, Any]) -> None:
        if self._child.stdin is None or self._child.stdin.closed:
            raise BenchError("the simulated bench has been closed")
        try:
            self._child.stdin.write(json.dumps(request) + "\n")
            self._child.stdin.flush()
        except OSError:
            raise BenchError(f"the simulated bench does not answer{self._exit_description()}") from None

    def _receive(self) -> Any:
        try:
            line = self._answers.get(timeout=self._timeout_s)
        except queue.Empty:
            line = None
        if line is None:
            raise BenchError(f"the simulated bench does not answer{self._exit_description()}")
        answer = json.loads(line)
        if "error" in answer:
            raise BenchError(answer["error"])
        return answer["result"]

    def _exit_description(self) -> str:
        with contextlib.suppress(subprocess.TimeoutExpired):
            self._child.wait(1.0)
        if self._child.poll() is None:
            return f" within {self._timeout_s:g} s"
        self._stderr.seek(0)
        lines = self._stderr.read().strip().splitlines()
        return f": it ended with code {self._child.returncode}" + (f" ({lines[-1][:300]})" if lines else "")
