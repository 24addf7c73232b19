"""Errors of the aspects of a laboratory's protocol are sentences, and end no list of runs."""

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from app.archive.catalogue import Catalogue
from app.archive.description import run_text
from model import ParameterError
from protocols.aspects.guarded import guarded_aspects
from protocols.base import Aspects, RunStatus
from protocols.base.figures import Figure
from protocols.measurements.sine_dwell import SineDwell, SinePoint
from protocols.registry import PROTOCOLS
from protocols.runfile import Run, RunFileWriter, RunReadError
from tests.helpers.run_files import initial_record, sine_point


class Broken(Aspects):
    short_name = "mine"

    def figures(self, points: Any) -> Iterable[Any]:
        yield 1
        raise ZeroDivisionError("division by zero")

    def run_figures(self, run: Any, estimates: Any) -> Iterator[Any]:
        raise KeyError("resonance")

    def complete_table(self, table: Any) -> None:
        raise ParameterError("a mass is negative")


class Held(SineDwell):
    name = "held-dwell"
    aspects = Broken()


def test_a_failing_aspect_names_protocol_method_and_error() -> None:
    guarded = guarded_aspects(Broken(), "held-dwell")
    assert guarded.short_name == "mine"
    figures = iter(guarded.figures(None))
    assert next(figures) == 1
    with pytest.raises(RunReadError, match=r"figures\(\) .*'held-dwell' failed: ZeroDivisionError"):
        next(figures)
    with pytest.raises(ParameterError):
        guarded.complete_table(None)


@pytest.fixture
def held_run(tmp_path: Path) -> Iterator[Path]:
    PROTOCOLS["held-dwell"] = Held
    record = replace(initial_record("T7", (100.0,), 5000.0), protocol="held-dwell")
    file = RunFileWriter.new(tmp_path, record, SinePoint)
    file.append_point(sine_point(100.0))
    file.finish(RunStatus.COMPLETED, "all points measured")
    yield file.path
    del PROTOCOLS["held-dwell"]


def test_a_list_of_runs_has_the_run_whose_figures_fail(held_run: Path) -> None:
    catalogue = Catalogue(held_run.parent, held_run.parent / "index.sqlite")
    catalogue.scan()
    (entry,) = catalogue.entries()
    assert entry.specimen == "T7"
    with Run(held_run) as run:
        assert "run_figures() in the aspects of the protocol 'held-dwell' failed: KeyError" in run_text(run)


def test_the_curves_of_a_figure_are_guarded() -> None:
    class Curved(Aspects):
        def figures(self, points: Any) -> Iterable[Figure]:
            yield Figure(model=self.model_curve, models={"5 V": self.model_curve})

        def model_curve(self, state: Any, x: Any) -> Any:
            raise IndexError("no such row")

    (figure,) = guarded_aspects(Curved(), "held-dwell").figures(None)
    for curve in (figure.model, figure.models["5 V"]):
        assert curve is not None
        with pytest.raises(RunReadError, match="IndexError"):
            curve(None, None)
