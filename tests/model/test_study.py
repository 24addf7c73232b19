"""Parameter studies: any variable, in chunks, in process or on any executor; presets, sensitivity, files."""

import csv
import tracemalloc
from collections.abc import Iterator
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from contextlib import closing, contextmanager
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest

from model.membrane import skin
from model.parameters import Membrane, Tactor
from model.response.harmonic_response import amplifier_response, frequency_response
from model.specimen import Specimen
from model.studies.parameter_study import STUDY_PRESETS, Study
from model.studies.sensitivity import sobol_indices_of

F = (10.0, 90.0, 150.0, 400.0)
UNITS = [("k2", "N m^2"), ("L1", "m"), ("delta", ""), ("mu", "N m/V"), ("frequency", "Hz")]
GRID = Study(
    {"k2": (5e-3, 7e-3, 9e-3), "L1": (5e-3, 8e-3), "delta": (0.0, 0.01), "mu": (-2e-5, 1e-5)},
    F,
    Specimen(membrane=Membrane()),
)


@pytest.mark.parametrize("measure", ["fundamental", "peak_to_peak", "receptance"])
def test_every_point_is_the_single_calculation(measure: str) -> None:
    got = replace(GRID, measure=measure).run()
    assert got.values.shape == (3, 2, 2, 2, 4)
    assert [(a.name, a.unit) for a in got.axes] == UNITS
    for i in np.ndindex(3, 2, 2, 2):
        k2, L1, delta, mu = (a.values[j] for a, j in zip(got.axes, i, strict=False))
        t = Tactor(k2=k2, L1=L1, mu=mu)
        on = skin(Membrane(), delta)
        match measure:
            case "receptance":
                one = frequency_response(t, F, on)
            case "fundamental":
                one = 2 * abs(amplifier_response(t, F, skin=on).fundamental)
            case _:
                one = amplifier_response(t, F, skin=on).peak_to_peak
        assert got.values[i] == pytest.approx(one, rel=1e-9)


@pytest.mark.parametrize("name", ["rho1", "c0", "mu", "k_s", "c_s", "E_m", "contact_length", "L2", "m_add", "h_m"])
def test_any_variable_alone(name: str) -> None:
    on = Specimen(membrane=Membrane(), delta=0.01)
    value = on.value(name)
    got = Study({name: (value, 1.3 * value)}, F, on, "receptance").run().values
    assert got[0] == pytest.approx(frequency_response(on.tactor, F, on.skin), rel=1e-9)
    assert abs(got[1] / got[0] - 1).max() > 1e-4


def test_membrane_is_spread_over_the_contact_of_the_varied_tactor() -> None:
    on = Specimen(membrane=Membrane(), delta=0.03)
    got = Study({"L2": (1.2e-2, 1.7e-2)}, F, on, "receptance").run().values
    for row, L2 in zip(got, (1.2e-2, 1.7e-2), strict=True):
        t = Tactor(L2=L2)
        assert row == pytest.approx(frequency_response(t, F, skin(Membrane(), 0.03, tactor=t)), rel=1e-9)


def test_chunks_change_nothing() -> None:
    small = replace(GRID, memory_mb=1e-3)
    assert small.chunk_size < GRID.chunk_size
    assert small.run().values == pytest.approx(GRID.run().values, rel=1e-12)


@pytest.mark.deep
def test_memory_is_bounded_by_the_chunk_not_by_the_study() -> None:
    """Four times the study, the same peak, while every set is computed."""
    peaks = []
    for sets in (1000, 4000):
        study = Study({"k2": tuple(np.linspace(5e-3, 9e-3, sets))}, tuple(np.arange(1.0, 101.0)), memory_mb=4)
        tracemalloc.start()
        with closing(study.chunks()) as blocks:
            assert sum(len(block) for _, block in blocks) == sets
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0]
    assert peaks[1] < 8e6


@pytest.mark.parametrize("measure", ["fundamental", "peak_to_peak"])
def test_a_chunk_stays_within_its_memory(measure: str) -> None:
    study = replace(GRID, vary={"k2": tuple(np.linspace(5e-3, 9e-3, 300))}, measure=measure, memory_mb=16)
    next(study.chunks())
    tracemalloc.start()
    next(study.chunks())
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert 1e5 < peak < 20e6


class Counting(Executor):
    """Executor that runs tasks immediately and counts results not yet fetched."""

    def __init__(self) -> None:
        self.submitted = 0

    def submit(self, fn, /, *args, **kwargs):  # type: ignore[no-untyped-def, override]
        self.submitted += 1
        future: Future = Future()
        future.set_result(fn(*args, **kwargs))
        return future


def test_only_a_few_chunks_are_handed_out_ahead() -> None:
    pool = Counting()
    with closing(replace(GRID, memory_mb=1e-3).chunks(pool, in_flight=3)) as blocks:
        next(blocks)
        assert pool.submitted == 3
        next(blocks)
        assert pool.submitted == 4


@contextmanager
def threads() -> Iterator[Executor]:
    with ThreadPoolExecutor(2) as pool:
        yield pool


@contextmanager
def dask_workers() -> Iterator[Executor]:
    from distributed import Client

    with (
        Client(
            processes=False, n_workers=1, threads_per_worker=2, dashboard_address=None, worker_dashboard_address=None
        ) as client,
        client.get_executor() as pool,
    ):
        yield pool


@pytest.mark.parametrize("workers", [threads, *([dask_workers] if find_spec("distributed") else [])])
def test_executors_give_the_same_study(workers) -> None:  # type: ignore[no-untyped-def]
    study = replace(GRID, memory_mb=0.02)
    assert study.chunk_size < 12
    with workers() as pool:
        assert study.run(pool).values == pytest.approx(GRID.run().values, rel=1e-12)


def test_presets_are_the_papers() -> None:
    stiffness, damping, stretch = (STUDY_PRESETS[name]() for name in ("fig10", "fig11", "fig12"))
    assert stiffness.vary == {"E_m": (1e3, 1e6, 1e7, 1e8, 1e9)}
    assert stiffness.specimen.skin.c_s == 0
    assert stiffness.specimen.delta == pytest.approx(0.00588, abs=5e-6)
    assert damping.vary["c_s"] == pytest.approx([0.00666, 6.66, 66.6, 166.5, 333.1], rel=1e-3)
    assert damping.specimen.skin.k_s == pytest.approx(585.6, rel=1e-4)
    assert stretch.vary == {"delta": (1e-5, 1e-4, 1e-3, 1e-2, 1e-1)}
    assert stretch.run().values[2, 99] == pytest.approx(
        2000 * abs(frequency_response(Tactor(), 100.0, skin(Membrane(), 1e-3))[0])
    )


def test_csv_names_its_units_and_keeps_its_digits(tmp_path: Path) -> None:
    for measure, columns in (
        ("fundamental", ["fundamental [m]"]),
        ("receptance", ["receptance_re [m/V]", "receptance_im [m/V]"]),
    ):
        got = replace(GRID, measure=measure).run()
        got.to_csv(tmp_path / "study.csv")
        with (tmp_path / "study.csv").open(encoding="utf-8") as file:
            rows = list(csv.reader(file))
        assert rows[0] == [*(f"{name} [{unit}]" for name, unit in UNITS), *columns]
        numbers = np.array(rows[1:], float)
        assert len(numbers) == got.values.size
        z = numbers[:, 5] + (1j * numbers[:, 6] if measure == "receptance" else 0)
        assert (z == got.values.ravel()).all()


def test_sensitivity_finds_the_linear_truth() -> None:
    """At almost no frequency w = gain x volts: mu alone matters, and c0 not at all."""
    at_rest = Study({}, (0.5,))
    got = sobol_indices_of(at_rest, {"mu": (-1.6e-5, -1e-5), "c0": (100.0, 200.0)}, samples=256)
    assert got.outputs == ("peak [m]", "frequency of peak [Hz]", "amplitude at 0.5 Hz [m]")
    assert got.first_order[2] == pytest.approx([1, 0], abs=0.02)
    assert got.total_order[2] == pytest.approx([1, 0], abs=0.02)


def test_sensitivity_of_the_peak_is_to_damping() -> None:
    """At the resonance c0 matters, far below it only mu does."""
    got = sobol_indices_of(Study({}, (1.0, 150.0)), {"mu": (-1.34e-5, -1.32e-5), "c0": (140.0, 180.0)}, samples=128)
    assert got.first_order[0, 1] > 0.9
    assert got.first_order[2, 0] > 0.9
    assert got.first_order[3, 1] > 0.9


def test_sensitivity_on_an_executor_is_the_same() -> None:
    study = Study({}, tuple(np.arange(100.0, 200.0, 5)), memory_mb=0.5)
    ranges = {"k2": (6e-3, 8e-3), "m_add": (6e-3, 9e-3), "c0": (120.0, 200.0)}
    with ThreadPoolExecutor(2) as pool:
        there = sobol_indices_of(study, ranges, samples=64, executor=pool)
    here = sobol_indices_of(study, ranges, samples=64)
    assert there.total_order == pytest.approx(here.total_order)
    assert here.first_order[1, :2].sum() > 0.8
