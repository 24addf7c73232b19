"""What the points of a running dwell tell so far: fitted anew with every point, beside the window. No Qt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.identification.active_model import PAPER_MODEL, ActiveModel
from app.live.latest_only import LatestOnlyWorker
from model.amplifier_map import AmplifierMap
from protocols.base.quality import Quality

if TYPE_CHECKING:
    from collections.abc import Iterator

    from model.estimate import EstimatedQuantity
    from model.identification.live_fit import LiveFit

BUDGET_S = 0.2
"""How long a fit may take: another point is seldom there before a second has passed."""


@dataclass(frozen=True, slots=True)
class EstimateUpdate:
    """What is known after `points` usable points; `words` say why nothing is, or what is amiss."""

    estimates: "tuple[EstimatedQuantity, ...]" = ()
    message: str = ""
    points: int = 0
    active_model: ActiveModel = PAPER_MODEL
    """Whose other parameters the fit rests on."""
    error_history: Mapping[str, tuple[float, ...]] | None = None
    """By name: the standard error relative to the value, after each point since it could be told."""


class LiveEstimator:
    """One fit that grows with its run; begins anew where the points are not a continuation of the last ones."""

    def __init__(self, amplifier: AmplifierMap) -> None:
        self._amplifier = amplifier
        self._worker: LatestOnlyWorker[tuple[tuple[Any, ...], ActiveModel], EstimateUpdate] | None = None
        self._fit: LiveFit | None = None
        self._fitted_points: tuple[Any, ...] = ()
        self._update = EstimateUpdate()
        self._latest = EstimateUpdate()

    @property
    def latest(self) -> EstimateUpdate:
        """What is known by now."""
        return self._latest

    def submit(self, points: Sequence[Any], active_model: ActiveModel) -> None:
        """Take the points of the present run; returns at once. Points that are no amplitudes over frequency tell nothing."""
        if self._worker is None:
            self._worker = LatestOnlyWorker(self.fit_new_points, self._store, "live estimates")
        self._worker.submit((tuple(points), active_model))

    def close(self) -> None:
        """End the thread."""
        if self._worker is not None:
            self._worker.close()

    def fit_new_points(self, request: tuple[tuple[Any, ...], ActiveModel]) -> "Iterator[EstimateUpdate]":
        """Fit the points that are new; an answer after each."""
        points, of = request
        taken = tuple(_newest_series([p for p in points if _is_informative(p)]))
        base = self._update.active_model
        goes_on = (of.stamp, of.description) == (base.stamp, base.description) and taken[
            : len(self._fitted_points)
        ] == self._fitted_points
        if self._fit is None or not goes_on or not self._fitted_points:
            self._fit = self._start_fit(taken, of)
            yield self._update
        for point in taken[len(self._fitted_points) :]:
            got = self._fit.add_point(
                point.frequency, point.fundamental * np.exp(1j * point.phase), point.fundamental_errors
            )
            errors = dict(self._update.error_history or {})
            for e in got.estimates:
                if e.value and np.isfinite(e.standard_error):
                    errors[e.name] = (*errors.get(e.name, ()), abs(e.standard_error / e.value))
            self._fitted_points = (*self._fitted_points, point)
            self._update = EstimateUpdate(got.estimates, got.message, len(self._fitted_points), of, errors)
            yield self._update

    def _start_fit(self, points: tuple[Any, ...], active_model: ActiveModel) -> "LiveFit":
        from model.identification.fit_options import FitOptions
        from model.identification.live_fit import LiveFit  # scipy's optimisers, for which no window waits

        self._fitted_points, self._update = (), EstimateUpdate(active_model=active_model)
        setting = FitOptions(tactor=active_model.tactor, amplifier=self._amplifier)
        if not points:  # what the first point needs is imported by now
            return LiveFit(setting)
        offset_v = float(points[0].drive_offset)
        # The guard let no drive leave the amplifier's range; what the card saw beyond it is the card's error.
        room_v = min(offset_v - self._amplifier.low_v, self._amplifier.high_v - offset_v)
        elongation = float(getattr(points[0], "elongation", np.nan))
        return LiveFit(
            setting,
            min(float(points[0].drive_amplitude), room_v),
            offset_v,
            None if np.isnan(elongation) else elongation,
            BUDGET_S,
        )

    def _store(self, _question: object, result: EstimateUpdate | Exception) -> None:
        self._latest = result if isinstance(result, EstimateUpdate) else replace(EstimateUpdate(), message=str(result))


def _is_informative(point: Any) -> bool:
    """Whether a point tells of the response: usable, with an error."""
    return hasattr(point, "fundamental_errors") and Quality(point.quality).usable and point.fundamental_errors > 0


def _newest_series(points: Sequence[Any]) -> list[Any]:
    """Those of the newest series: a membrane series has one at each elongation."""
    last = points[-1] if points else None
    return [p for p in points if getattr(p, "part", None) == getattr(last, "part", None)]
