"""Controller of the open campaign: file access, queue and fits in background threads."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

import app.campaign as campaigns
from app.gui.widgets import BackgroundWorker
from app.session import SessionEvent

if TYPE_CHECKING:  # slow to import: run files and numerics are imported in the background threads that use them
    from app.campaign import Campaign, CampaignEstimates, CampaignRunner, CampaignSummary, ItemState
    from drivers import Bench
    from model import AmplifierMap
    from protocols.runner import RunRequest

MAX_RECENT = 8

OpenedCampaign = tuple["Campaign", "CampaignRunner", int]
"""A campaign, its runner, and the time of its file's last change."""


class CampaignController(QObject):
    """Opens, modifies and runs one campaign.

    Args:
        bench: the connected bench or None; used to estimate the remaining time.
        amplifier: of the bench, for the estimates from all runs.
    """

    changed = Signal()
    """Emitted when `summary`, `estimates` or `available` have changed."""
    message = Signal(str)
    """Why something was not done."""
    reviewed = Signal(object)
    """A `ResultReview` that was requested."""
    modified = Signal(str)
    """Description of the change, where `modify` was given one."""
    run_requested = Signal(object)
    """A `RunRequest` for the session."""

    def __init__(
        self, bench: Callable[[], Bench | None], amplifier: AmplifierMap, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._bench, self._amplifier = bench, amplifier
        self._file_worker, self._fit_worker = BackgroundWorker("campaign", self), BackgroundWorker("campaign fit", self)
        self._campaign: Campaign | None = None
        self._runner: CampaignRunner | None = None
        self._stamp = 0
        self._fitted_runs: tuple[Path, ...] | None = None
        """The runs of `estimates`."""
        self.summary: CampaignSummary | None = None
        self.estimates: CampaignEstimates | None = None
        self.available: tuple[Path, ...] = ()
        """Campaigns that can be opened, the most recent first."""
        self.recent: list[Path] = []
        self.running_item = ""
        """Name of the item whose run was started here and is active."""
        self.active_file: Path | None = None
        """The run file that this program is writing."""
        self.queue_active = False
        """Whether items that need no operator are started one after the other."""

    @property
    def counting_runs(self) -> tuple[Path, ...]:
        """The runs of the open campaign that count."""
        rows = () if self.summary is None else self.summary.items
        return tuple(row.state.run for row in rows if row.state.run is not None and row.state.estimates)

    def observe(self, event: SessionEvent) -> None:
        """Forward a session event to the campaign's runner; called in the bench thread."""
        if (conductor := self._runner) is not None:
            conductor(event)

    # -- which campaign ------------------------------------------------------------------------------------------------

    def find_campaigns(self, folder: Path) -> None:
        """List recent campaigns and the campaigns of the folder."""

        def find() -> tuple[Path, ...]:
            paths = [path for path in self.recent if path.is_file()] + campaigns.list_campaigns(folder)
            return tuple(dict.fromkeys(path.absolute() for path in paths))

        self._file_worker.submit(find, self._on_campaigns_found, self._on_error)

    def create(self, folder: Path, specimen: str, simulated: bool) -> None:
        """Create a campaign with the paper's measurements in their order."""
        self._open(lambda: campaigns.Campaign.create(folder, specimen, simulated))

    def open(self, path: Path) -> None:
        """Open a campaign's file."""
        writing = self.active_file

        def read() -> Campaign:
            campaign = campaigns.Campaign.open_file(path)
            if writing is not None:
                campaign.run_started(writing)
            return campaign

        self._open(read)

    # -- changes -----------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Read the status of every item again."""
        self.modify(lambda _: None)

    def modify(self, action: Callable[[Campaign], object], done: str = "") -> None:
        """Apply a change to the campaign and refresh; `done` is the message afterwards."""
        if self._campaign is None:
            return

        def work() -> CampaignSummary:
            campaign = self._current_campaign()
            action(campaign)
            self._stamp = campaign.path.stat().st_mtime_ns
            return campaigns.summarize_campaign(campaign, self._bench())

        def show(summary: CampaignSummary) -> None:
            self._on_summary(summary)
            if done:
                self.modified.emit(done)

        self._file_worker.submit(work, show, self._on_error)

    def undo(self, forward: bool = False) -> None:
        """Undo the last change of the plan, or redo an undone one."""
        self.modify(
            lambda campaign: campaign.redo() if forward else campaign.undo(), "Done again" if forward else "Undone"
        )

    def review(self, path: Path, before: Path | None) -> None:
        """Read a run with all that it is compared with."""
        self._fit_worker.submit(
            lambda: campaigns.review_run(path, before, self._amplifier),
            self.reviewed.emit,
            self._on_error,
            latest_only="review",
        )

    # -- runs ----------------------------------------------------------------------------------------------------------

    def run(self, name: str = "", hands_free: bool = False, simulated: bool = True) -> None:
        """Start the named item or the next one; `hands_free` continues with items that need no operator."""
        if self._campaign is None:
            return

        def choose(campaign: Campaign) -> ItemState:
            campaigns.check_bench_kind(campaign, simulated)
            return campaigns.first_item(campaign, name, hands_free)

        self.queue_active = hands_free
        self._prepare(choose, self._request_run)

    def accept_run(self, request: RunRequest) -> CampaignRunner:
        """Note that a run of the campaign starts, and return the runner that submits it."""
        assert self._runner is not None
        self.running_item = request.item
        self.changed.emit()
        return self._runner

    def halt_queue(self) -> None:
        """Start no further item after the present run."""
        self.queue_active = False
        self.changed.emit()

    def run_ended(self, has_result: bool) -> None:
        """Refresh after a run, and continue the queue if it has a result."""
        before, self.running_item = self.running_item, ""
        queued, self.queue_active = self.queue_active, self.queue_active and has_result and bool(before)
        self.refresh()
        if self.queue_active:
            self._prepare(
                lambda campaign: campaigns.next_item_after(campaign, campaign.item_state(before), hands_free=True),
                self._continue_queue,
            )
        elif has_result and before and not queued:  # a series continues with a value that was never measured
            self._prepare(lambda campaign: campaigns.next_value(campaign.item_state(before)), self._request_run)

    # -- inside --------------------------------------------------------------------------------------------------------

    def _prepare(
        self, choose: Callable[[Campaign], ItemState | None], submit: Callable[[RunRequest | None], object]
    ) -> None:
        """Choose an item and prepare its run in the background."""

        def work() -> RunRequest | None:
            state = choose(self._current_campaign())
            assert self._runner is not None
            return None if state is None else self._runner.prepare(state)

        self._file_worker.submit(work, submit, self._on_error)

    def _request_run(self, request: RunRequest | None) -> None:
        if request is not None:
            self.run_requested.emit(request)

    def _continue_queue(self, request: RunRequest | None) -> None:
        if request is not None and self.queue_active:
            self.run_requested.emit(request)
        else:
            self.halt_queue()

    def _current_campaign(self) -> Campaign:
        """Return the campaign, read again if another program has changed its file."""
        campaign = self._campaign
        assert campaign is not None
        if not self.running_item and campaign.path.stat().st_mtime_ns != self._stamp:
            campaign = campaigns.Campaign.open_file(campaign.path)
            self._campaign, self._runner = campaign, campaigns.CampaignRunner(campaign)
        return campaign

    def _open(self, find: Callable[[], Campaign]) -> None:
        """Open a campaign in the background."""

        def work() -> OpenedCampaign:
            campaign = find()
            return campaign, campaigns.CampaignRunner(campaign), campaign.path.stat().st_mtime_ns

        self._file_worker.submit(work, self._on_opened, self._on_error)

    def _on_opened(self, opened: OpenedCampaign) -> None:
        campaign, self._runner, self._stamp = opened
        self._campaign = campaign
        self.estimates = self._fitted_runs = None
        path = campaign.path.absolute()
        self.recent = [path, *(other for other in self.recent if other != path)][:MAX_RECENT]
        self.refresh()

    def _on_summary(self, summary: CampaignSummary) -> None:
        self.summary = summary
        self.changed.emit()
        campaign = self._campaign
        runs = self.counting_runs
        if campaign is None or runs == self._fitted_runs:
            return
        self._fitted_runs = runs
        self._fit_worker.submit(
            lambda: campaigns.estimate_campaign(campaign, self._amplifier),
            self._on_estimates,
            self._on_error,
            latest_only="fit",
        )

    def _on_estimates(self, estimates: CampaignEstimates) -> None:
        self.estimates = estimates
        self.changed.emit()

    def _on_campaigns_found(self, paths: tuple[Path, ...]) -> None:
        self.available = paths
        self.changed.emit()

    def _on_error(self, error: Exception) -> None:
        self.queue_active = False
        self.message.emit(str(error))
        self.changed.emit()
