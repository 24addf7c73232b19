"""Simulated bench in a process with its own GIL: `python -m sim_hardware.service`.

It reads one JSON line (the simulation parameters) from standard input, answers with one line that names its ports, and then with
one line for each call of its controls. It ends with its standard input, and therefore with its parent.
"""

import contextlib
import json
import os
import queue
import signal
import sys
import threading
import time
from pathlib import Path
from typing import Any, TextIO

from drivers import Deadline, SharedTime, WallClock
from sim_hardware.bench import SimulatedBench
from sim_hardware.plant import SimulationParameters

LINGER_S, POLL_S = 3.0, 0.01


def main() -> int:
    """Serve until standard input closes; return 2 if the configuration was rejected."""
    # A Ctrl-C at the terminal is for the parent: it brings the bench to rest first, which needs this process.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # output of libraries must not mix with the replies
    lines: queue.SimpleQueue[str] = queue.SimpleQueue()
    threading.Thread(target=_read_lines, args=(lines,), daemon=True).start()
    with answers, contextlib.suppress(BrokenPipeError):
        try:
            first = json.loads(lines.get())
            parameters = SimulationParameters.from_record(first["truth"])
        except (ValueError, KeyError, TypeError) as error:
            _write_response(answers, error=f"the simulated bench was given a wrong configuration: {error}")
            return 2
        # Imported late, so that a rejected configuration does not wait for the servers' libraries.
        from sim_hardware.service.served_bench import ServedBench

        path = first.get("time_file", "")
        clock = WallClock(parameters.speed, SharedTime(Path(path), parameters.speed) if path else None)
        with ServedBench(SimulatedBench(parameters, clock)) as served:
            _write_response(answers, result={"source": served.source_address, "card": served.card.address})
            while line := lines.get():
                try:
                    request = json.loads(line)
                    result = served.control(request.pop("verb"), **request)
                except (ValueError, KeyError) as error:
                    _write_response(answers, error=str(error))
                else:
                    _write_response(answers, result=result)
            # A watchdog outlives its program: while it holds the generator's link it may have to bring the generator to rest.
            for _ in range(round(LINGER_S / POLL_S)):
                if not served.source_connections:
                    break
                time.sleep(POLL_S)
    return 0


def _read_lines(lines: "queue.SimpleQueue[str]") -> None:
    """Pass the lines of standard input on, with an empty one at its end; then end the process, even if its other threads hang."""
    try:
        for line in sys.stdin:
            lines.put(line)
        lines.put("")
        time.sleep(LINGER_S + Deadline.CHILD_EXIT.seconds)
    finally:  # also without memory for a line
        os._exit(1)


def _write_response(out: TextIO, **fields: Any) -> None:
    out.write(json.dumps(fields) + "\n")
    out.flush()


if __name__ == "__main__":
    sys.exit(main())
