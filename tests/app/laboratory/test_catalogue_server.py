"""Catalogue of a folder over HTTP: what it shows and sends, that it never writes, and what it refuses, on real sockets."""

import csv
import http.client
import io
import re
import shutil
import signal
import socket
import subprocess
import sys
import threading
import zipfile
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack, closing
from pathlib import Path
from urllib.parse import quote
from xml.etree import ElementTree

import h5py
import openpyxl
import pytest
from pypdfium2 import PdfDocument

from app.archive import FORMATS
from app.common import usage_errors
from app.remote import CatalogueServer
from app.remote.web_server import MAX_WAITING, POOLS, ServerLimits
from app.report import ReportError, write_folder_report
from protocols.base import Outcome, RunStatus, Verdict, file_hash
from tests.helpers.messages import assert_names
from tests.helpers.report_specimen import DWELL, TRUTH
from tests.helpers.run_files import begun_run, finished_run, sine_point
from tests.helpers.simulated_bench import laboratory, run, simulated

TOKEN = "b" * 22
FREQUENCIES = (100.0, 140.0, 150.0, 160.0, 200.0)
HOSTILE = "<b>T9</b>"


def contents(folder: Path) -> Mapping[str, str]:
    return {str(path): file_hash(path) if path.is_file() else "" for path in sorted(folder.rglob("*"))}


def served_folder(folder: Path, limits: ServerLimits | None = None) -> CatalogueServer:
    """A server of a folder, as the command makes it."""
    return CatalogueServer(folder, usage_errors(ReportError)(write_folder_report), limits)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A folder that is the same after all tests of it: names and bytes."""
    runs = tmp_path_factory.mktemp("laboratory") / "runs"
    finished_run(runs, "T7", FREQUENCIES, verdict=Verdict(Outcome.GOOD, ()))
    finished_run(runs / "sub", HOSTILE, FREQUENCIES)
    damaged = finished_run(runs, "T8", FREQUENCIES)
    damaged.write_bytes(damaged.read_bytes()[:9000])
    secret = finished_run(runs.parent / "other", "secret", FREQUENCIES)
    (runs / secret.name).symlink_to(secret)
    (runs.parent / "password").write_text("secret")
    before = contents(runs)
    yield runs
    assert contents(runs) == before


@pytest.fixture(scope="module")
def server(folder: Path) -> Iterator[CatalogueServer]:
    served = served_folder(folder)
    served.start(TOKEN, 0)
    yield served
    served.stop()


def ask(server: CatalogueServer, path: str, token: str = TOKEN, **headers: str) -> tuple[int, Mapping[str, str], bytes]:
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=200)) as connection:
        connection.request("GET", path, headers=({"Authorization": f"Bearer {token}"} if token else {}) | headers)
        answer = connection.getresponse()
        found = {name.lower(): value for name, value in answer.getheaders()}
        assert len(found) == len(answer.getheaders())  # none is sent twice
        return answer.status, found, answer.read()


def page(server: CatalogueServer, path: str) -> str:
    status, _, body = ask(server, path)
    assert status == 200
    return body.decode()


def shown_and_all(text: str) -> tuple[int, int]:
    """How many runs a list shows, of how many."""
    found = re.search(r"(\d+) of (\d+) ", text)
    assert found is not None
    return int(found[1]), int(found[2])


def path_of(folder: Path, specimen: str) -> str:
    return quote(next(path.relative_to(folder).as_posix() for path in folder.rglob(f"*{specimen}*.h5")))


def test_the_list_has_every_run_of_the_folder_with_its_picture(server: CatalogueServer) -> None:
    listed = page(server, "/")
    assert shown_and_all(listed) == (3, 3)  # without the one behind a link
    assert "secret" not in listed
    assert listed.count("SIMULATED") == 2
    assert "damaged" in listed
    pictures = re.findall(r'polyline points="([^"]*)"', listed)
    assert sorted(len(each.split()) for each in pictures) == [0, len(FREQUENCIES), len(FREQUENCIES)]
    assert HOSTILE not in listed
    assert "&lt;b&gt;T9&lt;/b&gt;" in listed


@pytest.mark.parametrize(
    ("query", "count"), [("T7", 1), ("specimen:T7 verdict:good", 1), ("verdict:unsafe", 0), ("damag", 1)]
)
def test_it_is_searched_as_the_command_searches(server: CatalogueServer, query: str, count: int) -> None:
    assert shown_and_all(page(server, f"/?q={quote(query)}")) == (count, 3)
    status, _, body = ask(server, "/?q=colour:red")
    assert status == 422
    assert_names(body.decode(), "colour", "specimen")


def test_a_run_has_its_verdict_figures_and_plot(server: CatalogueServer, folder: Path) -> None:
    shown = page(server, f"/run/{path_of(folder, 'T7')}")
    assert "✓ good" in shown
    assert "158.350 ± 0.010 Hz" in shown
    assert shown.count("SIMULATED") >= 3
    _, headers, drawing = ask(server, f"/plot/{path_of(folder, 'T7')}")
    assert headers["content-type"] == "image/svg+xml"
    assert "sandbox" in headers["content-security-policy"]
    root = ElementTree.fromstring(drawing)
    assert root.tag.endswith("svg")
    assert "SIMULATED" in drawing.decode()


@pytest.mark.deep
def test_a_run_leaves_in_every_format(server: CatalogueServer, folder: Path) -> None:
    run = path_of(folder, "T7")
    files: dict[str, bytes] = {}
    for kind in FORMATS:
        status, headers, files[kind] = ask(server, f"/export/{kind}/{run}")
        assert (status, len(files[kind]) > 500) == (200, True)
        assert "SIMULATED" in headers["content-disposition"]
    with zipfile.ZipFile(io.BytesIO(files["csv"])) as packed:
        name = next(each for each in packed.namelist() if each.endswith("_points.csv"))
        rows = list(csv.DictReader(io.StringIO(packed.read(name).decode("utf-8-sig"))))
    frequencies = [float(row["frequency [Hz]"]) for row in rows]
    assert frequencies == list(FREQUENCIES)
    assert "points" in openpyxl.load_workbook(io.BytesIO(files["xlsx"])).sheetnames
    _, _, copy = ask(server, f"/file/{run}")
    with h5py.File(io.BytesIO(copy)) as opened:
        assert list(opened["entry/points/frequency"][:]) == list(FREQUENCIES)


@pytest.mark.deep
def test_the_report_of_a_specimen_is_sent_and_runs_nothing(tmp_path: Path) -> None:
    with laboratory(simulated(tactor={"mu": TRUTH.mu, "c0": TRUTH.c0})) as lab:
        run(DWELL, tmp_path, lab)
    server = served_folder(tmp_path)
    server.start(TOKEN, 0)
    with closing(server_end(server)):
        status, headers, body = ask(server, "/report/html/T1")
        assert status == 200
        assert "<h1>Specimen T1</h1>" in body.decode()
        assert "SIMULATED" in body.decode()
        assert "sandbox" in headers["content-security-policy"]
        with PdfDocument(ask(server, "/report/pdf/T1")[2]) as document:
            assert len(document) == 2
        status, _, body = ask(server, "/report/html/T99")
        assert status == 422
        assert_names(body.decode(), "T99")


def test_a_damaged_file_is_told_and_the_others_are_served(server: CatalogueServer, folder: Path) -> None:
    run = path_of(folder, "T8")
    assert_names(page(server, f"/run/{run}"), 9000)
    for kind in ("plot", "export/csv"):
        status, _, body = ask(server, f"/{kind}/{run}")
        assert status == 422
        assert_names(body.decode(), 9000)
        assert str(folder) not in body.decode()
    assert ask(server, f"/file/{run}")[0] == 200
    assert ask(server, f"/plot/{path_of(folder, 'T7')}")[0] == 200


@pytest.mark.parametrize("kind", ["run", "plot", "file", "export/csv", "report/pdf"])
def test_nothing_outside_the_folder_is_reached(server: CatalogueServer, folder: Path, kind: str) -> None:
    outside = next((folder.parent / "other").glob("*.h5"))
    for attempt in (
        "../password", "..%2fpassword", "%2e%2e/password", "..%5cpassword", "sub/../../password", f"{folder.parent}/password",
        f"//{folder.parent}/password", "%00", "sub/", "", outside.name, f"../other/{outside.name}", "password%00.h5",
    ):  # fmt: skip
        status, _, body = ask(server, f"/{kind}/{attempt}")
        assert status in (400, 404, 422)
        assert body.strip() != b"secret"
        assert b"HDF" not in body
    assert ask(server, "/catalogue.html")[0] == 404
    assert ask(server, "/../server.py")[0] == 404


def test_only_the_token_opens_a_page_with_data(server: CatalogueServer, folder: Path) -> None:
    run = path_of(folder, "T7")
    for path in (
        "/",
        f"/run/{run}",
        f"/plot/{run}",
        f"/file/{run}",
        f"/export/csv/{run}",
        "/report/html/T7",
        "/session",
    ):
        for token in ("", "wrong", f"{TOKEN}x", TOKEN[:-1]):
            status, headers, body = ask(server, f"{path}?token={TOKEN}", token)
            assert status == 401
            assert "set-cookie" not in headers
            assert headers["www-authenticate"] == 'Bearer realm="Tactor Bench"'
            assert b"T7" not in body
    assert ask(server, "/page.css", "")[0] == 200  # as the page of a running bench, without data
    _, headers, _ = ask(server, "/session")
    cookie = headers["set-cookie"].partition(";")[0]
    assert {"HttpOnly", "SameSite=Strict"} <= set(headers["set-cookie"].replace(";", "").split())
    assert ask(server, f"/plot/{run}", "", Cookie=cookie)[0] == 200
    assert ask(server, f"/plot/{run}", "", Cookie=cookie[:-1])[0] == 401
    assert TOKEN in server.url
    assert server.url.startswith("http://127.0.0.1:")


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH", "OPTIONS"])
def test_no_method_changes_anything(server: CatalogueServer, method: str) -> None:
    with closing(http.client.HTTPConnection("127.0.0.1", server.port, timeout=30)) as connection:
        connection.request(method, "/", headers={"Authorization": f"Bearer {TOKEN}"})
        assert connection.getresponse().status == 405


def dripping(port: int, stack: ExitStack) -> socket.socket:
    """A connection that has sent a part of its request."""
    slow = stack.enter_context(socket.create_connection(("127.0.0.1", port), timeout=60))
    slow.sendall(b"GET / HTTP/1.1\r\nX-Slow: ")
    return slow


def test_sixteen_slow_clients_do_not_block_many_fast_ones(folder: Path) -> None:
    server = served_folder(folder, ServerLimits(request_s=600.0, total_s=600.0))
    server.start(TOKEN, 0)
    with closing(server_end(server)), ExitStack() as stack:
        slow = [dripping(server.port, stack) for _ in range(16)]

        def fast(_: int) -> int:
            for each in slow:
                each.send(b"x")
            return ask(server, "/?q=T7")[0]

        with ThreadPoolExecutor(8) as pool:
            assert list(pool.map(fast, range(200))) == [200] * 200
        for each in slow:  # they are still open, and are answered in the end
            each.sendall(f"\r\nAuthorization: Bearer {TOKEN}\r\nHost: x\r\n\r\n".encode())
            assert each.recv(12) == b"HTTP/1.1 200"


class server_end:  # noqa: N801 - used like a function
    """Closes a server."""

    def __init__(self, server: CatalogueServer) -> None:
        self.close = server.stop


def send_for_ever(connection: socket.socket) -> None:
    while True:
        connection.sendall(b"x")
        threading.Event().wait(0.02)


@pytest.mark.parametrize("reads", [False, True], ids=["sends slowly", "reads slowly"])
def test_a_connection_ends_after_its_total_time_whatever_it_does(folder: Path, reads: bool) -> None:
    big = folder.parent / f"big{reads}"
    run = finished_run(big, "T7", FREQUENCIES)
    with run.open("ab") as file:
        file.truncate(200_000_000)  # more than the buffers of a connection
    server = served_folder(big, ServerLimits(total_s=0.5) if reads else ServerLimits(request_s=0.5))
    server.start(TOKEN, 0)
    with closing(server_end(server)), socket.create_connection(("127.0.0.1", server.port), timeout=60) as slow:
        request = f"GET /file/{run.name} HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode()
        slow.sendall(request if reads else request[:30])
        with pytest.raises((ConnectionResetError, BrokenPipeError)):
            send_for_ever(slow)


def test_the_connections_of_an_address_are_bounded(folder: Path) -> None:
    server = served_folder(folder, ServerLimits(request_s=600.0, total_s=600.0, per_address=8))
    server.start(TOKEN, 0)
    with closing(server_end(server)), ExitStack() as stack:
        for _ in range(8):
            dripping(server.port, stack)
        with socket.create_connection(("127.0.0.1", server.port), timeout=60) as ninth:
            assert ninth.recv(1) == b""
        if sys.platform == "linux":  # all of 127.0.0.0/8 is this computer
            with socket.create_connection(("127.0.0.1", server.port), 60, ("127.0.0.2", 0)) as other:
                other.sendall(f"GET / HTTP/1.1\r\nHost: x\r\nAuthorization: Bearer {TOKEN}\r\n\r\n".encode())
                assert other.recv(12) == b"HTTP/1.1 200"


@pytest.mark.deep
def test_a_run_that_is_being_written_is_shown_and_not_disturbed(tmp_path: Path) -> None:
    file = begun_run(tmp_path, "T7", FREQUENCIES, 5000.0)
    file.append_point(sine_point(FREQUENCIES[0]))
    file.append_point(sine_point(FREQUENCIES[1]))
    server = served_folder(tmp_path)
    server.start(TOKEN, 0)
    with closing(server_end(server)):
        name = file.path.name
        assert "running" in page(server, "/")
        assert "running" in page(server, f"/run/{name}")
        assert ask(server, f"/plot/{name}")[0] == 200
        status, _, body = ask(server, f"/file/{name}")
        assert status == 422
        assert_names(body.decode(), name)
        with ThreadPoolExecutor(4) as pool:
            answers = pool.map(lambda kind: ask(server, f"/export/{kind}/{name}")[0], ("csv", "json", "mat", "xlsx"))
            for f in FREQUENCIES[2:]:
                file.append_point(sine_point(f))
            assert list(answers) == [200] * 4
        file.finish(RunStatus.COMPLETED, "all points measured", (), verdict=Verdict(Outcome.GOOD, ()))
        assert len(list(tmp_path.glob("*.h5"))) == 1
        assert {path.suffix for path in tmp_path.iterdir()} <= {".h5", ".json"}
    again = served_folder(tmp_path)
    again.start(TOKEN, 0)
    with closing(server_end(again)):
        assert "✓ good" in page(again, "/")
        _, _, copy = ask(again, f"/file/{name}")
    with h5py.File(io.BytesIO(copy)) as opened:
        assert list(opened["entry/points/frequency"][:]) == list(FREQUENCIES)


def test_requests_that_would_wait_too_long_are_refused(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server, go_on, entered = (
        served_folder(folder, ServerLimits(per_address=100)),
        threading.Event(),
        threading.Semaphore(0),
    )

    def held(*_: object) -> bytes:
        entered.release()
        go_on.wait()
        return b"<svg/>"

    monkeypatch.setattr("app.remote.catalogue.RunFolder.plot", held)
    server.start(TOKEN, 0)
    run, most = path_of(folder, "T7"), POOLS["drawings"] + MAX_WAITING
    with closing(server_end(server)), ThreadPoolExecutor(most + 8) as pool:
        answers = [pool.submit(ask, server, f"/plot/{run}") for _ in range(most + 8)]
        entered.acquire()
        while sum(each.done() for each in answers) < 8:
            threading.Event().wait(0.01)
        assert shown_and_all(page(server, "/")) == (3, 3)  # a list does not wait for drawings
        go_on.set()
        assert sorted(each.result()[0] for each in answers) == [200] * most + [503] * 8


@pytest.fixture
def seen_in_browser(tmp_path: Path) -> Callable[[str], str]:
    """Opens an address in a headless browser with a new profile, and returns the page that its scripts end with."""
    names = ("chromium", "chromium-browser", "google-chrome", "chrome", "msedge")
    browser = next((found for name in names if (found := shutil.which(name))), None)
    if browser is None:
        pytest.skip(f"no browser is installed: {', '.join(names)}")

    def seen(url: str) -> str:
        options = (
            f"--user-data-dir={tmp_path / 'profile'}",
            "--no-sandbox",
            "--disable-gpu",
            "--virtual-time-budget=20000",
        )
        logged = ("--enable-logging=stderr", "--v=0")
        command = [browser, "--headless=new", *options, *logged, "--dump-dom", url]
        done = subprocess.run(command, capture_output=True, text=True, encoding="utf-8", timeout=300, check=True)
        assert "Content Security Policy" not in done.stderr
        return done.stdout

    return seen


@pytest.mark.deep
@pytest.mark.timeout(900)
def test_a_browser_shows_the_catalogue_among_slow_clients_and_nothing_without_its_token(
    folder: Path, seen_in_browser: Callable[[str], str]
) -> None:
    server, run = served_folder(folder), path_of(folder, "T7")
    server.start(TOKEN, 0)
    here = f"http://127.0.0.1:{server.port}"
    with closing(server_end(server)), ExitStack() as stack:
        slow = [dripping(server.port, stack) for _ in range(16)]
        listed = seen_in_browser(server.url)
        assert shown_and_all(listed) == (3, 3)
        assert TOKEN not in listed
        assert "&lt;b&gt;T9&lt;/b&gt;" in listed
        assert "158.350 ± 0.010 Hz" in seen_in_browser(f"{here}/run/{run}#{TOKEN}")
        for path in ("/", f"/run/{run}"):
            refused = seen_in_browser(f"{here}{path}#{TOKEN[:-1]}")
            assert 'id="trouble"' in refused
            assert "T7" not in refused
        for path in ("/file/%2e%2e/password", "/file/..%2fpassword", "/run/%2e%2e%2fother"):
            shown = seen_in_browser(f"{here}{path}#{TOKEN}")
            assert "secret" not in shown
            assert "<li>" not in shown
        assert len(slow) == 16


@pytest.mark.deep
@pytest.mark.skipif(sys.platform == "win32", reason="Ctrl-C is another signal there")
def test_the_command_prints_the_address_and_ends_by_ctrl_c(folder: Path) -> None:
    heeds = "import signal; signal.signal(signal.SIGINT, signal.default_int_handler)"  # a background shell ignores it
    command = [
        sys.executable,
        "-c",
        f"{heeds}; from app.cli.main import entry; entry()",
        "serve",
        str(folder),
        "--port",
        "0",
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout is not None
    address = process.stdout.readline().strip()
    found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/#([\w-]{22})", address)
    assert found is not None
    with closing(http.client.HTTPConnection("127.0.0.1", int(found[1]), timeout=60)) as connection:
        connection.request("GET", "/", headers={"Authorization": f"Bearer {found[2]}"})
        assert shown_and_all(connection.getresponse().read().decode()) == (3, 3)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0
    assert "network" not in said


@pytest.mark.parametrize(
    ("options", "named"),
    [(["--token", "short"], "16"), (["--port", "70000"], "65535"), (["--address", "192.0.2.1"], "192.0.2.1")],
)
def test_a_wrong_option_is_one_sentence(
    folder: Path, options: list[str], named: str, capsys: pytest.CaptureFixture[str]
) -> None:
    from app.cli.main import main

    assert main(["serve", str(folder), "--port", "0", *options]) == 2
    said = capsys.readouterr().err
    assert_names(said, named)
    assert said.count("\n") == 1
