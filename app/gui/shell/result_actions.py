"""Actions of result cards that start no run: open, overlay, report, next item of the campaign."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from app.gui.results import ReportJob
from app.gui.shell.page_host import CAMPAIGN, EXPLORE, RUNS

if TYPE_CHECKING:
    from app.gui.shell.tabs import MainTabs


class ResultActions:
    """Shows a result on another page, or writes its report.

    Args:
        tabs: the pages.
        say: shows a message.
    """

    def __init__(self, tabs: MainTabs, say: Callable[[str], object]) -> None:
        self._tabs = tabs
        self._report_job = ReportJob(say, tabs)

    def perform(self, action: str, path: Path) -> None:
        """Carry out an action of a result card that starts no run."""
        if action == "open":
            self.open_run(path)
        elif action == "explore":
            self.overlay_runs([path])
        elif action == "next":
            self._tabs.setCurrentIndex(CAMPAIGN)
        elif action == "report":
            self._report_job.start_of(path)

    def open_run(self, path: Path) -> None:
        """Open a run on the Runs page."""
        self._tabs.setCurrentIndex(RUNS)
        self._tabs.runs.open_run(path)

    def choose_runs(self) -> None:
        """Show the list of runs, to choose those to lay over the model's curves."""
        self._tabs.setCurrentIndex(RUNS)
        self._tabs.runs.go_back()
        self._tabs.runs.details.show_message(
            "Select one or several runs, then press Explore (E): they are laid over the model's curves."
        )

    def overlay_runs(self, paths: Sequence[Path]) -> None:
        """Lay runs over the curves of the Explore page."""
        self._tabs.setCurrentIndex(EXPLORE)
        self._tabs.explore.overlaid.add(paths)

    def shutdown(self) -> None:
        """End a report that is being written."""
        self._report_job.shutdown()
