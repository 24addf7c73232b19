"""Forward model: predictions of every run and their derivatives to the free parameters.

The response to a sine has exact derivatives (`receptance`); its inputs and every closed formula are differentiated centrally at
1e-6 of their scale, all parameters in one array operation. `v` holds every parameter by name: plain numbers, or arrays (S,) for S
sets of parameters.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from model import AmplifierMap, Array, Beam, Complex, Membrane, beam_from_values, parameter_specs, point_stiffness, sag
from model.beam import matrices, modal_form, receptance
from model.identification import nonidealities
from model.identification import observations as observed
from model.identification import parameters as fit_parameters
from model.identification.receptance import Factors, Peak, ReceptanceSolver
from model.response import fourier_series, harmonic_orders, load_compliance, peak_to_peak, voltage_gain

Values = Mapping[str, Any]


def skin_from_values(observation: observed.FrequencyResponseObservation, v: Values) -> tuple[Any, Any]:
    """k_s in N/m^2 and c_s in kg/(m s) during a run; 0 for a free tactor."""
    if observation.elongation_m is None:
        return 0.0, 0.0
    errors = (v.get(e.name, 0.0) for e in observation.shared_errors if e.acts_on == "elongation")
    delta = sum(errors, start=observation.elongation_m * (1 - v["elongation_slip"]) + v["elongation_offset"]) / v["L_m"]
    length = v["L"] - v["L2"] if v["contact_length"] is None else v["contact_length"]
    k_s, c_s = (
        v.get(fit_parameters.elongation_parameter(symbol, observation.elongation_m)) for symbol in ("k_s", "c_s")
    )
    if k_s is None:
        membrane = v["L_m"], v["b_m"], v["h_m"], v["E_m"]
        k_s = point_stiffness(*membrane, np.abs(delta)) / length
        if np.any(np.asarray(delta) < 0):  # an error of an elongation of 0: the tangent continues below 0
            k_s = np.where(np.asarray(delta) < 0, 2 * point_stiffness(*membrane, 0.0) / length - k_s, k_s)
    return k_s, v["c_s_delta"] * delta + v["c_s_0"] if c_s is None else c_s


def beam_under(run: observed.FrequencyResponseObservation, v: Values) -> Beam:
    """The symbols of Eqs. (1)-(6) for a run: with m_add, or with the moving share of the mass put in."""
    return beam_from_values(v, None if run.added_mass_kg is None else nonidealities.acting_mass(v, run.added_mass_kg))


def equation_factors(beam: Beam, skin: tuple[Any, Any], sets: int) -> Factors:
    """Factors of the Gram parts of Eq. (14), (S, 6) each in M, C and K."""
    L, L3 = beam.L, beam.L**3
    k_s, c_s = skin
    M, C, K = np.zeros((3, sets, 6))
    M[:, 0], M[:, 1], M[:, 2] = L * beam.rho1, L * beam.rho2, L * (beam.rho2 + beam.eta)
    C[:, 0] = C[:, 1] = L * beam.c0
    C[:, 2] = L * (beam.c0 + c_s)
    K[:, 2], K[:, 3], K[:, 4] = L * k_s, beam.k1 / L3, beam.k2 / L3
    K[:, 5] = K[:, 4]
    return Factors(M, C, K)


GeometryPair = tuple[tuple[float, float], tuple[float, float]]
"""Two neighbours of a geometry, L1 / L and L2 / L."""

RELATIVE_STEP = 1e-6
"""Step of central differences, as a share of a parameter's scale, or of a ratio of lengths."""


class FiniteDifferences:
    """S = 2 P + 1 sets of all parameters: the point, then a step up for each of the P free parameters, then the steps down.

    Args:
        theta: the point, (P,).
        scale: scale of each free parameter, (P,), empty for values without slopes; a step is a share of the scale, or of the parameter if
            that is larger.
        join: function from the free parameters, (P, S), to all parameters by name.
        reference_c: temperature of the parameters, degrees Celsius, if known.
    """

    def __init__(
        self, theta: Array, scale: Array, all_values: Callable[[Array], Values], reference_c: float | None
    ) -> None:
        P = scale.size
        self.set_count = 2 * P + 1
        self._steps = RELATIVE_STEP * np.maximum(np.abs(theta[:P]), scale)
        table = np.tile(theta, (self.set_count, 1))
        table[1 : P + 1, :P] += np.diag(self._steps)
        table[P + 1 :, :P] -= np.diag(self._steps)
        self.values = all_values(table.T)
        """Every parameter by name: a number if fixed, else (S,)."""
        self._reference_c = reference_c

    def of_run(self, run: observed.Observation) -> Values:
        """Return every parameter as it is in a run."""
        return nonidealities.values_of_run(self.values, run, self._reference_c)

    def derivatives(self, y: Any) -> Any:
        """Derivatives by the free parameters from the values of all sets: (S, ...) -> (P, ...)."""
        P = self._steps.size
        if np.ndim(y) == 0 or len(y) != self.set_count:
            y = np.broadcast_to(y, (self.set_count, *np.shape(y)[1:]))
        return (y[1 : P + 1] - y[P + 1 :]) / (2 * self._steps).reshape(-1, *(1,) * (y.ndim - 1))

    def shared_error(self, observation: observed.Observation, acts_on: observed.ErrorTarget) -> Array:
        """Return the sum of a run's shared errors of one kind, (S,)."""
        errors = (self.values[e.name] for e in observation.shared_errors if e.acts_on == acts_on)
        return np.asarray(sum(errors, start=np.zeros(self.set_count)))

    def input_error(self, observation: observed.Observation, acts_on: observed.ErrorTarget, inputs: Array) -> Array:
        """Return the sum of the errors of one kind at each of a run's inputs (F,), such as its loads: (S, F)."""
        total = np.zeros((self.set_count, inputs.size))
        for e in observation.shared_errors:
            if e.acts_on == acts_on:
                total += np.multiply.outer(np.broadcast_to(self.values[e.name], self.set_count), e.acts_at(inputs))
        return total

    def frequency_error(self, run: observed.FrequencyResponseObservation) -> Array:
        """Return the errors of the frequencies at a run's usable points, Hz, (S, F)."""
        f = run.frequency_hz[run.usable]
        return self.input_error(run, "frequency", f) + np.multiply.outer(self.shared_error(run, "clock"), f)

    def rest_drift(self, run: observed.VoltageStepsObservation) -> Any:
        """Return the contribution of the drifts at rest at each usable point, (S, F); 0 for a run without times."""
        total: Any = 0.0
        for e in run.shared_errors:
            if e.acts_on == "rest" and e.at is not None and run.history is not None:
                drift = run.history.easing_drift(e.at)[run.usable]
                total = total + np.multiply.outer(np.broadcast_to(self.values[e.name], self.set_count), drift)
        return total

    def stack(self, factors: Sequence[Factors]) -> tuple[Factors, Factors]:
        """Values (R, 6) and slopes (P, R, 6) of the entries, (S, 6) each, one per row."""
        tables = [np.stack([f[i] for f in factors], axis=1) for i in range(3)]
        return Factors(*(t[0] for t in tables)), Factors(*(self.derivatives(t) for t in tables))

    def geometry(self, v: Values) -> tuple[float, float]:
        """Return L1 / L and L2 / L at the point, of the parameters of a run."""
        l1, l2 = self._length_ratios(v)
        return float(l1[0]), float(l2[0])

    def geometry_derivatives(self, v: Values) -> list[tuple[GeometryPair, Any]]:
        """Return neighbouring geometries where L1 / L or L2 / L depends on a free parameter, with its derivatives (P,)."""
        l1, l2 = self._length_ratios(v)
        a, b = self.geometry(v)
        ends: tuple[GeometryPair, GeometryPair] = (
            ((a + RELATIVE_STEP, b), (a - RELATIVE_STEP, b)),
            ((a, b + RELATIVE_STEP), (a, b - RELATIVE_STEP)),
        )
        return [(each, self.derivatives(ratio)) for ratio, each in zip((l1, l2), ends, strict=True) if np.ptp(ratio)]

    def _length_ratios(self, v: Values) -> tuple[Array, Array]:
        return np.broadcast_to(v["L1"] / v["L"], self.set_count), np.broadcast_to(v["L2"] / v["L"], self.set_count)


class Prediction(NamedTuple):
    """One run's usable points: prediction (F,), real or complex, and its slopes (P, F)."""

    values: Any
    derivatives: Any

    def take(self, points: Any) -> "Prediction":
        """The points `points`, which may be repeated."""
        return Prediction(self.values[points], self.derivatives[:, points])


class ForwardModel:
    """Predictions for one campaign as functions of the parameters `names`.

    Args:
        campaign: the runs.
        names: free parameters and shared errors, in the order of every `theta`.
        fixed: values of all other parameters.
        tied: name -> (other, factor): the parameter is factor times the other.
        amplifier: map from volts at the input to volts on the specimen.
        n: number of shape functions.
    """

    def __init__(
        self,
        observations: observed.ObservationSet,
        names: Sequence[str],
        fixed: Mapping[str, float | None],
        tied: Mapping[str, tuple[str, float]],
        amplifier: AmplifierMap,
        n: int,
    ) -> None:
        self.observations, self.names, self.n = observations, tuple(names), n
        self._fixed, self._tied, self._amplifier = dict(fixed), dict(tied), amplifier
        self._scale = np.array(
            [fit_parameters.typical_size(name, fit_parameters.start_value(name, self._fixed)) for name in self.names]
        )
        self.nonideal = nonidealities.NonidealResponse(observations, amplifier)
        self.effects = [
            name for name in ("stiffening", "gain_drift") if name in names or name in tied or self._fixed.get(name)
        ]
        """Effects that depend on the measured amplitude and time of a point."""
        self._conditions = observed.conditions_of(observations, self.effects)
        self.rows = observed.ErrorRows(observations.runs)
        places = dict(zip((run.label for run in observations.runs), self.rows.parts, strict=True))
        self._into = [
            (
                np.concatenate([np.arange(places[label].start, places[label].stop) for label in each.places]),
                np.concatenate(list(each.places.values())),
            )
            for each in self._conditions
        ]
        """Points of all runs under each condition, and the point of the condition for each of them."""
        shared = {label for each in self._conditions for label in each.places}
        self._others = [(run, places[run.label]) for run in observations.runs if run.label not in shared]
        self._readings: dict[str, Any] = {}
        """Shapes over all points of the errors of readings."""
        for run in observations.runs:
            for error in run.shared_errors:
                if error.acts_on == "reading":
                    shape = self._readings.setdefault(error.name, np.zeros(self.rows.observed.size, complex))
                    shape[places[run.label]] = run.shapes[error.name][run.usable]
        self._drives = [1j * nonidealities.specimen_harmonic(each.run, amplifier) for each in self._conditions]

    def values(self, theta: Array) -> dict[str, float | None]:
        """Every parameter by name at `theta`."""
        return {k: None if v is None else float(v) for k, v in self._all_values(theta).items()}

    def predict(self, theta: Array, slopes: bool = True) -> list[Prediction]:
        """One entry per run, in the campaign's order; several times as fast without slopes."""
        every = self.predict_all(theta, slopes)
        runs = zip(self.observations.runs, self.rows.parts, strict=True)
        split = ((every.take(part), np.iscomplexobj(observed.observed_values(run)[0])) for run, part in runs)
        return [
            each if is_complex else Prediction(each.values.real, each.derivatives.real) for each, is_complex in split
        ]

    def predict_all(self, theta: Array, slopes: bool = True) -> Prediction:
        """All points of all runs in one entry; the values of real observations may be complex, without an imaginary part."""
        at = FiniteDifferences(
            theta, self._scale if slopes else self._scale[:0], self._all_values, self.observations.reference_c
        )
        same_clamp: dict[tuple[str, ...], list[int]] = {}
        for i, condition in enumerate(self._conditions):
            own = tuple(e.name for e in condition.run.shared_errors if e.acts_on == "clamp")
            same_clamp.setdefault(own, []).append(i)
        kind = complex if np.iscomplexobj(self.rows.observed) else float
        size = self.rows.observed.size
        y, dy = np.empty(size, kind), np.empty((at.set_count // 2, size), kind)
        for which in same_clamp.values():
            for i, got in zip(which, self._fundamentals(which, at), strict=True):
                into, where = self._into[i]
                y[into], dy[:, into] = got.take(where)
        for run, part in self._others:
            y[part], dy[:, part] = self._predict_run(run, at)
        for name, shape in self._readings.items():
            error = np.broadcast_to(at.values[name], at.set_count)
            moved = shape if kind is complex else shape.real
            dy = dy * (1 + error[0] * moved) + np.multiply.outer(at.derivatives(error), y * moved)
            y = y * (1 + error[0] * moved)
        return Prediction(y, dy)

    def _all_values(self, columns: Array) -> Values:
        v = nonidealities.DEFAULTS | self._fixed | dict(zip(self.names, columns, strict=True))
        for name, (other, factor) in self._tied.items():
            v[name] = factor * v[other]
        return nonidealities.with_acting_mass(v)

    def _predict_run(self, run: observed.Observation, differences: FiniteDifferences) -> Prediction:
        gain = 1 + differences.shared_error(run, "displacement")
        v, good = differences.of_run(run), run.usable
        beam = beam_from_values(v)
        match run:
            case observed.StaticLoadingObservation():
                sign = {"mfc": 1.0, "aluminium": -1.0, "both": 0.0}[run.side]
                load = run.load_n[good]
                per_newton = np.broadcast_to(
                    load_compliance(beam) * gain * (1 + sign * v["asymmetry"]), differences.set_count
                )
                errors = differences.input_error(run, "load", load) + np.reshape(v["load_gain"], (-1, 1))
                acting = load * (1 + errors) + np.reshape(v["load_offset"], (-1, 1))
                y = per_newton[:, None] * acting * self.nonideal.factor(run, v) + self.nonideal.drift(run, v)
            case observed.VoltageStepsObservation():
                per_volt = voltage_gain(beam) * gain * (1 + differences.shared_error(run, "volts"))
                level = run.input_v[good]
                slope = self._amplifier.slope_at(level)
                volts = self._amplifier.specimen_v(level) + slope * differences.input_error(run, "level", level)
                volts = self.nonideal.volts(run, v, volts)
                y = np.broadcast_to(per_volt, differences.set_count)[:, None] * volts * self.nonideal.factor(run, v)
                y = y + differences.rest_drift(run)
            case observed.MembraneSagObservation():
                return self._sag(run, differences, gain)
            case observed.MassResonanceObservation():
                return self._resonances(run, differences)
            case observed.DecayPoleObservation():
                return self._poles(run, differences)
            case observed.FrequencyResponseObservation():
                return self._peak_to_peak_prediction(run, differences, gain)
        return Prediction(y[0], differences.derivatives(y))

    def _sag(self, run: observed.MembraneSagObservation, differences: FiniteDifferences, gain: Array) -> Prediction:
        fields = [q.name for q in parameter_specs(Membrane)]
        table = np.array([np.broadcast_to(differences.values[name], differences.set_count) for name in fields]).T
        if run.geometry is not None:
            own = [getattr(run.geometry, name) for name in fields]
            table = np.where([name == "E_m" for name in fields], table, own)
        table[:, 3] = np.maximum(table[:, 3], 1e-3)
        different, where = np.unique(table, axis=0, return_inverse=True)
        centres = []
        for row in different:
            L_m, b_m, h_m, E_m = np.abs(row[:4]).tolist()
            strip = Membrane(L_m, b_m, h_m, E_m, 0.0, 0.0)
            centres.append(sag(strip, run.load_per_length(strip), run.delta).centre_m)
        y = np.multiply.outer(np.array(centres)[where.ravel()] * gain, np.ones(int(run.usable.sum())))
        y = y * self.nonideal.factor(run, differences.values)
        return Prediction(y[0], differences.derivatives(y))

    def _resonances(self, run: observed.MassResonanceObservation, differences: FiniteDifferences) -> Prediction:
        mass_kg = np.asarray(run.mass_kg)[run.usable]
        put_in = mass_kg + differences.input_error(run, "mass", mass_kg)  # (S, F)
        mass = np.broadcast_to(nonidealities.acting_masses(differences.values, put_in), put_in.shape)
        v = differences.of_run(run)
        stacked, slopes = differences.stack(
            [equation_factors(beam_from_values(v, each), (0.0, 0.0), differences.set_count) for each in mass.T]
        )

        creep = np.reshape(differences.values["creep"], (-1, 1))

        def tilt(omega: Array) -> tuple[Array, Array]:
            return nonidealities.crept_tilt(creep[0], omega)

        def find(l1: float, l2: float) -> Peak:
            dense = ReceptanceSolver(l1, l2, self.n)
            if run.meaning == "peak":
                return dense.resonance_peak(stacked, tilt)
            omega, t = dense.undamped_resonance(stacked)
            per = t / (2 * omega[:, None])
            return Peak(omega, Factors(-(omega**2)[:, None] * per, 0 * per, per), omega, omega, False)

        geometry = differences.geometry(v)
        omega, s, curvature, size, peaks = find(*geometry)
        d = sum(np.einsum("rj,prj->pr", own, moved) for own, moved in zip(s, slopes, strict=True))
        if peaks and creep.size > 1:
            d = d - differences.derivatives(nonidealities.crept_tilt(creep, omega)[0]) * size / curvature
        for ends, dl in differences.geometry_derivatives(v):
            if peaks:  # implicit derivatives at the same omega: a search at every geometry costs ten times as much
                up, down = (ReceptanceSolver(*end, self.n).peak_slope(stacked, omega, tilt)[0] for end in ends)
                moved = (down - up) / curvature
            else:
                up, down = (find(*end).omega for end in ends)
                moved = up - down
            d = d + np.multiply.outer(dl, moved / (2 * RELATIVE_STEP))
        return _by_clock(run, differences, omega / (2 * np.pi), d / (2 * np.pi))

    def _poles(self, run: observed.DecayPoleObservation, differences: FiniteDifferences) -> Prediction:
        v = differences.of_run(run)
        stacked, slopes = differences.stack([equation_factors(beam_from_values(v), (0.0, 0.0), differences.set_count)])
        s, own = ReceptanceSolver(*differences.geometry(v), self.n).pole(stacked)
        d = sum(np.einsum("rj,prj->pr", each, moved) for each, moved in zip(own, slopes, strict=True))
        for ends, dl in differences.geometry_derivatives(v):
            up, down = (ReceptanceSolver(*end, self.n).pole(stacked)[0] for end in ends)
            d = d + np.multiply.outer(dl, (up - down) / (2 * RELATIVE_STEP))
        every = np.ones(int(run.usable.sum()))  # one pole, measured several times
        return _by_clock(run, differences, s * every / (2 * np.pi), d * every / (2 * np.pi))

    def _fundamentals(self, which: Sequence[int], differences: FiniteDifferences) -> list[Prediction]:
        """Return the fundamentals under these conditions, which have one clamp."""
        conditions = [self._conditions[i] for i in which]
        runs = [each.run for each in conditions]
        values = [differences.of_run(r) for r in runs]
        v = values[0]
        stacked, slopes = differences.stack(
            [
                equation_factors(beam_under(r, own), skin_from_values(r, own), differences.set_count)
                for r, own in zip(runs, values, strict=True)
            ]
        )
        sizes = [r.frequency_hz.size for r in runs]
        errors_hz = [differences.frequency_error(r) for r in runs]
        omega = 2 * np.pi * np.concatenate([r.frequency_hz + e[0] for r, e in zip(runs, errors_hz, strict=True)])
        d_omega = 2 * np.pi * np.concatenate([differences.derivatives(e) for e in errors_hz], axis=1)  # (P, rows)
        of_run = np.repeat(np.arange(len(runs)), sizes)
        rows, same = stacked.take_rows(of_run), np.arange(omega.size)
        if not np.any(v["stiffening"]):
            _, equal = np.unique(np.concatenate(stacked, axis=1), axis=0, return_inverse=True)
            same = equal.ravel()[of_run]
        gain = np.zeros((1, omega.size))
        if np.any(v["stiffening"]):
            gain = np.concatenate([self.nonideal.stiffness_gain(r, v, differences.set_count) for r in runs], axis=1)
        bending = rows.K[:, 3:].copy()
        rows.K[:, 3:] *= 1 + gain[0][:, None]
        neighbours = differences.geometry_derivatives(v)
        H, t, moved = ReceptanceSolver(*differences.geometry(v), self.n).response_with_ends(
            rows, omega, [ends for ends, _ in neighbours], same
        )
        dH = -d_omega * np.einsum("rj,rj->r", t, 1j * rows.C - 2 * omega[:, None] * rows.M)
        if np.any(v["stiffening"]):
            dH -= differences.derivatives(gain) * np.einsum("rj,rj->r", t[:, 3:], bending)
        for (_, dl), difference in zip(neighbours, moved, strict=True):
            dH += np.multiply.outer(dl, difference / (2 * RELATIVE_STEP))
        out = []
        for i, (condition, own, stop, size) in enumerate(
            zip(conditions, values, np.cumsum(sizes).tolist(), sizes, strict=True)
        ):
            here = slice(stop - size, stop)
            w, factors = omega[here], t[here]
            stiff = np.concatenate((factors[:, :3], factors[:, 3:] * (1 + gain[0, here, None])), axis=1)
            dH[:, here] -= slopes.K[:, i] @ stiff.T
            dH[:, here] += slopes.M[:, i] @ (w[:, None] ** 2 * factors).T
            dH[:, here] -= slopes.C[:, i] @ (1j * w[:, None] * factors).T
            drive = self._drives[which[i]]
            slope_w = d_omega[:, here]
            out.append(self._displacement(condition.run, own, differences, drive, (w, slope_w), (H[here], dH[:, here])))
        return out

    def _displacement(
        self,
        run: observed.FrequencyResponseObservation,
        v: Values,
        differences: FiniteDifferences,
        drive: Complex,
        frequencies: tuple[Array, Array],
        receptances: tuple[Complex, Complex],
    ) -> Prediction:
        """Return the fundamental of the displacement; `frequencies` omega and `receptances` H with their slopes, (F,) and (P, F)."""
        (w, d_omega), (H, dH) = frequencies, receptances
        volts, gain = (1 + differences.shared_error(run, on) for on in ("volts", "displacement"))
        moment = -v["mu"] / v["L"] * volts * gain
        late = differences.shared_error(run, "delay")
        A = drive * np.exp(-1j * w * late[0])
        y = A * moment[0] * H
        dy = A * (np.multiply.outer(differences.derivatives(moment), H) + moment[0] * dH)
        dy = dy - 1j * (np.multiply.outer(differences.derivatives(late), w) + late[0] * d_omega) * y
        factor = self.nonideal.factor(run, v)
        if np.ndim(factor):
            factor = np.broadcast_to(factor, (differences.set_count, w.size))
            dy = dy * factor[0] + y * differences.derivatives(factor)
            y = y * factor[0]
        return Prediction(y, dy) if np.asarray(run.fundamental_m).dtype.kind == "c" else modulus_prediction(y, dy)

    def _peak_to_peak_prediction(
        self, run: observed.FrequencyResponseObservation, differences: FiniteDifferences, gain: Array
    ) -> Prediction:
        nominal = run.frequency_hz[run.usable]
        error = differences.frequency_error(run)
        f, moved = nominal + error[0], differences.derivatives(error)
        y = self._peak_to_peak(run, differences, gain, f)
        slopes = differences.derivatives(y)
        if moved.any():
            up, down = (self._peak_to_peak(run, differences, gain, f * (1 + side * 1e-5))[0] for side in (1, -1))
            slopes = slopes + moved * (up - down) / (2e-5 * f)
        return Prediction(y[0], slopes)

    def _peak_to_peak(
        self, run: observed.FrequencyResponseObservation, differences: FiniteDifferences, gain: Array, f: Array
    ) -> Array:
        """Max - min with every harmonic of the amplifier superposed, (S, F); from the poles, vectorized over sets."""
        v = differences.of_run(run)
        beam = Beam(*(np.broadcast_to(a, differences.set_count) for a in beam_under(run, v)))
        m = matrices(beam, *skin_from_values(run, v), self.n)
        form = modal_form(m.M, m.C, m.K, m.B, 2 * m.B_F)
        k = np.arange(harmonic_orders(f) + 1)
        H = receptance(form, np.outer(2 * np.pi * f, k).ravel()).reshape(differences.set_count, f.size, k.size)
        drives = np.stack((run.drive_amplitude_v, run.drive_offset_v), axis=-1)[run.usable]
        V = np.array([fourier_series("sine", a, o, self._amplifier, k.size - 1) for a, o in drives])
        width = np.stack([peak_to_peak(rows * V) for rows in H])
        width = width * np.abs(self.nonideal.factor(run, v))
        return np.asarray(width * (gain * (1 + differences.shared_error(run, "volts")))[:, None])


def _by_clock(run: observed.Observation, differences: FiniteDifferences, f: Any, d: Any) -> Prediction:
    """Return frequencies with their slopes as the run's time base reads them."""
    clock = differences.shared_error(run, "clock")
    read = f / (1 + clock[0])
    return Prediction(read, (d - np.multiply.outer(differences.derivatives(clock), read)) / (1 + clock[0]))


def modulus_prediction(y: Complex, dy: Complex) -> Prediction:
    """Return the modulus of a complex prediction with its slopes."""
    size = np.abs(y)
    return Prediction(size, (y.conj() * dy).real / size)


def with_predictions(
    observations: observed.ObservationSet, forward: "ForwardModel", theta: Array
) -> observed.ObservationSet:
    """Return the observations with their values replaced by the model's predictions."""
    pairs = zip(observations.runs, forward.predict(theta, slopes=False), strict=True)
    return observed.ObservationSet(
        tuple(observed.with_observed_values(run, predicted.values) for run, predicted in pairs)
    )
