"""How fast the model is, as ratios measured in one run: python benchmarks/bench_model.py [--json]

Poles and residues (the eigenproblem included) against a plain solve per frequency and against a Hermite beam FEM of
scikit-fem refined to equal accuracy; ten thousand parameter sets; the memory of a study.
"""

import tracemalloc
from contextlib import closing
from itertools import pairwise
from statistics import median

import numpy as np
from skfem import Basis, BilinearForm, ElementLineHermite, MeshLine
from skfem.helpers import dd
from timing import seconds, tell

from model.parameters import Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response, system_matrices
from model.studies.parameter_study import Study

F = np.linspace(1, 500, 1000)
T = Tactor()


def solve_loop() -> np.ndarray:
    """The textbook way: matrices once, one linear solve per frequency."""
    m = system_matrices(T)
    H = np.empty(F.size, complex)
    for i, w in enumerate(2 * np.pi * F):
        H[i] = 2 * m.B_F @ np.linalg.solve(m.K - w * w * m.M + 1j * w * m.C, m.B)
    return H


def fem(per_segment: int) -> np.ndarray:
    """Hermite beam elements, nodes on L1 and L2, assembled by scikit-fem and solved densely per frequency."""
    ends = (0.0, T.L1, T.L2, T.L)
    x = np.unique(np.concatenate([np.linspace(a, b, per_segment + 1) for a, b in pairwise(ends)]))
    basis = Basis(MeshLine(x), ElementLineHermite(), intorder=6)

    def per_length(values: tuple[float, float, float], at: np.ndarray) -> np.ndarray:
        return np.select([at < T.L1, at < T.L2], values[:2], values[2])

    mass = BilinearForm(lambda u, v, w: per_length((T.rho1, T.rho2, T.rho2 + T.eta), w.x[0]) * u * v).assemble(basis)
    loss = BilinearForm(lambda u, v, _: T.c0 * u * v).assemble(basis)
    bend = BilinearForm(lambda u, v, w: per_length((T.k1, T.k2, T.k2), w.x[0]) * dd(u)[0][0] * dd(v)[0][0]).assemble(
        basis
    )
    deflection, slope = basis.nodal_dofs
    order = np.argsort(basis.mesh.p[0])
    deflection, slope = deflection[order], slope[order]
    free = np.setdiff1d(np.arange(basis.N), [deflection[0], slope[0], slope[-1]])
    B = np.zeros(basis.N)
    B[slope[per_segment]] = -T.mu
    M, C, K = (A[free][:, free].toarray() for A in (mass, loss, bend))
    centre = int(np.flatnonzero(free == deflection[-1])[0])
    H = np.empty(F.size, complex)
    for i, w in enumerate(2 * np.pi * F):
        H[i] = np.linalg.solve(K - w * w * M + 1j * w * C, B[free])[centre]
    return H


def refined(target: float, exact: np.ndarray) -> int:
    """Fewest elements per segment whose error is at most `target`."""
    return next(n for n in range(1, 40) if abs(fem(n) / exact - 1).max() <= target)


def study(sets: int) -> Study:
    side = int(sets**0.5)
    return Study(
        {"k2": tuple(np.linspace(5e-3, 9e-3, side)), "c0": tuple(np.linspace(100, 200, sets // side))},
        tuple(np.linspace(1, 500, 200)),
        measure="receptance",
    )


def peak_mb(sets: int) -> float:
    tracemalloc.start()
    with closing(study(sets).chunks()) as blocks:
        for _ in blocks:
            pass
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return peak / 1e6


def measure() -> dict[str, float]:
    frequency_response(T, F)  # the Gram integrals of this geometry, once
    exact = exact_response(T, F)
    error = float(abs(frequency_response(T, F) / exact - 1).max())
    assert np.allclose(frequency_response(T, F), solve_loop(), rtol=1e-9)
    elements = refined(error, exact)
    rounds = [
        (
            median(seconds(lambda: frequency_response(T, F), 200)),
            median(seconds(solve_loop, 3)),
            median(seconds(lambda: fem(elements), 1)),
        )
        for _ in range(7)
    ]
    best = min(r[0] for r in rounds)
    study(100).run()
    return {
        "one set, 1000 frequencies [ms]": 1e3 * best,
        "same, median of rounds [ms]": 1e3 * median(r[0] for r in rounds),
        "solve loop [ms]": 1e3 * median(r[1] for r in rounds),
        "solve loop / poles and residues": median(r[1] / r[0] for r in rounds),
        "error of both to the closed form": error,
        "FEM elements per segment for that error": elements,
        "FEM / poles and residues": median(r[2] / r[0] for r in rounds),
        "10 000 sets x 200 frequencies [s]": min(seconds(lambda: study(10_000).run(), 3)),
        "memory of a study of 2 500 sets [MB]": peak_mb(2_500),
        "memory of a study of 10 000 sets [MB]": peak_mb(10_000),
    }


GOALS = (
    ("one set, 1000 frequencies [ms]", "<", 0.3),
    ("solve loop / poles and residues", ">=", 30.0),
    ("10 000 sets x 200 frequencies [s]", "<", 5.0),
)


if __name__ == "__main__":
    tell(__doc__.splitlines()[0], measure, GOALS)
