"""The campaign that is open, and all that reads or writes its files: one after the other, beside the window."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from app.gui.widgets.background import BackgroundWorker
from app.session.session import SessionEvent

if TYPE_CHECKING:  # run files and numerics are imported where they are used: in the threads beside the window
    from app.campaign.campaign import Campaign
    from app.campaign.queue import CampaignRunner
    from app.campaign.summary import CampaignEstimates, CampaignSummary
    from drivers.bench.bench import Bench
    from model.amplifier_map import AmplifierMap
    from protocols.runner.request import RunRequest

MAX_RECENT = 8

OpenedCampaign = tuple["Campaign", "CampaignRunner", int]
"""A campaign, who carries it out, and when its file was last changed."""


class CampaignController(QObject):
    """Opens, changes and carries on one campaign.

    Args:
        bench: the present one, None while there is none; asked what is left for the rehearsal.
        amplifier: of the bench, for what the runs tell together.
    """

    changed = Signal()
    """`sheet`, `known` or `available` are others."""
    message = Signal(str)
    """Why something was not done."""
    run_requested = Signal(object)
    """A `RunRequest` that the session shall carry out now."""

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
        """The runs that `known` was made from."""
        self.summary: CampaignSummary | None = None
        self.estimates: CampaignEstimates | None = None
        self.available: tuple[Path, ...] = ()
        """Campaigns that could be opened, the likeliest first."""
        self.recent: list[Path] = []
        self.running_item = ""
        """The item whose run was begun here and goes on."""
        self.active_file: Path | None = None
        """The run file that this program is writing."""
        self.queue_active = False
        """Whether what needs no hands follows by itself."""

    @property
    def is_busy(self) -> bool:
        """Whether something is not back yet."""
        return bool(self._file_worker.pending or self._fit_worker.pending)

    def observe(self, event: SessionEvent) -> None:
        """Called in the bench thread with every event."""
        if (conductor := self._runner) is not None:
            conductor(event)

    # -- which campaign ------------------------------------------------------------------------------------------------

    def find_campaigns(self, folder: Path) -> None:
        """Look what could be opened: what was open last, and what lies in the folder."""

        def find() -> tuple[Path, ...]:
            from app.campaign.plan import list_campaigns

            found = [path for path in self.recent if path.is_file()] + list_campaigns(folder)
            return tuple(dict.fromkeys(path.absolute() for path in found))

        self._file_worker.submit(find, self._on_campaigns_found, self._on_error)

    def create(self, folder: Path, specimen: str, simulated: bool) -> None:
        """Begin a campaign: the paper's measurements in their order."""

        def begin() -> OpenedCampaign:
            from app.campaign.campaign import Campaign

            return _open_result(Campaign.create(folder, specimen, simulated))

        self._file_worker.submit(begin, self._on_opened, self._on_error)

    def open(self, path: Path) -> None:
        """Open a campaign's file."""
        writing = self.active_file

        def read() -> OpenedCampaign:
            from app.campaign.campaign import Campaign

            campaign = Campaign.open_file(path)
            if writing is not None:
                campaign.ignore_active_run(writing)
            return _open_result(campaign)

        self._file_worker.submit(read, self._on_opened, self._on_error)

    # -- what a person changes -----------------------------------------------------------------------------------------

    def refresh(self) -> None:
        """Read anew how everything stands."""
        self.modify(lambda _: None)

    def modify(self, action: Callable[[Campaign], object]) -> None:
        """Change the campaign, and read how it stands then."""
        if self._campaign is None:
            return

        def work() -> CampaignSummary:
            from app.campaign.summary import summarize_campaign

            campaign = self._current_campaign()
            action(campaign)
            self._stamp = campaign.path.stat().st_mtime_ns
            return summarize_campaign(campaign, self._bench())

        self._file_worker.submit(work, self._on_summary, self._on_error)

    # -- runs ----------------------------------------------------------------------------------------------------------

    def run(self, name: str = "", hands_free: bool = False, simulated: bool = True) -> None:
        """Begin the item that is named, or what comes next; `hands_free` goes on by itself with what needs no hands."""
        if self._campaign is None:
            return

        def work() -> RunRequest:
            from app.campaign.queue import check_bench_kind, first_item

            campaign = self._current_campaign()
            check_bench_kind(campaign, simulated)
            assert self._runner is not None
            return self._runner.prepare(first_item(campaign, name, hands_free))

        self.queue_active = hands_free
        self._file_worker.submit(work, self.run_requested.emit, self._on_error)

    def accept_run(self, request: RunRequest) -> CampaignRunner:
        """The session takes an order; the conductor that gives it."""
        assert self._runner is not None
        self.running_item = request.item
        self.changed.emit()
        return self._runner

    def halt_queue(self) -> None:
        """What goes on is the last one of the queue."""
        self.queue_active = False
        self.changed.emit()

    def run_ended(self, completed: bool) -> None:
        """No run goes on any more; `completed` where it was completed."""
        before, self.running_item = self.running_item, ""
        self.queue_active = self.queue_active and completed and bool(before)
        self.refresh()
        if self.queue_active:
            self._continue_queue(before)

    def shutdown(self) -> None:
        """End what works beside the window."""
        self._file_worker.close()
        self._fit_worker.close()

    # -- inside --------------------------------------------------------------------------------------------------------

    def _continue_queue(self, previous: str) -> None:
        def work() -> RunRequest | None:
            from app.campaign.queue import next_item_after

            campaign = self._current_campaign()
            line = next_item_after(campaign, campaign.item_state(previous), hands_free=True)
            assert self._runner is not None
            return None if line is None else self._runner.prepare(line)

        self._file_worker.submit(work, self._on_next_request, self._on_error)

    def _on_next_request(self, request: RunRequest | None) -> None:
        if request is not None and self.queue_active:
            self.run_requested.emit(request)
        else:
            self.halt_queue()

    def _current_campaign(self) -> Campaign:
        """The campaign; read anew where another program has changed its file."""
        campaign = self._campaign
        assert campaign is not None
        if not self.running_item and campaign.path.stat().st_mtime_ns != self._stamp:
            from app.campaign.campaign import Campaign
            from app.campaign.queue import CampaignRunner

            campaign = Campaign.open_file(campaign.path)
            self._campaign, self._runner = campaign, CampaignRunner(campaign)
        return campaign

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
        runs = tuple(row.state.run for row in summary.items if row.state.run is not None and row.state.estimates)
        if campaign is None or runs == self._fitted_runs:
            return
        self._fitted_runs = runs

        def fit() -> CampaignEstimates:
            from app.campaign.summary import estimate_campaign

            return estimate_campaign(campaign, self._amplifier)

        self._fit_worker.submit(fit, self._on_estimates, self._on_error, latest_only="fit")

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


def _open_result(campaign: Campaign) -> OpenedCampaign:
    from app.campaign.queue import CampaignRunner

    return campaign, CampaignRunner(campaign), campaign.path.stat().st_mtime_ns
