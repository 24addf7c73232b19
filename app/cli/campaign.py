"""The command `campaign`: the measurements of one specimen in their order."""

from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from app.campaign import (
    ACTION_LABELS,
    STATUS_MARKS,
    Campaign,
    CampaignError,
    CampaignItem,
    CampaignRehearsal,
    CampaignRunner,
    ItemState,
    check_bench_kind,
    first_item,
    format_named_estimate,
    next_item_after,
    read_series_values,
    rehearse_campaign,
    series_curves,
    series_parameters,
)
from app.cli.headless import headless_session, make_protocol, refuse_unreachable_operator, select_bench
from app.cli.options import (
    FAULTS,
    JSON_OBJECT,
    BenchOptions,
    CommandGroup,
    FileOptions,
    argument,
    command,
    group,
    option,
    split_setting,
)
from app.cli.output import CommandResult, check_output_files, print_answer, render
from app.common import (
    Column,
    ExitCode,
    Table,
    UnitError,
    UsageError,
    format_bytes,
    format_duration,
    print_message,
    usage_errors,
)
from app.identification import verdict_line
from drivers import BenchError
from model import Series, shown_unit
from protocols.base import UNNAMED, Protocol
from protocols.runfile import RunReadError


@command("--specimen T7")
class CampaignCommand(BenchOptions):
    """Begin, print or rehearse a campaign."""

    json: bool = JSON_OBJECT
    verb: str = ""

    @usage_errors(CampaignError, RunReadError)
    def execute(self) -> int:
        folder, specimen = self.out or Path("runs"), self.specimen or UNNAMED
        if self.verb == "new":
            return _print_campaign(Campaign.create(folder, specimen, select_bench(self).config.simulated), self.json)
        return self.apply(Campaign.open(folder, specimen))

    def apply(self, opened: Campaign) -> int:
        """Execute a subcommand on an existing campaign; return the exit code."""
        return _rehearse(opened, self) if self.verb == "rehearse" else _print_campaign(opened, self.json)


@command("dwell --specimen T7")
class ItemCommand(CampaignCommand):
    """Change one item of a campaign, and print the campaign."""

    item: str = argument("name of the item, as in 'status'")

    def apply(self, opened: Campaign) -> int:
        self.change(opened)
        return _print_campaign(opened, self.json)

    def change(self, opened: Campaign) -> None:
        {"accept": opened.accept, "repeat": opened.repeat, "reject": opened.reject}[self.verb](self.item)


@command("dwell --specimen T7")
class SkipCommand(ItemCommand):
    """Skip an item."""

    reason: str = option("reason, stored in the campaign; '' includes the item again", "skipped")

    def change(self, opened: Campaign) -> None:
        opened.skip(self.item, self.reason)


@command("sag --before dwell --specimen T7")
class MoveCommand(ItemCommand):
    """Move an item before another one."""

    before: str = option("the item before which it is inserted", required=True, metavar="ITEM")

    def change(self, opened: Campaign) -> None:
        opened.move(self.item, self.before)


@command(
    "levels --protocol sine-dwell --set frequencies_hz=140,150,160,170 --vary peak_to_peak_v=1,2,3,4,5 --specimen T7"
)
class AddCommand(CampaignCommand):
    """Add a measurement: one run, or a series over the values of one parameter."""

    item: str = argument("name of the new item")
    protocol: str = option("protocol, as in 'protocols'", required=True, metavar="NAME")
    vary: str = option(
        "repeat the protocol for each of these values of a parameter: 1,2,3 or '1...5 step 0.5' or '2 V, 4 V'",
        metavar="NAME=VALUES",
    )
    settings: Sequence[str] = option(
        "another parameter of the protocol; may be repeated", flag="--set", metavar="NAME=VALUE"
    )
    needs: Sequence[str] = option("prerequisite item; may be repeated", metavar="ITEM")

    def apply(self, opened: Campaign) -> int:
        protocol = make_protocol(self.protocol, self.settings)
        given = {setting.partition("=")[0].strip() for setting in self.settings}
        settings = protocol.model_dump(mode="json", include=given)
        varied, values = _read_values(type(protocol), self.vary) if self.vary else ("", ())
        if varied in given:
            raise UsageError(f"{varied} is varied, and is set to one value with --set; leave one of them out")
        opened.add(CampaignItem(self.item, protocol.name, settings, tuple(self.needs), varied=varied, values=values))
        return _print_campaign(opened, self.json)


def _read_values(kind: type[Protocol], text: str) -> tuple[str, tuple[float, ...]]:
    """Return the varied parameter and its values.

    Raises:
        UsageError: there is no such parameter, it has no single number, or the values cannot be read.
    """
    from app.session import unknown_parameter

    name, values = split_setting(text, "--vary", "peak_to_peak_v=1,2,3,4,5")
    if name not in kind.model_fields:
        raise UsageError(unknown_parameter(kind, name))
    if name not in series_parameters(kind):
        raise UsageError(f"--vary {name}: this parameter is not a single number, so that nothing can be drawn over it")
    with usage_errors(UnitError, about=f"--vary {text}"):
        return name, read_series_values(kind, name, values)


@command("levels --picture levels.png --specimen T7")
class CurveCommand(CampaignCommand):
    """Show the results of a series over its parameter: table, CSV and picture."""

    item: str = argument("name of the series, as in 'status'")
    files: FileOptions = group(FileOptions, "the results of the series")

    def apply(self, opened: Campaign) -> int:
        from model.studies import PaperFigure

        state = opened.item_state(self.item)
        if not state.steps:
            raise UsageError(f"{self.item} is a single run; a series is added with: campaign add NAME --vary ...")
        curves = series_curves(state)
        if not curves:
            raise UsageError(f"{self.item} has results of fewer than two values: {state.reason}")
        check_output_files(self.files)
        main = curves[-1]
        x = main.x_axis
        columns = [Column(x.name, x.unit, main.x, display_unit=shown_unit(x.unit)[1])]
        for curve in reversed(curves):
            if curve.x.size == main.x.size and curve.errors is not None and curve.total_errors is not None:
                y, shown = curve.y_axis, shown_unit(curve.y_axis.unit)[1]
                columns += [
                    Column(y.name, y.unit, curve.plotted, display_unit=shown),
                    Column(f"{y.name}_errors", y.unit, curve.errors, "± noise", shown, ".2g"),
                    Column(f"{y.name}_total_uncertainty", y.unit, curve.total_errors, "± total", shown, ".2g"),
                ]
        table = Table("series", f"{self.item} of {opened.specimen}: {state.reason}", tuple(columns))
        coefficients = [f"{curve.y_axis.name}: {curve.label}" for curve in reversed(curves) if curve.label]
        y, lines = main.y_axis, (Series(main.x, main.plotted, label=self.item),)
        caption = f"{y.name} of {opened.specimen} over {x.name}."
        result = CommandResult(
            "campaign curve",
            {},
            (table,),
            figures=(PaperFigure("series", x.name, x.unit, y.name, y.unit, lines, caption),),
            heading=(*(("SIMULATED",) if opened.simulated else ()), *coefficients),
            extra={"simulated": opened.simulated},
        )
        return render(result, self.json, self.files)


@command("dwell --specimen T7")
class RunItemCommand(CampaignCommand):
    """Measure the next items of a campaign, or resume one."""

    item: str = argument("name of the item, as in 'status'", nargs="?")
    all: bool = option("continue with the next items until all are done")
    hands_free: bool = option("like --all, but only items without manual actions at the specimen")
    faults: Sequence[str] = FAULTS

    def apply(self, opened: Campaign) -> int:
        bench = select_bench(self)
        check_bench_kind(opened, bench.config.simulated)
        line: ItemState | None = first_item(opened, self.item, self.hands_free, self.verb == "resume")
        runner, continues = CampaignRunner(opened), self.all or self.hands_free
        folder = None
        if line is not None:
            request = runner.prepare(line)
            refuse_unreachable_operator(bench, request.protocol, request.prepare)
            folder = request.folder
        with headless_session(bench, self.json, [runner], self.faults, folder) as session:
            while line is not None:
                if not self.json:
                    action = ACTION_LABELS[line.next_action].lower()
                    print_message(f"campaign of {opened.specimen}: {action} {line.item.name} ({line.title})")
                request = runner.prepare(line)
                refuse_unreachable_operator(bench, request.protocol, request.prepare)
                runner.submit(session.session, request)
                session.wait()
                if session.exit_code != ExitCode.DONE or session.interrupted.is_set() or not continues:
                    break
                line = next_item_after(opened, line, self.hands_free)
        if not self.json:
            _print_campaign(opened, as_json=False)
        return session.exit_code


@usage_errors(BenchError)
def _rehearse(campaign_: Campaign, options: CampaignCommand) -> int:
    from app.campaign import identified_tactor
    from app.session import connect

    bench = select_bench(options)
    with connect(bench.config, None if bench.config.simulated else bench.speed) as lab:
        rehearsal = rehearse_campaign(campaign_, lab.bench, identified_tactor(campaign_, lab.bench.amplifier.map))
    record = {
        **asdict(rehearsal),
        "items": [{"item": item.name, **asdict(one)} for item, one in rehearsal.items],
        "refusals": [{"item": item.name, "reason": reason} for item, reason in rehearsal.refusals],
    }
    print_answer(record, [_rehearsal_text(rehearsal)], options.json)
    return ExitCode.USAGE if rehearsal.refusals else ExitCode.DONE


def _rehearsal_text(rehearsal: CampaignRehearsal) -> str:
    lines = []
    for item, one in rehearsal.items:
        volts = f"{one.lowest_specimen_v:+.0f} ... {one.highest_specimen_v:+.0f} V"
        lines.append(
            f"{item.name:10} {format_duration(one.duration_s):>12}  {one.entries:4} points  {one.prompts:4} prompts  {volts:>18}  "
            f"{format_bytes(one.file_bytes):>7}  closest to a limit: {one.worst}"
        )
    lines += [f"{item.name:10} {'refused':>12}  {reason}" for item, reason in rehearsal.refusals]
    volts = f"{rehearsal.lowest_specimen_v:+.0f} ... {rehearsal.highest_specimen_v:+.0f} V on the specimen"
    lines.append(
        f"together {format_duration(rehearsal.duration_s)}, {rehearsal.prompts} prompts, {volts}, {format_bytes(rehearsal.file_bytes)}"
    )
    return "\n".join([*lines, *(f"caution: {text}" for text in rehearsal.cautions)])


def _print_campaign(campaign_: Campaign, as_json: bool) -> int:
    from app.campaign import identify_campaign_runs

    lines, identification = campaign_.item_states(), identify_campaign_runs(campaign_)
    estimates = () if isinstance(identification, str) else identification.identified
    verdict = "" if isinstance(identification, str) else verdict_line(identification)
    record = {
        "specimen": campaign_.specimen,
        "simulated": campaign_.simulated,
        "path": str(campaign_.path),
        "identified": [asdict(estimate) for estimate in estimates],
        "verdict": verdict,
        "items": [_item_record(line) for line in lines],
    }
    simulated = "   SIMULATED" if campaign_.simulated else ""
    texts = [f"campaign of {campaign_.specimen}{simulated}   {campaign_.path}", *map(_item_text, lines)]
    if estimates:
        texts.append("identified from these runs, with total uncertainties ('tactor-bench identify' for more):")
    texts += [f"    {format_named_estimate(estimate)}" for estimate in estimates]
    if verdict:
        texts.append(f"    the model is {verdict}")
    return print_answer(record, texts, as_json)


def _item_record(state: ItemState) -> dict[str, Any]:
    return {
        "item": state.item.name,
        "protocol": state.item.protocol,
        "needs": state.item.needs,
        "state": state.status,
        "reason": state.reason,
        "accepted": state.accepted,
        "next": state.next_action,
        "run": state.run and str(state.run),
        "estimates": {estimate.name: asdict(estimate) for estimate in state.estimates},
    }


def _item_text(state: ItemState) -> str:
    mark = STATUS_MARKS.get(state.status, " ")
    accepted = "accepted, " if state.accepted else ""
    lines = [f"{mark} {state.item.name:10} {state.status:10} {state.title:16} {accepted}{state.reason}"]
    if state.run is not None:
        lines.append(f"    {state.run.name}")
    lines += [f"    {format_named_estimate(estimate)}" for estimate in state.estimates]
    return "\n".join(lines)


VERBS = CommandGroup(
    "Plan and run all measurements of one specimen, each after its prerequisites. Their status is read from the run "
    "files; a campaign can be stopped, killed and resumed at any time.",
    "example: tactor-bench campaign new --specimen T7 && tactor-bench campaign run --all --specimen T7",
    {
        "new": (CampaignCommand, "Create a campaign of a specimen: the paper's measurements in their order."),
        "status": (CampaignCommand, "List done, stale, missing and failed items, and the next step."),
        "rehearse": (
            CampaignCommand,
            "Rehearse the remaining items without driving anything: time, prompts, volts, bytes.",
        ),
        "run": (RunItemCommand, "Measure the next item, or the named one."),
        "resume": (RunItemCommand, "Resume an interrupted item."),
        "skip": SkipCommand,
        "repeat": (
            ItemCommand,
            "Measure an item again. The present result counts until there is a new one, an accepted result until the new one is accepted.",
        ),
        "accept": (ItemCommand, "Accept the result of an item's run after reviewing it."),
        "reject": (ItemCommand, "Reject the present run of an item."),
        "move": MoveCommand,
        "add": AddCommand,
        "curve": CurveCommand,
    },
)
