"""Effects of all possible causes on the weighted residuals, in a memory that grows with the rows and not with rows times causes.

An effect of one run has the rows of that run; those of successive runs share a vector over all rows; a point has its own rows. Only
other effects over several runs are stored as columns over all rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from model import Array
from model.identification import observations as observed
from model.identification.attribution.causes import POINT_ERRORS, Cause, RunError, free_as_well, with_errors
from model.identification.fit_result import JointFit
from model.identification.residuals import LeastSquaresProblem

Indices = NDArray[np.intp]


class Effects:
    """What each cause adds to the weighted residuals of a fit for plausible sizes.

    Args:
        fit: the fit.
        causes: causes other than exchanges.
        predictions: of the usable points, by run.

    Attributes:
        columns: by number k of their parameters, causes (C,) and their columns (C, k).
    """

    def __init__(self, fit: JointFit, causes: Sequence[Cause], predictions: Mapping[str, Any]) -> None:
        self._fit, self._causes, self._predictions = fit, causes, predictions
        self._runs = {run.label: i for i, run in enumerate(fit.observations.runs)}
        self._starts = [part.start for part in fit.run_slices]
        self._data = fit.run_slices[-1].stop
        self._slopes = self._error_slopes()
        self._wide: list[Array] = []
        self._wide_at: list[int] = []
        self._local: dict[int, list[tuple[observed.SharedError, Any]]] = {}
        self._local_at: dict[int, list[int]] = {}
        """Errors of one run alone with their shapes, and their columns, by run."""
        self._spans: dict[str, Array] = {}
        self._spans_at: dict[str, list[tuple[int, int, int]]] = {}
        self._point_at: list[tuple[int, int]] = []
        """Column and place of each effect of one of the four forms; of successive runs, the first one and the one after the last."""
        self._first: list[int] = []
        groups: dict[int, list[tuple[int, range]]] = {}
        self._count = 0
        for i, cause in enumerate(causes):
            self._first.append(self._count)
            self._count += self._place(cause, self._count)
            own = range(self._first[-1], self._count)
            groups.setdefault(len(own), []).append((i, own))
        self._first.append(self._count)
        self.columns: dict[int, tuple[Indices, Indices]] = {
            k: (np.array([i for i, _ in each]), np.array([own for _, own in each], int).reshape(len(each), k))
            for k, each in groups.items()
        }
        self._tables = {run: self._table_of_run(run, errors) for run, errors in self._local.items()}
        self._table = np.array(self._wide).reshape(len(self._wide), -1) if self._wide else np.zeros((0, self._rows))

    def of(self, cause: Cause) -> Array:
        """Return the effect of a cause, (rows, its parameters)."""
        at = next(i for i, each in enumerate(self._causes) if each is cause)
        own = range(self._first[at], self._first[at + 1])
        out = np.zeros((self._rows, len(own)))
        if cause.kind == "point":
            out[self._rows_of_point(cause), np.arange(len(own))] = POINT_ERRORS
        else:
            out[:] = np.stack(self._vectors(cause), axis=1)
        return out * self._fit.used_rows[:, None]

    def products(self, residuals: Array) -> Array:
        """Return the products of all effects with residuals, (rows, B) -> (columns, B)."""
        out = np.empty((self._count, residuals.shape[1]))
        out[self._wide_at] = self._table @ residuals
        for run, table in self._tables.items():
            out[self._local_at[run]] = table.T @ residuals[self._fit.run_slices[run]]
        for on, vector in self._spans.items():
            sums = np.add.reduceat(residuals[: self._data] * vector[: self._data, None], self._starts, axis=0)
            before = np.concatenate((np.zeros((1, sums.shape[1])), np.cumsum(sums, axis=0)))
            columns, first, stop = np.array(self._spans_at[on]).T
            out[columns] = before[stop] - before[first]
        if self._point_at:
            columns, rows = np.array(self._point_at).T
            out[columns] = residuals[rows] * (POINT_ERRORS * self._fit.used_rows[rows])[:, None]
        return out

    def grams(self, subspace: Array) -> dict[int, tuple[Indices, Array, Array]]:
        """Return for each number of parameters the causes, the Gram matrices of their effects, and the part of them in a subspace."""
        inside = self.products(subspace)
        squares = np.zeros(self._count)
        squares[self._wide_at] = (self._table**2).sum(axis=1)
        for run, table in self._tables.items():
            squares[self._local_at[run]] = (table**2).sum(axis=0)
        for on, vector in self._spans.items():
            before = np.append(0.0, np.cumsum(np.add.reduceat(vector[: self._data] ** 2, self._starts)))
            columns, first, stop = np.array(self._spans_at[on]).T
            squares[columns] = before[stop] - before[first]
        for column, row in self._point_at:
            squares[column] = POINT_ERRORS**2 * self._fit.used_rows[row]
        places = {column: i for i, column in enumerate(self._wide_at)}
        out = {}
        for k, (causes, columns) in self.columns.items():
            grams = np.zeros((causes.size, k, k))
            grams[:, np.arange(k), np.arange(k)] = squares[columns]
            for i, own in enumerate(columns.tolist() if k > 1 else ()):
                if own[0] in places:  # the others are of points, each of which has its own row
                    table = self._table[[places[column] for column in own]]
                    grams[i] = table @ table.T
            own_inside = inside[columns]
            out[k] = causes, grams, own_inside @ own_inside.mT
        return out

    @property
    def _rows(self) -> int:
        return int(self._fit.weighted_residuals.size)

    def _place(self, cause: Cause, column: int) -> int:
        """Store the effects of a cause from a column on, and return their number."""
        if cause.kind == "point":
            rows = self._rows_of_point(cause)
            self._point_at += [(column + k, row) for k, row in enumerate(rows)]
            return len(rows)
        if (span := self._span(cause)) is not None:
            on = cause.errors[0].error.acts_on
            self._spans[on] = self._slopes[on] * cause.errors[0].error.standard_error * self._fit.used_rows
            self._spans_at.setdefault(on, []).append((column, *span))
            return 1
        if not cause.parameters and len(cause.errors) == 1 and len(cause.errors[0].runs) == 1:
            ((label, shape),) = cause.errors[0].runs.items()
            run = self._runs[label]
            self._local.setdefault(run, []).append((cause.errors[0].error, shape))
            self._local_at.setdefault(run, []).append(column)
            return 1
        vectors = self._vectors(cause)
        self._wide += [vector * self._fit.used_rows for vector in vectors]
        self._wide_at += range(column, column + len(vectors))
        return len(vectors)

    def _span(self, cause: Cause) -> tuple[int, int] | None:
        """Return the first run and the one after the last of an error of several successive runs of those that it may act on."""
        if cause.parameters or len(cause.errors) != 1 or len(cause.errors[0].runs) == 1:
            return None
        own = [self._runs[label] for label in cause.errors[0].runs]
        first, stop = min(own), max(own) + 1
        between = [i for i in self._concerned.get(cause.errors[0].error.acts_on, ()) if first <= i < stop]
        return (first, stop) if between == sorted(own) else None

    def _vectors(self, cause: Cause) -> list[Array]:
        """Return the effects of a cause that is no point, (rows,) each."""
        out = []
        for name, (_, size) in cause.parameters.items():
            vector = np.zeros(self._rows)
            if name in self._fit.options.priors:
                row, own = self._fit.prior_rows[name], self._fit.problem.priors_by_name[name][1]
                vector[row] = np.sqrt(max(size**2 - own**2, 0.0)) / own
            else:
                vector = self._slopes[name] * size
            out.append(vector)
        for e in cause.errors:
            vector = np.zeros(self._rows)
            if e.error.acts_on == "reading" and len(e.runs) > 1:
                vector[: self._data] = self._readings(e.runs) * e.error.standard_error
            else:
                for label, shape in e.runs.items():
                    vector[self._fit.run_slices[self._runs[label]]] = self._of_run(e.error, label, shape)
            out.append(vector)
        return out

    def _table_of_run(self, at: int, errors: Sequence[tuple[observed.SharedError, Any]]) -> Array:
        """Return the effects of errors on the rows of one run, (rows of the run, errors)."""
        part, label = self._fit.run_slices[at], self._fit.observations.runs[at].label
        table = np.empty((len(errors), part.stop - part.start))
        shaped = [i for i, (error, _) in enumerate(errors) if error.acts_on == "reading"]
        if shaped:
            sizes = np.array([errors[i][0].standard_error for i in shaped])
            table[shaped] = self._reading(label, np.array([errors[i][1] for i in shaped])) * sizes[:, None]
        for i, (error, shape) in enumerate(errors):
            if i not in shaped:
                table[i] = self._of_run(error, label, shape)
        return np.ascontiguousarray((table * self._fit.used_rows[part]).T)

    def _of_run(self, error: observed.SharedError, label: str, shape: Any) -> Array:
        """Return the effect of an error on the rows of one run."""
        if error.acts_on == "reading":
            return self._reading(label, shape) * error.standard_error
        return np.asarray(self._slopes[error.acts_on][self._fit.run_slices[self._runs[label]]] * error.standard_error)

    def _readings(self, shapes: Mapping[str, Any]) -> Array:
        """Return the effect of an error of the readings of many runs, of given shapes by run, on the rows of all runs."""
        rows = self._fit.problem.forward_model.rows
        change = np.zeros(rows.observed.size, complex)
        for label, shape in shapes.items():
            change[rows.parts[self._runs[label]]] = self._predictions[label] * shape
        return np.asarray(rows.of(change))

    def _error_slopes(self) -> dict[str, Array]:
        """Return the slopes of the residuals to each parameter of a cause, and to one error of each kind of all runs concerned, (rows,)."""
        kinds: dict[str, RunError] = {}
        for e in (e for c in self._causes for e in c.errors if e.error.acts_on != "reading"):
            known = kinds.get(e.error.acts_on, e)
            error = replace(e.error, name=f"{e.error.acts_on} of the runs")
            kinds[e.error.acts_on] = RunError(error, {**known.runs, **e.runs})
        self._concerned = {on: sorted(self._runs[label] for label in e.runs) for on, e in kinds.items()}
        """Runs on which errors of a kind may act."""
        names = tuple(n for c in self._causes if c.kind == "parameter" for n in c.parameters)
        observations = with_errors(self._fit.observations, list(kinds.values()))
        problem = LeastSquaresProblem(observations, free_as_well(self._fit, names))
        _, J = problem.evaluate(problem.start)
        place = {name: i for i, name in enumerate(problem.names)}
        out = {name: place[name] for name in names} | {on: place[e.error.name] for on, e in kinds.items()}
        return {
            name: np.concatenate((J[: self._data, at], np.zeros(self._rows - self._data))) for name, at in out.items()
        }

    def _reading(self, label: str, shape: Any) -> Array:
        """Return the effect of errors of the readings of a run, of shapes (..., F), on its rows, (..., rows)."""
        predicted = self._predictions[label]
        change = predicted * shape
        real = not np.iscomplexobj(predicted)
        return observed.over_errors(
            self._fit.observations.runs[self._runs[label]], np.real(change) if real else change + 0j
        )

    def _rows_of_point(self, cause: Cause) -> range:
        at = self._runs[cause.name]
        part, usable = self._fit.run_slices[at], self._fit.observations.runs[at].usable
        first, count = part.start + int(usable[: cause.points[0]].sum()), int(usable.sum())
        return range(first, part.stop, count)
