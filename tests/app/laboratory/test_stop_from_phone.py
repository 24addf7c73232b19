"""Stop of an unattended run from a phone: only where it is enabled, only with the token of that run, by the way to rest of every other stop."""

import http.client
import math
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from app.remote import PhoneStop, RemoteView
from app.remote.server import StopServer
from app.remote.web_server import MAX_PER_ADDRESS, WebServer
from app.session.session import Session
from protocols.base import Event, RestMeasured, RunEnded, RunStatus, StopOffered, StopRequested
from protocols.measurements.endurance import Endurance
from protocols.runfile.reader import Run
from protocols.runner.request import RunRequest
from tests.app.test_session import Nobody
from tests.helpers.messages import assert_names
from tests.helpers.simulated_bench import assert_safe_voltage, laboratory
from tests.protocols.test_endurance import SHORT, UNATTENDED, bench

TOKEN, OTHER = "a" * 22, "b" * 22
ENABLED = SHORT | UNATTENDED | {"stop_from_phone": True}


def post(port: int, token: str = "", path: str = "/stop", body: bytes = b"", **headers: str) -> tuple[int, str]:
    """Press the button; return status and text of the answer."""
    given = {"Authorization": f"Bearer {token}"} if token else {}
    with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
        connection.request("POST", path, body, given | headers)
        answer = connection.getresponse()
        return answer.status, answer.read().decode()


@contextmanager
def serving(stop: Callable[[str], None]) -> Iterator[StopServer]:
    server = StopServer(stop)
    server.start(TOKEN, 0, "127.0.0.1")
    try:
        yield server
    finally:
        server.stop()


def test_the_stop_needs_the_token_of_the_run_in_its_header() -> None:
    asked: list[str] = []
    with serving(asked.append) as server:
        own, foreign = f"http://127.0.0.1:{server.port}", "http://attacker.example"
        for token in ("", OTHER, TOKEN[:-1], f"{TOKEN}x", "é"):
            assert post(server.port, token)[0] == 401
        # What a page of another site can send: no header of its own, cookies and forms only; a header asks OPTIONS first.
        for origin in (own, foreign):
            cookie = {"Cookie": f"tactor-bench-{server.port}={OTHER}", "Origin": origin}
            assert post(server.port, **cookie)[0] == 401
        assert post(server.port, path=f"/stop?token={TOKEN}")[0] == 401
        for method in ("GET", "HEAD", "OPTIONS", "PUT", "DELETE"):
            with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)) as connection:
                connection.request(method, "/stop", headers={"Authorization": f"Bearer {TOKEN}", "Origin": foreign})
                answer = connection.getresponse()
                assert (answer.status, answer.getheader("Allow")) == (405, "POST")
                assert answer.getheader("Access-Control-Allow-Origin") is None
        with suppress(
            OSError, http.client.HTTPException
        ):  # the connection is closed, perhaps before the answer is read
            assert post(server.port, TOKEN, body=b"x" * 100)[0] == 400
        assert post(server.port, TOKEN, path="/")[0] == 405
        assert asked == []
        server.conclude("stopped by a phone")
        assert post(server.port, OTHER)[0] == 401


def test_a_press_waits_for_the_end_and_one_that_is_repeated_stops_nothing() -> None:
    asked: list[str] = []

    def stop(by: str) -> None:
        asked.append(by)
        threading.Thread(target=server.conclude, args=["stopped; at rest"]).start()

    with serving(stop) as server:
        first = post(server.port, TOKEN)
        assert first == (200, "stopped; at rest\n")
        assert post(server.port, TOKEN) == first  # sent again by who listened
    assert asked == ["a phone at 127.0.0.1"]


def test_each_run_has_a_token_of_its_own_and_the_last_one_is_dead() -> None:
    phone, asked = PhoneStop(), []
    first = phone.open(asked.append).partition("#")[2]
    phone.observe(RunEnded(RunStatus.COMPLETED, "", ""))
    assert phone.url == ""
    second = phone.open(asked.append).partition("#")[2]
    assert len(first) == len(second) == 22
    assert first != second
    port = phone._server.port
    assert post(port, first)[0] == 401
    phone.close()
    with pytest.raises(OSError, match="refused"):
        post(port, second)
    assert asked == []


def test_the_page_is_served_beside_a_program_that_has_its_port(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("0.0.0.0", 0))
        taken.listen()
        monkeypatch.setattr("app.remote.stop.PORT", taken.getsockname()[1])
        with closing(PhoneStop()) as phone:
            phone.open(lambda _: None)
            port = phone._server.port
            assert port != taken.getsockname()[1]
            with closing(http.client.HTTPConnection("127.0.0.1", port, timeout=60)) as connection:
                connection.request("GET", "/")
                page = connection.getresponse().read()
    assert b"stop.js" in page
    assert b"#" not in page.partition(b"<body>")[2]  # the token is not in it


def test_pages_that_only_show_refuse_in_words() -> None:
    view: WebServer = RemoteView(dict)
    view.start("", 0)
    status, text = post(view.port)
    view.stop()
    assert status == 405
    assert "stop_from_phone" in text
    with pytest.raises(ValueError, match="stop_from_phone"):
        Endurance(stop_from_phone=True)


@contextmanager
def session(phone: PhoneStop | None, *observers: Callable[[Any], None]) -> Iterator[tuple[Session, Any]]:
    """Open a session on a bench with all conditions of an unattended run."""
    with laboratory(bench()) as lab:
        lab.bench.notice = "notify Anna"

        @contextmanager
        def opened() -> Iterator[Any]:
            yield lab

        watching = [phone.observe] if phone else []
        one = Session(opened, [*observers, *watching], Nobody())
        one.remote_stop = phone
        one.start()
        try:
            yield one, lab
        finally:
            one.close(60)
            if phone:
                phone.close()


def in_block(begun: list[str], event: Event) -> bool:
    """Return whether the event is a block of samples of driven cycles."""
    if event.kind == "EntryBegan":
        begun.append(event.key[0])
    return begun[-1:] == ["cycles"] and event.kind == "BlockSeen"


@pytest.mark.deep
def test_a_stop_from_the_phone_ramps_to_rest_and_is_in_file_and_verdict(tmp_path: Path) -> None:
    phone, seen, begun = PhoneStop(), [], []
    answers: list[tuple[int, str]] = []
    presses: list[threading.Thread] = []

    def watch(event: Event) -> None:
        seen.append(event)
        if in_block(begun, event) and not presses:
            port, token = phone._server.port, phone.url.partition("#")[2]
            presses.append(threading.Thread(target=lambda: answers.append(post(port, token))))
            presses[0].start()
            assert one._control.cancel.wait(60)

    with session(phone, watch) as (one, lab):
        one.run(RunRequest(Endurance(**ENABLED), tmp_path, "T1"))
        assert one.finished.wait(120)
        presses[0].join(60)
        at_rest = lab.control.history.volts(np.array([lab.control.clock.now() - 1e-3]))
        assert_safe_voltage(lab.control.report())
        ended, path = one.outcome, one.path
    assert abs(float(at_rest[0]) - 2.5) < 0.05
    assert 0 < lab.control.history.cycles_until(math.inf) < 1000
    assert ended.status is RunStatus.STOPPED
    assert_names(ended.reason, "127.0.0.1")
    assert_names(ended.verdict.describe(""), "127.0.0.1")
    (status, text) = answers[0]
    assert status == 200
    assert ended.reason in text
    assert next(event.words for event in seen if isinstance(event, RestMeasured) and event.confirmed) in text
    token = next(event.url for event in seen if isinstance(event, StopOffered)).partition("#")[2]
    assert token.encode() not in path.read_bytes()
    with Run(path) as file:
        stored = [each for each in file.events() if each.kind == StopRequested.kind]
        assert_names(file.record.reason, "127.0.0.1")
        assert len(stored) == 1
    assert not any(token in getattr(event, "text", "") for event in seen)


@pytest.mark.deep
def test_who_has_no_token_neither_stops_nor_hangs_a_run(tmp_path: Path) -> None:
    phone, begun = PhoneStop(), []
    attacked: list[int] = []
    left: list[socket.socket] = []

    def attack(event: Event) -> None:
        if not in_block(begun, event) or attacked:
            return
        port = phone._server.port
        attacked.append(port)
        assert {post(port, OTHER)[0] for _ in range(50)} == {401}
        for sent in (b"", b"POST /stop HTT", b"POST /stop HTTP/1.1\r\nHost: x\r\nContent-Length: 9999999\r\n\r\n"):
            for _ in range(MAX_PER_ADDRESS):
                client = socket.create_connection(("127.0.0.1", port), timeout=60)
                client.sendall(sent)
                left.append(client)

    with session(phone, attack) as (one, lab):
        one.run(RunRequest(Endurance(**ENABLED), tmp_path, "T1"))
        assert one.finished.wait(120)
        assert one.outcome.status is RunStatus.COMPLETED, one.outcome.reason
        assert lab.control.history.cycles_until(math.inf) == pytest.approx(4000, abs=0.1)
    for client in left:
        client.close()
    assert attacked


@pytest.mark.parametrize("enabled", [True, False])
def test_without_a_page_the_stop_is_refused_and_without_the_stop_there_is_no_page(
    enabled: bool, tmp_path: Path
) -> None:
    phone, seen = None if enabled else PhoneStop(), []
    settings = ENABLED | {"stop_from_phone": enabled, "cycles": 100, "interval_cycles": 1000, "first_cycles": 100}
    with session(phone, seen.append) as (one, lab):
        one.run(RunRequest(Endurance(**settings), tmp_path, "T1"))
        assert one.finished.wait(120)
        driven = lab.control.history.cycles_until(math.inf)
        if enabled:
            assert "stop_from_phone" in one.outcome.reason
            assert driven == 0
        else:
            assert one.outcome.status is RunStatus.COMPLETED, one.outcome.reason
            assert phone._server is None
            assert any("is not enabled" in getattr(each, "text", "") for each in seen)
    assert not any(isinstance(each, StopOffered) for each in seen)
