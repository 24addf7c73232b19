"""Measurement campaign of one specimen: ordered items, their status and the next one.

The status of an item is computed from the run files on every request; runs made outside the campaign count too. The campaign file
holds only the plan and the basis of each run, so it cannot contradict the run files, and a killed program leaves nothing to
repair.
"""

import json
import threading
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import ValidationError

from app.archive import RunState, RunSummary
from app.campaign.plan import (
    CARRIED_PARAMETERS,
    PAPER_ITEMS,
    SUFFIX,
    CampaignError,
    CampaignItem,
    CampaignPlan,
    campaign_path,
    drop_unknown_protocols,
    read_record,
    write_record,
)
from app.campaign.series import AIR_TEMPERATURE, evaluate_items
from app.campaign.status import HAS_VALID_RUN, CampaignRuns, ItemState, basis_of
from app.common import record_audit
from model import AmplifierMap
from protocols import PROTOCOLS
from protocols.base import EstimatedQuantity, Protocol
from protocols.runfile import other_specimen_message


class Campaign:
    """One specimen's campaign in a folder of runs. Every change is on disk, whole, before the method returns."""

    def __init__(self, path: Path, record: Mapping[str, Any]) -> None:
        self.path = path
        self.specimen = str(record["specimen"])
        self.simulated = bool(record["simulated"])
        self.created = str(record["created"])
        self._plan = CampaignPlan(tuple(CampaignItem.from_record(item) for item in record["items"]))
        self._based_on: dict[str, dict[str, Any]] = dict(record["based_on"])
        self._runs = CampaignRuns(path.parent)
        self._active_run: tuple[str, Path] | None = None
        """Item ("" for a run outside the campaign) and file that this program is writing and that must not be opened."""
        self._lock = threading.RLock()

    @classmethod
    def create(cls, folder: Path, specimen: str, simulated: bool, items: Sequence[CampaignItem] = PAPER_ITEMS) -> Self:
        """Create a campaign with the items whose protocol is registered.

        Raises:
            CampaignError: the specimen has a campaign there already, or the folder is not writable.
        """
        path = campaign_path(folder, specimen)
        if path.exists():
            cls.open_file(path, specimen)  # raises if it is another specimen's
            raise CampaignError(
                f"there is a campaign of {specimen} already: {path}; continue it, or move its file away"
            )
        created = datetime.now(UTC).isoformat(timespec="milliseconds")
        kept = [item.as_record() for item in drop_unknown_protocols(items, PROTOCOLS)]
        record = {"specimen": specimen, "simulated": simulated, "created": created, "items": kept, "based_on": {}}
        campaign = cls(path, record)
        campaign._save()
        return campaign

    @classmethod
    def open(cls, folder: Path, specimen: str) -> Self:
        """Open the specimen's campaign.

        Raises:
            CampaignError: there is none, or its file cannot be read.
        """
        return cls.open_file(campaign_path(folder, specimen), specimen)

    @classmethod
    def open_file(cls, path: Path, specimen: str = "") -> Self:
        """Open the campaign of a file, which must belong to `specimen` if it is given.

        Raises:
            CampaignError: there is none, it is another specimen's, or its file cannot be read.
        """
        try:
            campaign = cls(path, read_record(path))
            if specimen not in ("", campaign.specimen):
                raise CampaignError(other_specimen_message(path, SUFFIX, campaign.specimen, specimen))
            return campaign
        except FileNotFoundError:
            of = f"of {specimen} in {path.parent}" if specimen else f"at {path}"
            raise CampaignError(
                f"there is no campaign {of}; create one: tactor-bench campaign new --specimen {specimen or 'NAME'}"
            ) from None
        except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
            raise CampaignError(
                f"the campaign {path} cannot be understood ({type(error).__name__}: {error}); correct the file, or take it "
                "away and create a new one. The runs themselves are unchanged"
            ) from None

    @property
    def items(self) -> tuple[CampaignItem, ...]:
        """Items of the campaign, in order."""
        return self._plan.items

    # -- status --------------------------------------------------------------------------------------------------------

    def item_states(self) -> tuple[ItemState, ...]:
        """Return the state of every item in order, computed from the run files."""
        with self._lock:
            name, file = self._active_run or ("", None)
            made = self._runs.begun_since(self.created, exclude=file)
            runs = {item.name: self._runs_of(item, made) for item in self.items}
            if file is not None and name:
                item = self._plan.item(name)
                runs[name].append(
                    RunSummary(file.name, RunState.RUNNING, protocol=item.protocol, specimen=self.specimen)
                )
            titles = {name: PROTOCOLS.title(name) for name in PROTOCOLS}
            return evaluate_items(self.path.parent, self.items, titles, runs, self._based_on)

    def next_item(self, hands_free: bool = False) -> ItemState | None:
        """Return the first item that can be measured now; `hands_free` skips items that need the operator."""
        for line in self.item_states():
            if line.is_ready and not (hands_free and self.needs_operator(line.item)):
                return line
        return None

    def item_state(self, name: str) -> ItemState:
        """Return the state of one item. Raises CampaignError for an unknown name."""
        self._plan.item(name)
        return next(line for line in self.item_states() if line.item.name == name)

    def protocol_for(self, item: CampaignItem) -> Protocol:
        """Return the item's protocol with its settings and the estimates carried over from items it depends on.

        Raises:
            CampaignError: the protocol is unknown, or rejects the settings.
        """
        carried = self.accepted_estimates(item)
        return self._make_protocol(
            item, {name: carried[of].value for name, of in CARRIED_PARAMETERS.items() if of in carried}
        )

    def _make_protocol(self, item: CampaignItem, carried: Mapping[str, float]) -> Protocol:
        kind = PROTOCOLS.get(item.protocol)
        if kind is None:
            raise CampaignError(f"{item.name} is a run of '{item.protocol}', an unknown protocol")
        fits = {name: value for name, value in carried.items() if name in kind.model_fields}
        try:
            return kind(**{**fits, **item.settings})
        except ValidationError as error:
            fault = error.errors()[0]
            raise CampaignError(
                f"{item.name}: {'.'.join(map(str, fault['loc']))}: {fault['msg']}; correct it in {self.path}"
            ) from None

    def needs_operator(self, item: CampaignItem) -> bool:
        """Return whether the operator must do more than switch high voltage."""
        plan = self._make_protocol(item, {}).plan(AmplifierMap().rest_v)
        return bool(item.prepare) or any(entry.setup is not None or entry.prompts for entry in plan)

    def accepted_estimates(self, item: CampaignItem) -> dict[str, EstimatedQuantity]:
        """Return the accepted estimates of all dependencies of an item by name; later items take precedence."""
        dependencies = self._plan.dependencies(item)
        lines = [line for line in self.item_states() if line.item.name in dependencies]
        return {estimate.name: estimate for line in lines for estimate in line.estimates}

    def valid_runs(self) -> list[Path]:
        """Return the valid runs of the items in order, then the runs of temperature series; runs of other series are excluded."""
        states = self.item_states()
        lines = [line for line in states if not line.steps]
        lines += [step for line in states if line.item.varied == AIR_TEMPERATURE for step in line.steps]
        return [line.run for line in lines if line.run is not None and line.status in HAS_VALID_RUN]

    # -- changes -------------------------------------------------------------------------------------------------------

    def add(self, item: CampaignItem) -> None:
        """Add an item at the end.

        Raises:
            CampaignError: there is one of that name, it needs an unknown one, or its protocol rejects a value.
        """
        for each in item.steps or (item,):
            if self._make_protocol(each, {}).air_target is None and item.varied == AIR_TEMPERATURE:
                raise CampaignError(
                    "a series over air_temperature_c waits for each temperature: set air_within_k above 0"
                )
        with self._lock:
            self._plan.add(item)
            self._save(item.name, {"added": item.protocol})

    def run_started(self, run: Path, name: str = "") -> None:
        """Record a run that this program is writing and that must not be opened; for an item also its basis."""
        with self._lock:
            self._active_run = (name, run)
            if name:
                lines = {line.item.name: line for line in self.item_states()}
                needs = self._plan.item(name).needs
                self._based_on[run.name] = {n: basis_of(lines[n]) for n in needs if lines[n].run is not None}
                self._save()

    def run_ended(self) -> None:
        """Record the end of the run that this program has started."""
        with self._lock:
            self._active_run = None

    def skip(self, name: str, reason: str = "left out on purpose") -> None:
        """Skip an item; dependent items no longer wait for it. An empty reason restores it."""
        self._change(name, skipped=reason)

    def repeat(self, name: str) -> None:
        """Require a new run of an item. The present result counts until the new run, an accepted one until its acceptance."""
        self._change(name, since=datetime.now(UTC).isoformat(timespec="milliseconds"), skipped="")

    def accept(self, name: str, run: str = "") -> None:
        """Accept the result of an item: of its newest run, or of an earlier one, which counts from then on.

        Raises:
            CampaignError: there is no such run with a result.
        """
        line = self.item_state(name)
        if run and run not in [each.name for each in line.results]:
            raise CampaignError(f"{name} has no run {run} with a result")
        if line.steps and not run:
            self._accept_series(line)
            return
        line = next((step for step in line.steps if run in [each.name for each in step.results]), line)
        if not run:
            if line.run is None or line.status not in HAS_VALID_RUN:
                raise CampaignError(f"{name} has no run that could be accepted: it is {line.status}")
            run = line.run.name if line.candidate is None else line.candidate.name
        names = [each.name for each in line.results]
        passed_over = [
            each for each in names[names.index(run) + 1 :] if each not in (*line.item.accepted, *line.item.rejected)
        ]
        self._change(
            name,
            accepted=(*(each for each in line.item.accepted if each != run), run),
            rejected=(*(each for each in line.item.rejected if each != run), *passed_over),
        )

    def _accept_series(self, line: ItemState) -> None:
        """Accept the newest result of every value of a series."""
        if line.status not in HAS_VALID_RUN:
            raise CampaignError(
                f"{line.item.name} cannot be accepted before all of its values are measured: {line.reason}"
            )
        names = [
            step.candidate.name if step.candidate is not None else step.run.name
            for step in line.steps
            if step.run is not None
        ]
        kept = tuple(each for each in line.item.accepted if each not in names)
        rejected = tuple(each for each in line.item.rejected if each not in names)
        self._change(line.item.name, accepted=(*kept, *names), rejected=rejected)

    def reject(self, name: str, run: str = "") -> None:
        """Reject a run of an item, by default its newest; the run before it counts, or the item is missing."""
        line = self.item_state(name)
        if line.reviewed_run is None:
            raise CampaignError(f"{name} has no run that could be rejected")
        self._change(name, rejected=(*line.item.rejected, run or line.reviewed_run.name))

    def move(self, name: str, before: str = "") -> None:
        """Move an item before another one, or to the end. Raises CampaignError if it would precede a dependency."""
        with self._lock:
            self._plan.move(name, before)
            self._save()

    def undo(self) -> bool:
        """Undo the last change of the plan; return whether there was one. Runs are not changed."""
        with self._lock:
            return self._plan.undo() and self._save()

    def redo(self) -> bool:
        """Redo the last undone change; return whether there was one."""
        with self._lock:
            return self._plan.redo() and self._save()

    # -- private -------------------------------------------------------------------------------------------------------

    def _runs_of(self, item: CampaignItem, runs: Sequence[RunSummary]) -> list[RunSummary]:
        """Return the runs of an item, oldest first.

        A run of a series is a run of another item only if it has all of that item's parameters, including unset ones.
        """
        every = self._parameters(item)
        settings = {name: every[name] for name in item.settings}
        runs = [
            run
            for run in runs
            if run.protocol == item.protocol
            and run.specimen == self.specimen
            and run.simulated == self.simulated
            and _has_parameters(run, settings)
        ]
        series = [
            self._parameters(step, set_only=True)
            for other in self.items
            if other.protocol == item.protocol and other.name != item.name
            for step in other.steps
        ]
        if not series:
            return runs
        whole = {name: value for name, value in every.items() if name not in (*CARRIED_PARAMETERS, item.varied)}
        return [
            run for run in runs if _has_parameters(run, whole) or not any(_has_parameters(run, step) for step in series)
        ]

    def _parameters(self, item: CampaignItem, set_only: bool = False) -> dict[str, Any]:
        """Return the parameters of an item's protocol as a run file has them; `set_only`: only the item's settings."""
        include = set(item.settings) if set_only else None
        return dict(json.loads(json.dumps(self._make_protocol(item, {}).model_dump(mode="json", include=include))))

    def _change(self, name: str, **values: Any) -> None:
        with self._lock:
            self._plan.change(name, **values)
            self._save(name, values)

    def _save(self, item: str = "", changed: Mapping[str, Any] | None = None) -> Literal[True]:
        record = {
            "specimen": self.specimen,
            "simulated": self.simulated,
            "created": self.created,
            "items": [item.as_record() for item in self.items],
            "based_on": self._based_on,
        }
        write_record(self.path, record)
        record_audit("campaign", self.path, subject=self.specimen, item=item, **(changed or {}))
        return True


def _has_parameters(run: RunSummary, parameters: Mapping[str, Any]) -> bool:
    requested = run.requested_parameters
    return all(requested.get(name) == value for name, value in parameters.items())
