"""How fast identification is, as ratios measured in one run: python benchmarks/bench_identification.py [--json]

The joint fit of a full campaign, against the same fit with scipy's own finite differences and against the fit on the closed form's
solve loop; a live re-fit per point; the tests of adequacy; a profile interval; the descent along a narrow valley, against scipy's
trust region on the same residuals and slopes; a kept result, against the pickle module reading the same bytes.
"""

import os
import pickle
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from time import process_time
from typing import Any
from unittest.mock import patch

import numpy as np
from campaigns import SHARED, Noise, World, perfect
from scipy.optimize import least_squares
from timing import seconds, tell, timed

from app.identification import SpecimenSheet, identify_observations
from model.identification import FitOptions, ObservationSet
from model.identification.adequacy import assess_adequacy
from model.identification.joint_least_squares import FitCoordinates, joint_fit
from model.identification.live_fit import LiveFit
from model.identification.observations import FrequencyResponseObservation
from model.identification.paper_chain import PaperChainOptions, identify_by_paper_chain, linearized_errors
from model.identification.profile_likelihood import profile_interval
from model.membrane import skin
from model.parameters import Membrane, Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import amplifier_response
from tests.helpers.model.redrawn import resample


def typical_s(call: Callable[[], object], repeats: int) -> float:
    return median(seconds(call, repeats))


def many_runs(count: int = 100, points: int = 50) -> tuple[ObservationSet, FitOptions]:
    """Load test, steps, added masses and dwells of `points` without and on a membrane, `count` runs; a sheet and what is usually left out."""
    rng, few = np.random.default_rng(2), perfect(World(), Noise(), SHARED)
    dwells = [run for run in few.runs if isinstance(run, FrequencyResponseObservation)]
    runs = [run for run in few.runs if not isinstance(run, FrequencyResponseObservation)]
    f = np.linspace(40, 250, points)
    for i in range(count - len(runs)):
        base = dwells[i % len(dwells)]
        on = (
            None if base.elongation_m is None else skin(Membrane(), base.elongation_m / Membrane().L_m, tactor=Tactor())
        )
        moved = 1000 * exact_response(Tactor(), f, on)
        errors = 3e-3 * abs(moved) + 2e-7
        noise = errors * (rng.standard_normal(points) + 1j * rng.standard_normal(points))
        runs.append(
            replace(base, label=f"{base.label} {i}", frequency_hz=f, fundamental_m=moved + noise, errors_m=errors, harmonics_m=None,
                    harmonic_errors_m=None, good=np.ones(points, bool), drive_amplitude_v=2.5, drive_offset_v=2.5)
        )  # fmt: skip
    observed = ObservationSet(tuple(runs))
    return observed, SpecimenSheet("bench").fit_options(FitOptions(), observed)


def narrow_valley() -> dict[str, float]:
    """A campaign with a tenth to a thirtieth of the usual errors and a sheet of usual uncertainties."""
    noise = Noise(5e-4, 5e-4, 1e-4, 5e-9, 0.03, 1e-3)
    observed, _ = resample(perfect(World(creep=0.005), noise, SHARED), np.random.default_rng(3))
    options = SpecimenSheet("bench").fit_options(FitOptions(n=20), observed)
    begun = process_time()
    fit = joint_fit(observed, options, max_starts=1)
    ours_s = process_time() - begun
    problem = fit.problem.condensed
    place = FitCoordinates(problem, problem.start)
    evaluated = {"at": b"", "r": np.empty(0), "J": np.empty((0, 0)), "number": 0}

    def both(x: np.ndarray) -> dict[str, Any]:
        if evaluated["at"] != x.tobytes():
            theta = place.to_parameters(x)
            r, J = problem.evaluate(theta)
            evaluated.update(
                at=x.tobytes(), r=r, J=-J * place.parameter_derivatives(theta), number=evaluated["number"] + 1
            )
        return evaluated

    begun = process_time()
    found = least_squares(
        lambda x: both(x)["r"], place.start, lambda x: both(x)["J"], (place.lower_bounds, place.upper_bounds), "trf",
        xtol=1e-10, ftol=1e-10, gtol=1e-10, x_scale=place.steps, max_nfev=400,
    )  # fmt: skip
    trf_s = process_time() - begun
    return {
        "narrow valley: evaluations": fit.evaluations,
        "  of scipy's trf, at most 400": evaluated["number"],
        "  processor time, trf / joint fit": trf_s / ours_s,
        "  chi-square of trf above the joint fit's": 2 * found.cost - fit.cost,
    }


def kept() -> dict[str, float]:
    """An identification computed, and read again, in a cache of its own."""
    observed, sheet = perfect(World(), Noise(), SHARED), SpecimenSheet("bench")
    with TemporaryDirectory() as folder, patch.dict(os.environ, XDG_CACHE_HOME=folder):

        def call() -> object:
            return identify_observations("bench", observed, "joint", FitOptions(), sheet=sheet)

        computed_s = seconds(call, 1)[0]
        again_s = typical_s(call, 9)
        (file,) = Path(folder).rglob("*.result")
        plain_s = typical_s(lambda: pickle.loads(file.read_bytes()[32:]), 9)
    return {
        "kept identification, computed / read": computed_s / again_s,
        "  read / pickle alone": again_s / plain_s,
        "  read [ms]": 1e3 * again_s,
    }


def measure() -> dict[str, float]:
    measured, _ = resample(perfect(World(), Noise(), SHARED), np.random.default_rng(1))
    fit = joint_fit(measured)
    problem, scale = fit.problem, fit.parameter_scale
    bad = {n: 2.0 * v for n, v in zip(fit.names, fit.theta, strict=True) if n in fit.free_parameters}

    def by_differences() -> object:
        return least_squares(lambda u: problem.evaluate(u * scale)[0], problem.start / scale, method="trf", xtol=1e-10)

    dwells = [r for r in measured.runs if isinstance(r, FrequencyResponseObservation)]

    def closed(u: np.ndarray) -> np.ndarray:
        """The dwells alone, as a straightforward script computes them: the exact response, one run after the other."""
        t = Tactor(k2=u[0] * 7e-3, mu=-u[1] * 1.33e-5, m_add=u[2] * 7.73e-3, c0=u[3] * 159)
        m = Membrane(E_m=u[4] * 6.95e6, c_s_0=u[5] * 165, c_s_delta=u[6] * 5.48e4)
        rows = []
        for r in dwells:
            on = None if r.elongation_m is None else skin(m, r.elongation_m / m.L_m, tactor=t)
            gap = (1000 * exact_response(t, r.frequency_hz, on) - r.fundamental_m) / r.errors_m
            rows += [gap.real, gap.imag]
        return np.concatenate(rows)

    f = np.array([25, 50, 75, 100, 125, 150, 155, 160, 165, 170, 175, 180, 185, 190, 195, 200, 225, 250.0])
    F = amplifier_response(Tactor(m_add=8e-3), f).fundamental
    LiveFit().add_point(f[0], F[0], 1e-6)
    live = LiveFit()
    points = [live.add_point(*point).duration_s for point in zip(f, F, 1e-3 * abs(F), strict=True)]
    joint = typical_s(lambda: joint_fit(measured), 7)
    large = joint_fit(*many_runs())
    took = [timed(lambda: joint_fit(*many_runs()))[1] - timed(many_runs)[1] for _ in range(3)]
    return {
        "joint fit of 100 runs, processor [s]": median(took),
        "  rows": large.problem.evaluate(large.theta)[0].size,
        "  free parameters, those with priors among them": len(large.names),
        "joint fit of a full campaign [s]": joint,
        "  from a start a factor of two off [s]": typical_s(lambda: joint_fit(measured, fit.options.__class__(start=bad)), 3),
        "  evaluations": fit.evaluations,
        "finite differences by scipy / joint fit": typical_s(by_differences, 1) / joint,
        "closed form, dwells alone, by differences / joint fit": typical_s(lambda: least_squares(closed, np.ones(7)), 1) / joint,
        "live re-fit per point, median [ms]": 1e3 * median(points),
        "live re-fit per point, longest [ms]": 1e3 * max(points),
        **narrow_valley(),
        **kept(),
        "adequacy / joint fit": typical_s(lambda: assess_adequacy(fit), 3) / joint,
        "profile interval / joint fit": typical_s(lambda: profile_interval(fit, "c0"), 1) / joint,
        "the paper's chain with errors / joint fit": typical_s(
            lambda: linearized_errors(measured, PaperChainOptions(), identify_by_paper_chain(measured)), 1
        ) / joint,
    }  # fmt: skip


GOALS = (
    ("joint fit of 100 runs, processor [s]", "<", 5.0),
    ("joint fit of a full campaign [s]", "<", 1.0),
    ("live re-fit per point, longest [ms]", "<", 50.0),
    ("kept identification, computed / read", ">=", 10.0),
)


if __name__ == "__main__":
    tell(__doc__.splitlines()[0], measure, GOALS)
