"""Speed of the model, as ratios measured in one run: python benchmarks/bench_model.py [--json]

Poles and residues (the eigenproblem included) against the same response by one batched LAPACK solve over all frequencies, by
`numpy.linalg.eig` with residues, and by a Hermite beam FEM of scikit-fem refined to equal accuracy and computed with the same
poles and residues; ten thousand parameter sets against batched `eig` with residues; the memory of a study.
"""

import os
import tracemalloc
from contextlib import closing
from itertools import pairwise
from statistics import median

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the program does, before numpy is imported

import numpy as np
from timing import seconds, tell, timed

from model.beam import Matrices, matrices, modal_form, receptance
from model.parameters import Tactor
from model.response.closed_form import exact_response
from model.response.harmonic_response import frequency_response, system_matrices
from model.studies.parameter_study import Study

F = np.linspace(1, 500, 1000)
T = Tactor()


def batched_solve() -> np.ndarray:
    """One call of LAPACK for all frequencies."""
    m = system_matrices(T)
    w = 2 * np.pi * F[:, None, None]
    q = np.linalg.solve(m.K - w * w * m.M + 1j * w * m.C, np.broadcast_to(m.B[:, None], (F.size, m.B.size, 1)))
    return 2 * (q[..., 0] @ m.B_F)


def eig_and_residues(m: Matrices, f: np.ndarray) -> np.ndarray:
    """State matrix, `numpy.linalg.eig` and the sum over the poles; leading axes are parameter sets."""
    n = m.B.shape[-1]
    A = np.zeros((*m.M.shape[:-2], 2 * n, 2 * n))
    A[..., :n, n:] = np.eye(n)
    A[..., n:, :n], A[..., n:, n:] = -np.linalg.solve(m.M, m.K), -np.linalg.solve(m.M, m.C)
    s, V = np.linalg.eig(A)
    drive = np.zeros((*m.B.shape[:-1], 2 * n, 1))
    drive[..., n:, 0] = np.linalg.solve(m.M, m.B[..., None])[..., 0]
    r = 2 * (m.B_F[..., None, :] @ V[..., :n, :])[..., 0, :] * np.linalg.solve(V, drive)[..., 0]
    return (r[..., None, :] @ (1 / (2j * np.pi * f - s[..., None])))[..., 0, :]


def fem(per_segment: int) -> np.ndarray:
    """Hermite beam elements, nodes on L1 and L2, assembled by scikit-fem; the response by poles and residues."""
    return receptance(modal_form(*fem_matrices(per_segment)), 2 * np.pi * F)


def fem_matrices(per_segment: int) -> tuple[np.ndarray, ...]:
    """M, C, K, the drive of a volt and the row of the centre."""
    from skfem import Basis, BilinearForm, ElementLineHermite, MeshLine
    from skfem.helpers import dd

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
    output = np.zeros(free.size)
    output[centre] = 1
    return M, C, K, B[free], output


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


def sets_by_eig() -> np.ndarray:
    """The ten thousand sets of `study` by batched `eig`, in blocks that fit the cache."""
    s = study(10_000)
    k2, c0 = (v.ravel() for v in np.meshgrid(*s.vary.values(), indexing="ij"))
    out = np.empty((k2.size, len(s.frequency_hz)), complex)
    for at in range(0, k2.size, 142):
        block = {"k2": k2[at : at + 142], "c0": c0[at : at + 142]}
        beam, k_s, c_s = s.specimen.coefficients(block)
        out[at : at + 142] = eig_and_residues(matrices(beam, k_s, c_s, s.n), np.asarray(s.frequency_hz))
    return out


def measure() -> dict[str, float]:
    frequency_response(T, F)  # the Gram integrals of this geometry, once
    exact = exact_response(T, F)
    ours = frequency_response(T, F)
    error = float(abs(ours / exact - 1).max())
    for other in (batched_solve(), eig_and_residues(system_matrices(T), F)):
        assert np.allclose(ours, other, rtol=1e-9)
    assert np.allclose(study(10_000).run().values.reshape(-1, 200)[::999], sets_by_eig()[::999], rtol=1e-9)
    elements = refined(error, exact)
    parts = fem_matrices(elements)
    ways = {
        "ours": (lambda: frequency_response(T, F), 200),
        "batched solve": (batched_solve, 20),
        "eig": (lambda: eig_and_residues(system_matrices(T), F), 100),
        "FEM": (lambda: receptance(modal_form(*parts), 2 * np.pi * F), 200),
    }
    rounds = [{name: median(seconds(call, count)) for name, (call, count) in ways.items()} for _ in range(7)]
    sets = [(timed(lambda: study(10_000).run())[1], timed(sets_by_eig)[1]) for _ in range(3)]
    return {
        "one set, 1000 frequencies [ms]": 1e3 * min(r["ours"] for r in rounds),
        "same, median of rounds [ms]": 1e3 * median(r["ours"] for r in rounds),
        "one batched solve / poles and residues": median(r["batched solve"] / r["ours"] for r in rounds),
        "numpy's eig and residues / poles and residues": median(r["eig"] / r["ours"] for r in rounds),
        "error of all to the closed form": error,
        "FEM elements per segment for that error": elements,
        "FEM with the same solver / poles and residues": median(r["FEM"] / r["ours"] for r in rounds),
        "10 000 sets x 200 frequencies, processor [s]": min(a for a, _ in sets),
        "batched eig and residues / 10 000 sets": median(b / a for a, b in sets),
        "memory of a study of 2 500 sets [MB]": peak_mb(2_500),
        "memory of a study of 10 000 sets [MB]": peak_mb(10_000),
    }


GOALS = (
    ("one set, 1000 frequencies [ms]", "<", 0.3),
    ("one batched solve / poles and residues", ">=", 3.0),
    ("numpy's eig and residues / poles and residues", ">=", 1.2),
    ("10 000 sets x 200 frequencies, processor [s]", "<", 0.5),
)


if __name__ == "__main__":
    tell(__doc__.splitlines()[0], measure, GOALS)
