"""The command `serve`: a folder of runs as read-only pages for the browsers of colleagues."""

import threading
from contextlib import suppress
from pathlib import Path
from secrets import token_urlsafe

from app.cli.options import argument, command, option
from app.cli.runs import check_folder, scanned_catalogue
from app.common import ExitCode, UsageError, print_line, print_message, usage_errors

DEFAULT_PORT, TOKEN_BYTES = 8463, 16
THIS_COMPUTER = ("127.0.0.1", "::1", "localhost")
HIGHEST_PORT = 65_535


@command("example: tactor-bench serve runs --address 0.0.0.0")
class ServeCommand:
    """Serve the runs of a folder to browsers until Ctrl-C: list with thumbnails, search (the words and fields of 'runs --search'),
    plot, figures and verdict of a run, downloads in every export format, reports. Nothing is written into the folder. Only the
    printed address, with its token, is answered; without --address only browsers of this computer reach it.
    """

    folder: Path = argument("(default: runs)", Path("runs"), nargs="?")
    address: str = option("address of this computer to serve; 0.0.0.0: every one (default: 127.0.0.1)", "127.0.0.1")
    port: int = option(f"(default: {DEFAULT_PORT}; 0: a free one)", DEFAULT_PORT)
    token: str = option("token of the address, at least 16 characters (default: a new one at each start)")

    def execute(self) -> int:
        from app.cli.headless import load_all_protocols
        from app.remote import CatalogueServer, WebServerError
        from app.report import LimitsError, ReportError, write_folder_report

        check_folder(self.folder)
        if not 0 <= self.port <= HIGHEST_PORT:
            raise UsageError(f"--port {self.port} is no port; give 0 to {HIGHEST_PORT}")
        load_all_protocols()
        with scanned_catalogue(self.folder):
            pass
        server = CatalogueServer(self.folder, usage_errors(ReportError, LimitsError)(write_folder_report))
        with usage_errors(WebServerError):
            server.start(self.token or token_urlsafe(TOKEN_BYTES), self.port, self.address)
        print_line(server.url)
        if self.address not in THIS_COMPUTER:
            print_message(
                "every computer that reaches this address and has the token can read these runs, and the connection is not encrypted: "
                "use it in the laboratory's own network only"
            )
        print_message("read-only; Ctrl-C ends it")
        try:
            with suppress(KeyboardInterrupt):
                threading.Event().wait()
        finally:
            server.stop()
        return ExitCode.DONE
