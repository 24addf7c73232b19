"""`python -m sim_hardware.service`: the simulated bench in a process of its own, so that no window shares its GIL.

It reads one JSON line (the truth) from standard input, answers with one line that names its ports, and then one line
for each control verb. It lives as long as its standard input: a parent that dies takes it along, whatever killed it.
"""

import contextlib
import json
import os
import signal
import sys
import time
from typing import Any, TextIO

from sim_hardware.bench import SimulatedBench
from sim_hardware.plant.parameters import SimulationParameters

LINGER_S, POLL_S = 3.0, 0.01


def main() -> int:
    """Serve until standard input closes; the exit code is 2 if the configuration was refused."""
    # A Ctrl-C at the terminal is for the parent: it brings the bench to rest first, and needs us for that.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    answers = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever a library prints must not get between the answers
    with answers, contextlib.suppress(BrokenPipeError):
        try:
            truth = SimulationParameters.from_record(json.loads(sys.stdin.readline())["truth"])
        except (ValueError, KeyError, TypeError) as error:
            _write_response(answers, error=f"the simulated bench was given a wrong configuration: {error}")
            return 2
        # Imported late: a refused configuration need not wait for the servers' libraries.
        from sim_hardware.service.served_bench import ServedBench

        with ServedBench(SimulatedBench(truth)) as served:
            _write_response(answers, result={"scpi_port": served.scpi.port, "card_port": served.card.port})
            for line in sys.stdin:
                try:
                    request = json.loads(line)
                    result = served.control(request.pop("verb"), **request)
                except (ValueError, KeyError) as error:
                    _write_response(answers, error=str(error))
                else:
                    _write_response(answers, result=result)
            # Whoever still holds the generator's wire may have to bring it to rest: a watchdog outlives its program.
            for _ in range(round(LINGER_S / POLL_S)):
                if not served.scpi.connections:
                    break
                time.sleep(POLL_S)
    return 0


def _write_response(out: TextIO, **fields: Any) -> None:
    out.write(json.dumps(fields) + "\n")
    out.flush()


if __name__ == "__main__":
    sys.exit(main())
