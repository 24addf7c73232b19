"""Read-only web page: headers, token, methods, hosts, and that the page shows what the window shows."""

import http.client
import json
import math
import os
import shutil
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest

from app.remote import RemoteView, Snapshot, snapshot_record
from app.remote.web_server import MAX_CONNECTIONS, MAX_PER_ADDRESS, MIN_TOKEN_LENGTH, WebServerError
from app.session import initial_window_state, reduce
from app.session.session import Observation
from app.session.state import BenchState, TimedEvent, WindowState
from drivers import CardReading
from model import AmplifierMap
from protocols.base import PointMeasured, Prompt, PromptShown, Quality, RunEnded, RunStatus, ShutdownStarted
from protocols.measurements.sine_dwell import SinePoint
from tests.helpers.messages import assert_names
from tests.helpers.session_events import LIVE, LOST

TOKEN = "a" * 22
NOW = datetime(2026, 11, 23, 9, 0, tzinfo=UTC)
SERVED = {"state": "at rest", "age_s": 0.0}
HOSTILE = "<img src=x onerror=alert(1)>"


@pytest.fixture
def view() -> Iterator[RemoteView]:
    served = RemoteView(lambda: SERVED)
    yield served
    served.stop()


def ask(
    view: RemoteView, path: str = "/state.json", method: str = "GET", **headers: str
) -> tuple[int, dict[str, str], bytes]:
    connection = http.client.HTTPConnection("127.0.0.1", view.port, timeout=60)
    connection.request(method, path, headers=headers)
    answer = connection.getresponse()
    found = answer.status, {k.lower(): v for k, v in answer.getheaders()}, answer.read()
    connection.close()
    return found


def test_without_a_token_only_this_computer_is_served(view: RemoteView) -> None:
    view.start("", 0)
    status, headers, body = ask(view)
    assert status == 200
    assert json.loads(body) == SERVED
    assert view.url == f"http://127.0.0.1:{view.port}/"
    assert headers["content-security-policy"].startswith("default-src 'none'")
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"
    assert headers["referrer-policy"] == "no-referrer"
    assert "access-control-allow-origin" not in headers
    assert "python" not in headers["server"].casefold()
    for host in ("attacker.example", f"attacker.example:{view.port}", "127.0.0.1.attacker.example:80", ""):
        assert ask(view, Host=host)[0] == 403
    with socket.socket() as other:  # of this computer, but not of its loopback interface
        other.bind(("127.0.0.2", 0))
        other.settimeout(60)
        with pytest.raises(OSError, match=r"refused|timed out"):
            socket.create_connection(("127.0.0.2", view.port), timeout=60).close()


def test_in_the_network_the_state_needs_the_token(view: RemoteView) -> None:
    view.start(TOKEN, 0)
    assert view.url.endswith(f":{view.port}/#{TOKEN}")
    for given in ({}, {"Authorization": "Bearer wrong"}, {"Authorization": f"Bearer {TOKEN}x"}, {"Authorization": "é"}):
        status, _, body = ask(view, **given)
        assert status == 401
        assert b"rest" not in body
    assert ask(view, f"/state.json?token={TOKEN}")[0] == 401
    assert ask(view, Authorization=f"Bearer {TOKEN}")[0] == 200
    assert ask(view, "/")[0] == 200  # the page itself has no data
    with pytest.raises(WebServerError) as refused:
        view.start("short", 0)
    assert_names(str(refused.value), len("short"), MIN_TOKEN_LENGTH)
    assert MIN_TOKEN_LENGTH >= 16
    assert ask(view, Authorization=f"Bearer {TOKEN}")[0] == 200  # served as before


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS", "TRACE", "CONNECT"])
def test_nothing_can_be_commanded(view: RemoteView, method: str) -> None:
    view.start("", 0)
    for path in ("/", "/state.json", "/stop", "/run"):
        status, headers, _ = ask(view, path, method)
        assert status == 405
        assert headers["allow"] == "GET, HEAD"
    assert ask(view, "/../../etc/passwd")[0] == 404


def test_silent_connections_are_limited_and_closing_does_not_wait_for_them(view: RemoteView) -> None:
    view.start("", 0)
    before = threading.active_count()
    silent = [socket.create_connection(("127.0.0.1", view.port), timeout=60) for _ in range(MAX_CONNECTIONS + 8)]
    refused = [each for each in silent[MAX_CONNECTIONS:] if each.recv(1) == b""]
    assert len(refused) == 8
    assert threading.active_count() <= before + MAX_CONNECTIONS
    view.stop()
    assert all(each.recv(1) == b"" for each in silent[:MAX_CONNECTIONS])
    for each in silent:
        each.close()
    assert view.url == ""


@pytest.mark.skipif(sys.platform != "linux", reason="all of 127.0.0.0/8 is this computer there only")
def test_one_address_does_not_block_the_page_for_others(view: RemoteView) -> None:
    view.start("", 0)
    silent = [socket.create_connection(("127.0.0.1", view.port), timeout=60) for _ in range(MAX_CONNECTIONS)]
    assert all(each.recv(1) == b"" for each in silent[MAX_PER_ADDRESS:])
    with socket.create_connection(("127.0.0.1", view.port), 10, ("127.0.0.2", 0)) as other:
        other.sendall(f"GET /state.json HTTP/1.1\r\nHost: 127.0.0.1:{view.port}\r\n\r\n".encode())
        assert other.recv(15) == b"HTTP/1.1 200 OK"
    for each in silent:
        each.close()


def test_a_state_that_is_no_number_or_cannot_be_read_is_answered() -> None:
    states = iter([{"volts": math.nan, "name": "bad\udcff"}])
    view = RemoteView(lambda: next(states))
    view.start("", 0)
    status, _, body = ask(view)
    assert (status, json.loads(body)["volts"]) == (200, None)
    assert ask(view)[0] == 500
    view.stop()


def test_a_port_in_use_is_one_sentence(view: RemoteView) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(WebServerError) as refused:
            view.start("", port)
    message = str(refused.value)
    assert_names(message, port, "127.0.0.1")
    assert "\n" not in message
    assert view.url == ""


def point(index: int, frequency_hz: float, largest_m: float) -> PointMeasured:
    flags = int(Quality.SIMULATED)
    return PointMeasured(
        index,
        SinePoint(frequency_hz, largest_m, 2e-6, 5e-4, 1e-8, 0, 1e-4, 0.1, (1e-3,), 2.5, 2.5, 0, 0, 5e-7, 80, flags),
        index,
    )


def state_of(*events: Any) -> WindowState:
    found = initial_window_state(AmplifierMap(), HOSTILE, True, {"generator": "33500B"})
    for event in events:
        found = reduce(found, TimedEvent(event, NOW))
    return found


def test_the_record_is_what_the_window_shows() -> None:
    live = state_of(*LIVE, point(0, 160.0, 1e-3), point(1, 170.0, math.nan))
    seen = Observation(CardReading((0.0, 5.0), (0.0, 5.0), 10.0))
    record = snapshot_record(Snapshot(live, "T7", "Measure sag", seen=seen, now_s=10.1))
    assert record["state"] == "live"
    assert record["live"]
    assert record["simulated"]
    assert (record["voltage"], record["voltage_present"]) == ("−500 … +1500 V", True)
    assert record["voltage_note"] == "at the specimen, 0.1 s ago; aim: sine, 160 Hz, −500 … +1500 V"
    assert record["instruments"] == {"generator": "connecting"}
    late = snapshot_record(Snapshot(live, seen=seen, now_s=14.0))
    assert (late["voltage"], late["voltage_present"]) == ("unknown", False)
    assert "last −500 … +1500 V, 4 s ago" in late["voltage_note"]
    assert late["voltage_note"].startswith("last")
    assert record["points"]["points"] == [[160.0, pytest.approx(1000.0), True]]
    assert record["points"]["y"] == "peak to peak (µm)"
    json.dumps(record, allow_nan=False)
    asked = state_of(*LIVE, PromptShown(1, Prompt("place-weight", "Put 200 g on the centre.")))
    record = snapshot_record(Snapshot(asked))
    assert record["operator_needed"]
    assert record["next_step"] == "Put 200 g on the centre."
    lost = snapshot_record(Snapshot(state_of(*LOST)))
    assert not lost["live"]
    going = snapshot_record(Snapshot(state_of(*LIVE, ShutdownStarted())))
    assert going["busy"]
    assert not going["live"]
    known = replace(state_of(*LOST), phase=BenchState.AT_REST, rest_lost=False)
    assert snapshot_record(Snapshot(known))["urgent"], "the message is not acknowledged"
    assert not snapshot_record(Snapshot(replace(known, unsafe="")))["urgent"]
    for message in ("", "doubtful: look at the log"):
        ended = replace(state_of(*LIVE, RunEnded(RunStatus.COMPLETED, "", "")), verdict_message=message)
        assert snapshot_record(Snapshot(ended))["result"]["good"] is not bool(message)
    assert lost["urgent"]
    assert lost["state"] == "unsafe"
    assert lost["unsafe"]


CHROMIUM = next(
    (found for name in ("chromium", "chromium-browser", "google-chrome") if (found := shutil.which(name))), ""
)


def read_in_browser(url: str, folder: Path, *options: str) -> str:
    """Return the document of a page as headless Chromium has it after two seconds of its time."""
    command = [
        CHROMIUM,
        "--headless",
        "--no-sandbox",
        "--disable-gpu",
        f"--user-data-dir={folder}",
        "--virtual-time-budget=2500",
        *options,
        "--dump-dom",
        url,
    ]
    environment = {**os.environ, "HOME": str(folder)}
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True, env=environment)
    return done.stdout


@pytest.mark.deep
@pytest.mark.skipif(not CHROMIUM, reason="Chromium is not installed")
def test_a_browser_shows_the_page_and_runs_nothing_of_its_texts(tmp_path: Path) -> None:
    events = [*LIVE, point(0, 160.0, 1e-3)]
    record = snapshot_record(Snapshot(state_of(*events), HOSTILE, "")) | {"age_s": 0.0}
    view = RemoteView(lambda: record)
    view.start(TOKEN, 0)
    try:
        local = f"http://127.0.0.1:{view.port}/"
        page = read_in_browser(f"{local}#{TOKEN}", tmp_path)
        without = read_in_browser(local, tmp_path)
    finally:
        view.stop()
    assert ">live</div>" in page
    assert "1 points" in page
    assert "<img" not in page
    assert "&lt;img src=x" in page
    assert "no valid token" in without
    assert ">live</div>" not in without
