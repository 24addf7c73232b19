"""Specimen and runs of the visible page: for its sheet, its identification and the web page."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from app.gui.shell.page_host import CAMPAIGN, EXPLORE

if TYPE_CHECKING:
    from app.gui.campaign import CampaignController
    from app.gui.shell.tabs import MainTabs
    from app.gui.specimen import IdentificationSubject


class VisibleSubject:
    """Reads the specimen of the visible page: the open campaign's, or the Measure page's."""

    def __init__(self, tabs: MainTabs) -> None:
        self._tabs = tabs

    @property
    def specimen(self) -> tuple[Path, str]:
        """Folder and name of the specimen that the visible page is about."""
        return (
            self.specimen_of(self._tabs.campaign.controller)
            if self._shows(CAMPAIGN)
            else (self._tabs.folder, self._tabs.specimen)
        )

    def describe_next(self) -> tuple[str, str]:
        """Return the specimen of the visible page, and the next step of the open campaign as text."""
        step = self._tabs.campaign.board.step if CAMPAIGN in self._tabs.created_pages else None
        return self.specimen[1], "" if step is None else step.heading

    @property
    def identification(self) -> IdentificationSubject:
        """What is identified from the visible page: overlaid runs, those that count in the campaign, or all of the specimen."""
        from app.gui.specimen import IdentificationSubject

        folder, specimen = self.specimen
        runs: tuple[Path, ...] = ()
        if self._shows(EXPLORE):
            runs = tuple(run.path for run in self._tabs.explore.overlaid.runs)
        elif self._shows(CAMPAIGN):
            runs = self._tabs.campaign.controller.counting_runs
        return IdentificationSubject(runs[0].parent if runs else folder, specimen, runs)

    def specimen_of(self, controller: CampaignController) -> tuple[Path, str]:
        """Return folder and specimen of the open campaign; of the Measure page without one."""
        summary = controller.summary
        return (self._tabs.folder, self._tabs.specimen) if summary is None else (summary.path.parent, summary.specimen)

    def _shows(self, index: int) -> bool:
        """Whether a page is created and visible."""
        return self._tabs.currentIndex() == index and index in self._tabs.created_pages
