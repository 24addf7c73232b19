"""The commands `run`, `window`, `demo`, `show`, `resume` and `protocols`.

Other modules of the program are imported where they are used, so that help texts and the window appear without delay.
"""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from app.cli.options import (
    FAULTS,
    JSON_EVENTS,
    JSON_OBJECT,
    JSON_PLAIN,
    BenchOptions,
    ProtocolOptions,
    argument,
    command,
    option,
)
from app.common import ExitCode, UsageError, print_line, print_message, usage_errors

if TYPE_CHECKING:
    from app.cli.headless import SelectedBench
    from app.config import BenchConfig
    from protocols.base import Protocol

PROTOCOL_HELP = "a protocol, such as sine-dwell ('tactor-bench protocols' lists them)"


@command("example: tactor-bench run sine-dwell --set frequencies_hz=100,150,160,170,200 --set peak_to_peak_v='4 V'")
class RunCommand(ProtocolOptions):
    """Run a protocol: progress on the terminal, one HDF5 file as result."""

    protocol: str = argument(f"{PROTOCOL_HELP}, or a lab's own file: ./my_protocol.py")
    json: bool = JSON_EVENTS
    faults: Sequence[str] = FAULTS

    def execute(self) -> int:
        from app.cli.headless import make_protocol, run_headless, run_request, select_bench

        bench = select_bench(self)
        request = run_request(self, make_protocol(self.protocol, self.settings))
        return run_headless(bench, request, self.json, planned_faults=self.faults)[0]


@command("example: tactor-bench window sine-dwell --start --set peak_to_peak_v=4")
class WindowCommand(ProtocolOptions):
    """Open the window, with a protocol's form filled in and, with --start, run."""

    bench: str = option(
        "bench file, 'sim' or 'ideal' (default: the bench chosen last in the window; with --start 'sim')",
        inherited=True,
        metavar="FILE|sim",
    )
    protocol: str = argument(PROTOCOL_HELP, nargs="?")
    autostart: bool = option("start the run as soon as the bench is connected", flag="--start")

    def execute(self) -> int:
        from app.cli.headless import make_protocol, select_bench
        from app.gui import window_unavailable_reason
        from protocols import DEFAULT_PROTOCOL

        bench = select_bench(replace(self, bench=self.bench or "sim"))
        given = bool(self.bench or self.speed is not None or self.seed is not None or self.autostart)
        protocol = make_protocol(self.protocol or DEFAULT_PROTOCOL, self.settings)
        if why := window_unavailable_reason():
            raise UsageError(
                f"no window can be opened: {why}. The same work without one: 'tactor-bench run sine-dwell'"
            )
        return _open_window(bench, self, protocol, self.autostart, bench_given=given)


@command("example: tactor-bench demo --out runs")
class DemoCommand(BenchOptions):
    """Demonstrate a sine dwell on the simulated bench: in the window or, where no window can be opened, with a progress
    bar, a run file and a picture.
    """

    no_window: bool = option("run on the terminal even if there is a display")

    def execute(self) -> int:
        from app.cli.headless import make_protocol, run_headless, run_request, select_bench
        from app.gui import window_unavailable_reason
        from protocols import DEFAULT_PROTOCOL

        bench = select_bench(self)
        protocol = make_protocol(DEFAULT_PROTOCOL, [])
        why = "--no-window was given" if self.no_window else window_unavailable_reason()
        if not why:
            return _open_window(bench, self, protocol, autostart=True)
        print_message(f"No window: {why}. The same run follows without a window.")
        code, path = run_headless(bench, run_request(self, protocol))
        if path is not None and path.exists():
            _draw_run(path, path.with_suffix(".png"))
        return code


@command("example: tactor-bench show runs/20261121T091502Z_unnamed_sine-dwell.h5 --picture run.png")
class ShowCommand:
    """Show the contents of a run file: end of the run, points and estimates."""

    run: Path = argument("a run file")
    json: bool = JSON_OBJECT
    picture: Path | None = option("draw the run into this PNG file", metavar="PNG")

    def execute(self) -> int:
        from app.archive import run_record, run_text
        from app.cli.output import PICTURE_SUFFIXES, check_output_file, print_json
        from protocols.runfile import Run, RunReadError, translate_read_errors

        if self.picture:
            check_output_file(self.picture, PICTURE_SUFFIXES)
        with usage_errors(RunReadError), Run(self.run) as run, translate_read_errors(self.run):
            if self.json:
                print_json(run_record(run))
            else:
                print_line(run_text(run))
        return _draw_run(self.run, self.picture) if self.picture else ExitCode.DONE


@command("example: tactor-bench resume runs/20261121T091502Z_T7_sine-dwell.h5 --again 155,160")
class ResumeCommand(BenchOptions):
    """Resume a stopped, failed or crashed run; or, with --again, measure some of its points again. The result is a new file that contains the earlier points and links to their raw data."""

    run: Path = argument("a run file", metavar="RUN")
    again: str = option("entries by their values, e.g. 155,160 for frequencies; or 'flagged'", metavar="WHICH")
    protocol_file: str = option(
        "file of the protocol, for a run of a lab's own protocol", flag="--protocol", metavar="FILE.py"
    )
    json: bool = JSON_EVENTS

    def execute(self) -> int:
        from app.cli.headless import load_all_protocols, run_headless, select_bench
        from app.session import load_protocol_class
        from protocols import find_entries
        from protocols.runfile import RunReadError
        from protocols.runner import RunRequest

        bench = select_bench(self)
        load_all_protocols()
        if self.protocol_file:
            load_protocol_class(self.protocol_file, print_message)
        with usage_errors(RunReadError):
            again = find_entries(self.run, [name for name in self.again.split(",") if name]) if self.again else ()
            request = RunRequest.resuming(self.run, self.out or self.run.parent, again)
        request = replace(request, specimen=self.specimen or request.specimen)
        return run_headless(bench, request, self.json)[0]


def _open_window(
    selected: "SelectedBench", options: BenchOptions, protocol: "Protocol", autostart: bool, bench_given: bool = True
) -> int:
    from app.config import load_bench
    from app.gui import InitialForm, OpenedBench, open_window
    from app.session import SimulationSettings, connect

    def choose(name: str, config: "BenchConfig", speed: float | None, without_commissioning: str = "") -> OpenedBench:
        if not config.simulated:
            return OpenedBench(
                lambda: connect(config, speed, without_commissioning=without_commissioning, notice=options.after_run),
                config,
                name=name,
                after_run=options.after_run,
            )
        simulation = SimulationSettings(speed)
        return OpenedBench(
            lambda: connect(config, simulation.speed, notice=options.after_run),
            config,
            simulation,
            name,
            options.after_run,
        )

    def open_bench(name: str) -> OpenedBench:
        other = load_bench(name)
        return choose(name, other, other.simulation_parameters.speed if other.simulated else 1.0)

    return open_window(
        choose(options.bench or "sim", selected.config, selected.speed, selected.without_commissioning),
        InitialForm(protocol, options.out, options.specimen, autostart),
        bench_factory=open_bench,
        bench_given=bench_given,
    )


def _draw_run(run_file: Path, picture: Path) -> int:
    from app.cli.output import PICTURE_SUFFIXES, writing_output
    from app.identification import chosen_threshold
    from app.plotting import draw_run
    from model import ParameterError
    from protocols.runfile import Run, RunReadError

    with usage_errors(RunReadError, ParameterError), writing_output(picture, PICTURE_SUFFIXES), Run(run_file) as run:
        draw_run(run, picture, threshold=chosen_threshold(run_file.parent))
    return ExitCode.DONE


@command("example: tactor-bench protocols sine-dwell")
class ProtocolsCommand:
    """List the protocols of this program and of installed packages; with a name or a file, the parameters of the protocol."""

    protocol: str | None = argument("a protocol, or a lab's own file: ./my_protocol.py", nargs="?")
    json: bool = JSON_PLAIN

    def execute(self) -> int:
        from app.cli.output import print_answer
        from protocols import PROTOCOLS, load_plug_ins

        for trouble in load_plug_ins():
            print_message(trouble)
        if self.protocol:
            from app.session import load_protocol_class

            kind = load_protocol_class(self.protocol, print_message)
            rows = _parameter_records(kind)
            lines = [f"{kind.title}: {PROTOCOLS.summary(kind.name)}"]
            for row in rows:
                lines += [f"  {row['parameter']} = {row['default']} {row['unit']}".rstrip()]
                lines += [f"      {row['what it is']}" + (f"; {row['range']}" if row["range"] else "")]
        else:
            rows = [{"protocol": name, "what it measures": PROTOCOLS.summary(name)} for name in sorted(PROTOCOLS)]
            widest = max(map(len, PROTOCOLS))
            lines = [f"{row['protocol']:{widest}}  {row['what it measures']}" for row in rows]
        return print_answer(rows, lines, self.json)


def _parameter_records(kind: "type[Protocol]") -> list[dict[str, str]]:
    from app.services import format_parameter, protocol_fields

    return [
        {
            "parameter": field.name,
            "default": format_parameter(kind.model_fields[field.name].get_default(call_default_factory=True)),
            "unit": field.unit,
            "range": field.limits,
            "what it is": field.description,
        }
        for field in protocol_fields(kind)
    ]
