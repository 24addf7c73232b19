"""Live estimates: model parameters fitted in the background to the points of the run in progress."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.identification import PAPER_MODEL, ActiveModel
from app.live.latest_only import LatestOnlyWorker
from model import LAG_NAMES, AmplifierMap
from protocols.base import Protocol, Quality
from protocols.runfile import is_response

if TYPE_CHECKING:
    from collections.abc import Iterator

    from model import EstimatedQuantity
    from model.identification import LiveFit


@dataclass(frozen=True, slots=True)
class EstimateUpdate:
    """Estimates after `points` usable points; `message` is why there are none, or a warning.

    Attributes:
        estimates: parameters of the model, fitted to the points.
        results: the protocol's own results of the points, as at the end of the run.
        active_model: the model whose other parameters the fit uses.
    """

    estimates: "tuple[EstimatedQuantity, ...]" = ()
    results: "tuple[EstimatedQuantity, ...]" = ()
    message: str = ""
    points: int = 0
    active_model: ActiveModel = PAPER_MODEL


class LiveEstimator:
    """One fit that grows with its run; restarted if the points do not continue the previous ones.

    Args:
        amplifier: characteristic of the bench.
        shapes: of the specimen of a simulated bench; None: enough for a real tactor.
    """

    def __init__(self, amplifier: AmplifierMap, shapes: int | None = None) -> None:
        self._amplifier, self._shapes = amplifier, shapes
        self._worker = LatestOnlyWorker(self.fit_new_points, self._store, "live estimates")
        self._fit: LiveFit | None = None
        self._fitted_points: tuple[Any, ...] = ()
        self._update = EstimateUpdate()
        self.latest = EstimateUpdate()

    def submit(self, points: Sequence[Any], active_model: ActiveModel, kind: type[Protocol]) -> None:
        """Fit the points of the current run; returns at once. Points that are not amplitudes over frequency are ignored."""
        self._worker.submit((tuple(points), active_model, kind))

    def close(self) -> None:
        """Stop the thread."""
        self._worker.close()

    def fit_new_points(
        self, request: tuple[tuple[Any, ...], ActiveModel, type[Protocol]]
    ) -> "Iterator[EstimateUpdate]":
        """Fit the new points; yields after each."""
        points, of, kind = request
        taken = tuple(_newest_series([p for p in points if _is_informative(p)]))
        base = self._update.active_model
        same_model = (of.stamp, of.description) == (base.stamp, base.description)
        fitted = self._fitted_points
        if self._fit is None or not fitted or not same_model or taken[: len(fitted)] != fitted:
            self._fit = self._start_fit(taken, of)
            yield self._update
        for point in taken[len(self._fitted_points) :]:
            got = self._fit.add_point(
                point.frequency, point.fundamental * np.exp(1j * point.phase), point.fundamental_errors
            )
            shown = tuple(e for e in got.estimates if e.name not in LAG_NAMES)
            self._fitted_points = (*self._fitted_points, point)
            results = self._update.results
            self._update = EstimateUpdate(shown, results, got.message, len(self._fitted_points), of)
            yield self._update
        if is_response(kind.point_type):
            self._update = replace(self._update, results=kind.model_validate({}).estimates(taken))
            yield self._update

    def _start_fit(self, points: tuple[Any, ...], active_model: ActiveModel) -> "LiveFit":
        from model.identification import USUAL_EFFECTS, FitOptions, LiveFit  # lazily: the optimisers are slow to load

        self._fitted_points, self._update = (), EstimateUpdate(active_model=active_model)
        # Usual sizes: without them the moment of an MFC has an error of a tenth.
        lag = {name: (0.0, USUAL_EFFECTS[name].standard_deviation) for name in LAG_NAMES}
        setting = FitOptions(
            tactor=active_model.tactor,
            amplifier=self._amplifier,
            also=tuple(lag),
            priors=lag,
            n=self._shapes or FitOptions.n,
        )
        if not points:  # the imports above are all the first point needs
            return LiveFit(setting)
        offset_v = float(points[0].drive_offset)
        # Drives are limited to the amplifier's range: an excess that the card recorded is measurement error.
        margin_v = min(offset_v - self._amplifier.low_v, self._amplifier.high_v - offset_v)
        elongation = float(getattr(points[0], "elongation", np.nan))
        return LiveFit(
            setting,
            min(float(points[0].drive_amplitude), margin_v),
            offset_v,
            None if np.isnan(elongation) else elongation,
        )

    def _store(self, _request: object, result: EstimateUpdate | Exception) -> None:
        self.latest = result if isinstance(result, EstimateUpdate) else replace(EstimateUpdate(), message=str(result))


def _is_informative(point: Any) -> bool:
    """Return whether a point can be fitted: usable, with a standard error."""
    return is_response(point) and Quality(point.quality).usable and point.fundamental_errors > 0


def _newest_series(points: Sequence[Any]) -> list[Any]:
    """Return the points of the newest series: a membrane series has one at each elongation."""
    last = points[-1] if points else None
    return [p for p in points if getattr(p, "part", None) == getattr(last, "part", None)]
