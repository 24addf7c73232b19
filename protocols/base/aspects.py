"""Aspects of a protocol: its observations, import columns, figures and live curve, beside its measurement.

Front ends and services use the aspects of a protocol and know no protocol by name. Built-in protocols have theirs in the module
of the same name in `protocols.aspects`; a laboratory's protocol file assigns its own (docs/how-to-write-a-protocol.md).
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Iterable, Iterator, Sequence

    from drivers import Drive
    from model import Array
    from model.identification import Observation
    from protocols.aspects import RunPoints
    from protocols.base.figures import Figure, ModelState
    from protocols.base.importing import ImportedSamples, ImportedTable, ImportForm, RunOfSamples
    from protocols.base.protocol import Protocol
    from protocols.base.records import Recording, Series
    from protocols.base.run_figures import ResultTable, RunFigure
    from protocols.runfile import RunRecord

MEASUREMENTS_PACKAGE, ASPECTS_PACKAGE = "protocols.measurements", "protocols.aspects"


class Aspects:
    """Default aspects; a subclass overrides the aspects that its protocol has."""

    @property
    def import_form(self) -> ImportForm:
        """Columns of tables that can be imported as its runs."""
        from protocols.base.importing import ImportForm  # not needed to measure

        return ImportForm()

    short_name: str = ""
    """Name for a narrow column of the report; empty: the protocol's own."""

    def observations(self, points: RunPoints) -> Iterable[Observation]:
        """Return the observations of a run for the fit; none for a protocol without relation to the model.

        Raises:
            ParameterError: a value is not physical.
            RunReadError: this version rejects the run's parameters.
        """
        return ()

    def complete_table(self, table: ImportedTable) -> type[Protocol] | None:
        """Complete the values of an imported table; return the protocol of the values, if it is another one.

        Raises:
            TableImportError: the values do not suffice, or contradict each other.
        """
        return None

    def series_fault(self, series: ImportedSamples) -> str | None:
        """Return the reason why a time series cannot become a run of this protocol, empty if it can; None if no time series can."""
        return None

    def series_runs(self, series: Sequence[ImportedSamples]) -> Iterable[RunOfSamples]:
        """Return the runs of time series, all without `series_fault`.

        Raises:
            TableImportError: a series is insufficient.
        """
        raise NotImplementedError

    def model_curve(self, state: ModelState, x: Array) -> Array | None:
        """Return the second of the protocol's axes over the first by the model, (N,), SI; None without a model."""
        return None

    figure_title: str = ""
    """Title of the points over the protocol's axes as a figure of the report; empty: no figure."""

    def figures(self, points: RunPoints) -> Iterable[Figure]:
        """Return the figures of a run; by default the points over the protocol's axes with the curve of the model."""
        from protocols.base.figures import Figure  # not needed for measuring

        yield Figure((points.series(*points.run.record.axes),), self.figure_title, model=self.model_curve)

    live_drives: tuple[type[Drive], ...] = ()
    """Drives whose samples give a curve (`live_curve`) during play; none: curves are drawn after each entry."""

    def live_part(self, recording: Recording) -> Any:
        """Return the present result of a drive of an entry, such as a frequency response; None while its samples are insufficient.

        Called in a background thread: again and again for the running drive, once for a finished one.
        """
        return None

    def live_curve(self, parts: Sequence[Any], running: Recording) -> Series:
        """Return the present curve of an entry from the parts of its drives; `running` are the samples of the last one."""
        raise NotImplementedError

    def run_figures(self, run: RunRecord, estimates: Sequence[RunFigure]) -> Iterable[RunFigure]:
        """Return the figures of a run for lists, fleets and control charts: its estimates, changed or with further figures."""
        return estimates

    def remarks(self, figures: Iterator[RunFigure]) -> Iterable[tuple[str, RunFigure | None]]:
        """Return lines at the end of a run's description as text, each with the figure that follows it."""
        return ()

    def result_tables(self, run_name: str, figures: Sequence[RunFigure]) -> Iterable[ResultTable]:
        """Return tables for the report of a specimen from the figures of its newest run."""
        return ()


class AspectsOfModule:
    """Class attribute `aspects` of a protocol: `ASPECTS` of the built-in protocol's module of aspects, otherwise the defaults.

    A laboratory's subclass of a built-in protocol has the aspects of its base.

    Aspects are imported when they are first used: measuring needs none of them.
    """

    def __get__(self, instance: Any, protocol_class: type) -> Aspects:
        names = (base.__module__.rpartition(".") for base in protocol_class.__mro__)
        module = next((module for package, _, module in names if package == MEASUREMENTS_PACKAGE), None)
        if module is None:
            return Aspects()
        aspects = importlib.import_module(f"{ASPECTS_PACKAGE}.{module}").ASPECTS
        assert isinstance(aspects, Aspects)
        return aspects
