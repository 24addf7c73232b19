"""The campaign that is open, and all that reads or writes its files: one after the other, beside the window."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

from PySide6.QtCore import QObject, Signal

from app.gui.widgets.background import Jobs
from app.session.session import SessionEvent

if TYPE_CHECKING:  # run files and numerics are imported where they are used: in the threads beside the window
    from app.campaign.campaign import Campaign
    from app.campaign.queue import Conductor, Order
    from app.campaign.summary import Known, Sheet
    from drivers.bench.bench import Bench
    from model.amplifier_map import AmplifierMap

MOST_RECENT = 8

Opened = tuple["Campaign", "Conductor", int]
"""A campaign, who carries it out, and when its file was last changed."""


class CampaignDesk(QObject):
    """Opens, changes and carries on one campaign.

    Args:
        bench: the present one, None while there is none; asked what is left for the rehearsal.
        amplifier: of the bench, for what the runs tell together.
    """

    changed = Signal()
    """`sheet`, `known` or `offered` are others."""
    said = Signal(str)
    """Why something was not done."""
    ordered = Signal(object)
    """An `Order` that the session shall carry out now."""

    def __init__(
        self, bench: Callable[[], Bench | None], amplifier: AmplifierMap, parent: QObject | None = None
    ) -> None:
        super().__init__(parent)
        self._bench, self._amplifier = bench, amplifier
        self._jobs, self._fits = Jobs("campaign", self), Jobs("campaign fit", self)
        self._campaign: Campaign | None = None
        self._conductor: Conductor | None = None
        self._stamp = 0
        self._told: tuple[Path, ...] | None = None
        """The runs that `known` was made from."""
        self.sheet: Sheet | None = None
        self.known: Known | None = None
        self.offered: tuple[Path, ...] = ()
        """Campaigns that could be opened, the likeliest first."""
        self.recent: list[Path] = []
        self.running = ""
        """The item whose run was begun here and goes on."""
        self.writing: Path | None = None
        """The run file that this program is writing."""
        self.queue = False
        """Whether what needs no hands follows by itself."""

    @property
    def working(self) -> bool:
        """Whether something is not back yet."""
        return bool(self._jobs.waiting or self._fits.waiting)

    def hear(self, event: SessionEvent) -> None:
        """Called in the bench thread with every event."""
        if (conductor := self._conductor) is not None:
            conductor(event)

    # -- which campaign ------------------------------------------------------------------------------------------------

    def offer(self, folder: Path) -> None:
        """Look what could be opened: what was open last, and what lies in the folder."""

        def find() -> tuple[Path, ...]:
            from app.campaign.plan import campaigns_in

            found = [path for path in self.recent if path.is_file()] + campaigns_in(folder)
            return tuple(dict.fromkeys(path.absolute() for path in found))

        self._jobs.do(find, self._offered, self._failed)

    def new(self, folder: Path, specimen: str, simulated: bool) -> None:
        """Begin a campaign: the paper's measurements in their order."""

        def begin() -> Opened:
            from app.campaign.campaign import Campaign

            return _opened(Campaign.new(folder, specimen, simulated))

        self._jobs.do(begin, self._opened, self._failed)

    def open(self, path: Path) -> None:
        """Open a campaign's file."""
        writing = self.writing

        def read() -> Opened:
            from app.campaign.campaign import Campaign

            campaign = Campaign.at(path)
            if writing is not None:
                campaign.leave(writing)
            return _opened(campaign)

        self._jobs.do(read, self._opened, self._failed)

    # -- what a person changes -----------------------------------------------------------------------------------------

    def look(self) -> None:
        """Read anew how everything stands."""
        self.change(lambda _: None)

    def change(self, do: Callable[[Campaign], object]) -> None:
        """Change the campaign, and read how it stands then."""
        if self._campaign is None:
            return

        def work() -> Sheet:
            from app.campaign.summary import sheet_of

            campaign = self._fresh()
            do(campaign)
            self._stamp = campaign.path.stat().st_mtime_ns
            return sheet_of(campaign, self._bench())

        self._jobs.do(work, self._read, self._failed)

    # -- runs ----------------------------------------------------------------------------------------------------------

    def run(self, name: str = "", hands_free: bool = False, simulated: bool = True) -> None:
        """Begin the item that is named, or what comes next; `hands_free` goes on by itself with what needs no hands."""
        if self._campaign is None:
            return

        def work() -> Order:
            from app.campaign.queue import first, of_this_bench

            campaign = self._fresh()
            of_this_bench(campaign, simulated)
            assert self._conductor is not None
            return self._conductor.order(first(campaign, name, hands_free))

        self.queue = hands_free
        self._jobs.do(work, self.ordered.emit, self._failed)

    def begun(self, order: Order) -> Conductor:
        """The session takes an order; the conductor that gives it."""
        assert self._conductor is not None
        self.running = order.line.item.name
        self.changed.emit()
        return self._conductor

    def halt(self) -> None:
        """What goes on is the last one of the queue."""
        self.queue = False
        self.changed.emit()

    def ended(self, well: bool) -> None:
        """No run goes on any more; `well` where it was completed."""
        before, self.running = self.running, ""
        self.queue = self.queue and well and bool(before)
        self.look()
        if self.queue:
            self._go_on(before)

    def end(self) -> None:
        """End what works beside the window."""
        self._jobs.close()
        self._fits.close()

    # -- inside --------------------------------------------------------------------------------------------------------

    def _go_on(self, before: str) -> None:
        def work() -> Order | None:
            from app.campaign.queue import following

            campaign = self._fresh()
            line = following(campaign, campaign.line(before), hands_free=True)
            assert self._conductor is not None
            return None if line is None else self._conductor.order(line)

        self._jobs.do(work, self._next, self._failed)

    def _next(self, order: Order | None) -> None:
        if order is not None and self.queue:
            self.ordered.emit(order)
        else:
            self.halt()

    def _fresh(self) -> Campaign:
        """The campaign; read anew where another program has changed its file."""
        campaign = self._campaign
        assert campaign is not None
        if not self.running and campaign.path.stat().st_mtime_ns != self._stamp:
            from app.campaign.campaign import Campaign
            from app.campaign.queue import Conductor

            campaign = Campaign.at(campaign.path)
            self._campaign, self._conductor = campaign, Conductor(campaign)
        return campaign

    def _opened(self, opened: Opened) -> None:
        campaign, self._conductor, self._stamp = opened
        self._campaign = campaign
        self.known = self._told = None
        path = campaign.path.absolute()
        self.recent = [path, *(other for other in self.recent if other != path)][:MOST_RECENT]
        self.look()

    def _read(self, sheet: Sheet) -> None:
        self.sheet = sheet
        self.changed.emit()
        campaign = self._campaign
        runs = tuple(row.line.run for row in sheet.rows if row.line.run is not None and row.line.estimates)
        if campaign is None or runs == self._told:
            return
        self._told = runs

        def fit() -> Known:
            from app.campaign.summary import known_of

            return known_of(campaign, self._amplifier)

        self._fits.do(fit, self._knows, self._failed)

    def _knows(self, known: Known) -> None:
        self.known = known
        self.changed.emit()

    def _offered(self, paths: tuple[Path, ...]) -> None:
        self.offered = paths
        self.changed.emit()

    def _failed(self, error: Exception) -> None:
        self.queue = False
        self.said.emit(str(error))
        self.changed.emit()


def _opened(campaign: Campaign) -> Opened:
    from app.campaign.queue import Conductor

    return campaign, Conductor(campaign), campaign.path.stat().st_mtime_ns
