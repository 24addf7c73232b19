"""What the model says each run should have shown, with the slopes to every free parameter.

The response to a sine has exact slopes (`receptance`); what feeds it, and every closed formula, is differentiated
centrally at 1e-6 of its scale, all parameters in one array operation.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from model.amplifier import AmplifierMap
from model.drive import series
from model.galerkin import matrices
from model.identification import names as known
from model.identification.observations import (
    Acts,
    Campaign,
    FrequencyResponse,
    MassResonance,
    MembraneSag,
    Observation,
    StaticLoading,
    VoltageSteps,
)
from model.identification.receptance import Dense, Factors
from model.membrane import sag
from model.parameters import Beam, Membrane
from model.poles import modal_form, receptance
from model.quantity import quantities
from model.response import orders_for, peak_to_peak
from model.skin import point_stiffness
from model.statics import load_compliance, voltage_gain

Array = NDArray[np.float64]
Complex = NDArray[np.complex128]
Values = Mapping[str, float]
Sets = dict[str, Any]
"""Every parameter by name: arrays (S,), first the point itself, then all steps up, then all steps down."""

STEP = 1e-6


class Predicted(NamedTuple):
    """One run's usable points: prediction (F,), real or complex, and its slopes (P, F)."""

    values: Any
    slopes: Any


def observed(run: Observation) -> tuple[Any, Array]:
    """What a fit compares and its standard error, (F,), usable points only."""
    good = run.use
    match run:
        case MassResonance():
            return run.frequency_hz[good], run.errors_hz[good]
        case FrequencyResponse(fundamental_m=None):
            assert run.peak_to_peak_m is not None
            assert run.peak_to_peak_errors_m is not None
            return run.peak_to_peak_m[good], run.peak_to_peak_errors_m[good]
        case FrequencyResponse():
            assert run.fundamental_m is not None
            assert run.errors_m is not None
            return run.fundamental_m[good], run.errors_m[good]
    return run.deflection_m[good], run.errors_m[good]


class Forward:
    """Predictions for one campaign as functions of the parameters `names`.

    Args:
        campaign: the runs.
        names: free parameters and shared errors, in the order of every `theta`.
        fixed: values of everything else.
        tied: name -> (other, factor): always that many times the other.
        amplifier: from volts at the input to volts on the specimen.
        n: shape functions.
    """

    def __init__(
        self,
        campaign: Campaign,
        names: Sequence[str],
        fixed: Mapping[str, float | None],
        tied: Mapping[str, tuple[str, float]],
        amplifier: AmplifierMap,
        n: int,
    ) -> None:
        self.campaign, self.names, self.n = campaign, tuple(names), n
        self._fixed, self._tied, self._amplifier = dict(fixed), dict(tied), amplifier
        self._scale = np.array([known.scale(name, known.start_value(name, self._fixed)) for name in self.names])
        self._responses = campaign.of(FrequencyResponse)
        self._drives = {r.label: self._drive(r) for r in self._responses if r.fundamental_m is not None}

    def values(self, theta: Array) -> dict[str, float | None]:
        """Every parameter by name at `theta`."""
        return {k: None if v is None else float(v) for k, v in self._join(theta).items()}

    def predict(self, theta: Array) -> list[Predicted]:
        """One entry a run, in the campaign's order."""
        P = theta.size
        self._h = STEP * np.maximum(np.abs(theta), self._scale)
        table = np.tile(theta, (2 * P + 1, 1))
        table[1 : P + 1] += np.diag(self._h)
        table[P + 1 :] -= np.diag(self._h)
        v = self._join(table.T)
        self._beam_of = self._beam(v)
        fundamentals = self._fundamentals(v)
        return [fundamentals.get(run.label) or self._one(run, v) for run in self.campaign.runs]

    def _join(self, columns: Array) -> Sets:
        v: Sets = self._fixed | dict(zip(self.names, columns, strict=True))
        for name, (other, factor) in self._tied.items():
            v[name] = factor * v[other]
        return v

    def _slopes(self, y: Any) -> Any:
        """(S, ...) -> (P, ...)."""
        P = len(self.names)
        y = np.broadcast_to(y, (2 * P + 1, *np.shape(y)[1:])) if np.ndim(y) else np.full(2 * P + 1, y)
        return (y[1 : P + 1] - y[P + 1 :]) / (2 * self._h).reshape(-1, *(1,) * (y.ndim - 1))

    def _beam(self, v: Sets, mass: Any = None) -> Beam:
        k1 = v["E_Al"] * v["b_Al"] * v["h_Al"] ** 3 / 12
        eta = (v["m_add"] if mass is None else mass) / (2 * (v["L"] - v["L2"]))
        return Beam(v["L"], v["L1"], v["L2"], v["rho1"], v["rho2"], eta, v["c0"], k1, v["k2"], v["mu"])

    def _shared(self, run: Observation, v: Sets, acts_on: Acts) -> Any:
        """Sum of the run's common errors of one kind, (S,) or 0."""
        return sum((v[e.name] for e in run.common if e.acts_on == acts_on), start=np.zeros(2 * len(self.names) + 1))

    def _one(self, run: Observation, v: Sets) -> Predicted:
        gain = 1 + self._shared(run, v, "displacement")
        good = run.use
        match run:
            case StaticLoading():
                sign = {"mfc": 1.0, "aluminium": -1.0, "both": 0.0}[run.side]
                per_newton = load_compliance(self._beam_of) * gain * (1 + self._shared(run, v, "load"))
                y = np.multiply.outer(per_newton * (1 + sign * v["asymmetry"]), run.load_n[good])
            case VoltageSteps():
                per_volt = voltage_gain(self._beam_of) * gain * (1 + self._shared(run, v, "volts"))
                y = np.multiply.outer(per_volt, self._amplifier.specimen_v(run.input_v[good]))
            case MembraneSag():
                return self._sag(run, v, gain)
            case MassResonance():
                return self._resonances(run, v)
            case FrequencyResponse():
                y = self._peak_to_peak(run, v, gain)
        return Predicted(y[0], self._slopes(y))

    def _sag(self, run: MembraneSag, v: Sets, gain: Array) -> Predicted:
        rows = range(2 * len(self.names) + 1)
        fields = [q.name for q in quantities(Membrane)]
        table = np.array([np.broadcast_to(v[name], len(rows)) for name in fields]).T
        if run.geometry is not None:
            own = [getattr(run.geometry, name) for name in fields]
            table = np.where([name == "E_m" for name in fields], table, own)
        table[:, 3] = np.maximum(table[:, 3], 1e-3)
        different, where = np.unique(table, axis=0, return_inverse=True)
        centres = []
        for row in different:
            L_m, b_m, h_m, E_m = np.abs(row[:4]).tolist()
            strip = Membrane(L_m, b_m, h_m, E_m, 0.0, 0.0)
            centres.append(sag(strip, run.load(strip), run.delta).centre_m)
        y = np.multiply.outer(np.array(centres)[where.ravel()] * gain, np.ones(int(run.use.sum())))
        return Predicted(y[0], self._slopes(y))

    def _resonances(self, run: MassResonance, v: Sets) -> Predicted:
        good = run.use
        mass = np.add.outer(np.asarray(run.mass_kg)[good], self._shared(run, v, "mass")).T  # (S, F)
        sets = mass.shape[0]
        factors = [self._factors(self._beam(v, column), 0.0, 0.0, sets) for column in mass.T]
        stacked, slopes = self._stack(factors)
        l1, l2 = self._l(v)

        def find(l1: float, l2: float) -> tuple[Array, Factors]:
            dense = Dense(l1, l2, self.n)
            if run.meaning == "peak":
                return dense.peak(stacked)
            omega, t = dense.undamped(stacked)
            per = t / (2 * omega[:, None])
            return omega, Factors(-(omega**2)[:, None] * per, 0 * per, per)

        omega, s = find(l1[0], l2[0])
        d = sum(np.einsum("rj,prj->pr", own, moved) for own, moved in zip(s, slopes, strict=True))
        for move, dl in self._geometry(l1, l2):
            up, down = (find(*point)[0] for point in move)
            d = d + np.multiply.outer(dl, (up - down) / (2 * STEP))
        return Predicted(omega / (2 * np.pi), d / (2 * np.pi))

    def _factors(self, b: Beam, k_s: Any, c_s: Any, sets: int) -> Factors:
        """(S, 6) each."""
        zero = np.zeros(sets)
        L, L3 = b.L, b.L**3

        def table(*columns: Any) -> Array:
            return np.stack([zero + c for c in columns], axis=-1)

        return Factors(
            table(L * b.rho1, L * b.rho2, L * (b.rho2 + b.eta), 0, 0, 0),
            table(L * b.c0, L * b.c0, L * (b.c0 + c_s), 0, 0, 0),
            table(0, 0, L * k_s, b.k1 / L3, b.k2 / L3, b.k2 / L3),
        )

    def _stack(self, factors: Sequence[Factors]) -> tuple[Factors, Factors]:
        """Values (R, 6) and slopes (P, R, 6) of one entry a row."""
        tables = [np.stack([f[i] for f in factors], axis=1) for i in range(3)]
        return Factors(*(t[0] for t in tables)), Factors(*(self._slopes(t) for t in tables))

    def _l(self, v: Sets) -> tuple[Array, Array]:
        sets = 2 * len(self.names) + 1
        return (np.broadcast_to(v["L1"] / v["L"], sets), np.broadcast_to(v["L2"] / v["L"], sets))

    def _geometry(self, l1: Array, l2: Array) -> list[tuple[tuple[tuple[float, float], ...], Any]]:
        """Points to look at either side where L1 / L or L2 / L depends on a free parameter, with its slopes."""
        a, b = float(l1[0]), float(l2[0])
        moves: list[tuple[tuple[tuple[float, float], ...], Any]] = []
        for ratio, ends in ((l1, ((a + STEP, b), (a - STEP, b))), (l2, ((a, b + STEP), (a, b - STEP)))):
            if np.ptp(ratio):
                moves.append((ends, self._slopes(ratio)))
        return moves

    def skin(self, run: FrequencyResponse, v: Sets) -> tuple[Any, Any]:
        """k_s and c_s of a run."""
        if run.elongation_m is None:
            return 0.0, 0.0
        delta = run.elongation_m / v["L_m"]
        length = v["L"] - v["L2"] if v["contact_length"] is None else v["contact_length"]
        k_s, c_s = v.get(known.at("k_s", run.elongation_m)), v.get(known.at("c_s", run.elongation_m))
        if k_s is None:
            k_s = point_stiffness(v["L_m"], v["b_m"], v["h_m"], v["E_m"], delta) / length
        return k_s, v["c_s_delta"] * delta + v["c_s_0"] if c_s is None else c_s

    def plain(self, run: FrequencyResponse, v: Sets) -> tuple[Factors, float]:
        """Factors (1, 6) of a run, and metres per volt and unit of `Dense.response`, for plain values of all parameters."""
        factors = self._factors(self._beam(v, run.added_mass_kg), *self.skin(run, v), 1)
        return factors, -float(v["mu"]) / float(v["L"])

    def _drive(self, run: FrequencyResponse) -> Complex:
        """Fundamental of the volts on the specimen per point, against the sine at the input."""
        pairs = np.stack((run.drive_amplitude_v, run.drive_offset_v), axis=-1)[run.use]
        different, where = np.unique(pairs, axis=0, return_inverse=True)
        volts = [1j * series("sine", a, o, self._amplifier, 1)[1] for a, o in different]
        return np.array(volts)[where.ravel()]

    def _fundamentals(self, v: Sets) -> dict[str, Predicted]:
        runs = [r for r in self._responses if r.fundamental_m is not None]
        if not runs:
            return {}
        sets = 2 * len(self.names) + 1
        stacked, slopes = self._stack(
            [self._factors(self._beam(v, r.added_mass_kg), *self.skin(r, v), sets) for r in runs]
        )
        sizes = [int(r.use.sum()) for r in runs]
        of = np.repeat(np.arange(len(runs)), sizes)
        omega = 2 * np.pi * np.concatenate([r.frequency_hz[r.use] for r in runs])
        l1, l2 = self._l(v)
        rows = stacked.rows(of)
        H, t = Dense(l1[0], l2[0], self.n).response(rows, omega)
        z = slopes.K[:, of] - omega[:, None] ** 2 * slopes.M[:, of] + 1j * omega[:, None] * slopes.C[:, of]
        dH = -np.einsum("rj,prj->pr", t, z)
        for ends, dl in self._geometry(l1, l2):
            up, down = (Dense(*point, self.n).response(rows, omega)[0] for point in ends)
            dH += np.multiply.outer(dl, (up - down) / (2 * STEP))
        out = {}
        for run, stop, size in zip(runs, np.cumsum(sizes), sizes, strict=True):
            here = slice(stop - size, stop)
            moment = (
                -v["mu"] / v["L"] * (1 + self._shared(run, v, "volts")) * (1 + self._shared(run, v, "displacement"))
            )
            late = self._shared(run, v, "delay")
            w = omega[here]
            A = self._drives[run.label] * np.exp(-1j * w * late[0])
            y = A * moment[0] * H[here]
            dy = A * (np.multiply.outer(self._slopes(moment), H[here]) + moment[0] * dH[:, here])
            dy = dy - 1j * np.multiply.outer(self._slopes(late), w) * y
            out[run.label] = Predicted(y, dy) if np.asarray(run.fundamental_m).dtype.kind == "c" else _modulus(y, dy)
        return out

    def _peak_to_peak(self, run: FrequencyResponse, v: Sets, gain: Array) -> Array:
        """Max - min with every harmonic of the amplifier superposed, (S, F); from the poles, for whole sets at once."""
        beam = self._beam(v, run.added_mass_kg)
        sets = gain.size
        b = Beam(*(np.broadcast_to(a, sets) for a in beam))
        m = matrices(b, *self.skin(run, v), self.n)
        form = modal_form(m.M, m.C, m.K, m.B, 2 * m.B_F)
        f = run.frequency_hz[run.use]
        k = np.arange(orders_for(f) + 1)
        H = receptance(form, np.outer(2 * np.pi * f, k).ravel()).reshape(sets, f.size, k.size)
        drives = np.stack((run.drive_amplitude_v, run.drive_offset_v), axis=-1)[run.use]
        V = np.array([series("sine", a, o, self._amplifier, k.size - 1) for a, o in drives])
        width = np.stack([peak_to_peak(rows * V) for rows in H])
        return np.asarray(width * (gain * (1 + self._shared(run, v, "volts")))[:, None])


def _modulus(y: Complex, dy: Complex) -> Predicted:
    size = np.abs(y)
    return Predicted(size, (y.conj() * dy).real / size)


def with_values(campaign: Campaign, forward: "Forward", theta: Array) -> Campaign:
    """The same campaign with the model's own predictions in place of what was observed; a plan, or a check."""
    runs = []
    for run, predicted in zip(campaign.runs, forward.predict(theta), strict=True):
        match run:
            case MassResonance():
                name = "frequency_hz"
            case FrequencyResponse(fundamental_m=None):
                name = "peak_to_peak_m"
            case FrequencyResponse():
                name = "fundamental_m"
            case _:
                name = "deflection_m"
        old = np.array(getattr(run, name), dtype=np.result_type(getattr(run, name), predicted.values))
        old[run.use] = predicted.values
        more: Any = {name: old}
        runs.append(replace(run, **more))
    return Campaign(tuple(runs))
