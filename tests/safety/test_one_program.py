"""One bench, one controlling program: a second one is refused before it commands anything."""

import os
from pathlib import Path

import pytest

from app.config.bench_file import load_bench
from app.session.bench_connection import connect
from drivers.deadlines import Deadline
from drivers.errors import InstrumentError
from drivers.transport import lock
from sim_hardware.bench import SimulatedBench
from sim_hardware.service.served_bench import ServedBench


@pytest.mark.deep
def test_a_second_program_is_refused_and_a_dead_one_leaves_the_bench_to_its_watchdog(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with ServedBench(SimulatedBench()) as served:
        file = tmp_path / "bench.toml"
        file.write_text(
            f'name = "bench of Anna"\n[generator]\nresource = "TCPIP::127.0.0.1::{served.scpi.port}::SOCKET"\n'
            f'[card]\nserver = "127.0.0.1:{served.card.port}"\n'
        )
        config = load_bench(str(file))
        with connect(config) as first:
            commands = len(served.bench.history.entries())
            with pytest.raises(InstrumentError) as refused, connect(config):
                pass
            assert f"(process {os.getpid()}, user " in str(refused.value)
            assert "has controlled it with the bench 'bench of Anna' since 20" in str(refused.value)
            assert len(served.bench.history.entries()) == commands
            first.bench.watchdog.arm()
            # The watchdog holds the instruments by itself: a dead program's would be free otherwise.
            monkeypatch.setattr(Deadline.INSTRUMENT_LOCK, "seconds", 0.1)
            with pytest.raises(InstrumentError, match="another watchdog holds"):
                lock.lock_as_watchdog([str(lock._lock_file(lock.address_key(f"127.0.0.1:{served.card.port}/Dev1")))])
            first.bench.watchdog.disarm()
        with connect(config):
            pass
