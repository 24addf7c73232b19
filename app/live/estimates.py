"""What the points of a running dwell tell so far: fitted anew with every point, beside the window. No Qt."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from app.identification.active_model import PAPER, Believed
from app.live.latest_only import Latest
from model.amplifier_map import AmplifierMap
from protocols.base.quality import Quality

if TYPE_CHECKING:
    from collections.abc import Iterator

    from model.identification.calibration import Estimate
    from model.identification.live_fit import LiveFit

BUDGET_S = 0.2
"""How long a fit may take: another point is seldom there before a second has passed."""


@dataclass(frozen=True, slots=True)
class Told:
    """What is known after `points` usable points; `words` say why nothing is, or what is amiss."""

    estimates: "tuple[Estimate, ...]" = ()
    words: str = ""
    points: int = 0
    believed: Believed = PAPER
    """Whose other parameters the fit rests on."""
    errors: Mapping[str, tuple[float, ...]] | None = None
    """By name: the standard error relative to the value, after each point since it could be told."""


class LiveEstimates:
    """One fit that grows with its run; begins anew where the points are not a continuation of the last ones."""

    def __init__(self, amplifier: AmplifierMap) -> None:
        self._map = amplifier
        self._latest: Latest[tuple[tuple[Any, ...], Believed], Told] | None = None
        self._fit: LiveFit | None = None
        self._taken: tuple[Any, ...] = ()
        self._told = Told()
        self._newest = Told()

    @property
    def newest(self) -> Told:
        """What is known by now."""
        return self._newest

    def ask(self, points: Sequence[Any], of: Believed) -> None:
        """Take the points of the present run; returns at once. Points that are no amplitudes over frequency tell nothing."""
        if self._latest is None:
            self._latest = Latest(self.tell, self._keep, "live estimates")
        self._latest.ask((tuple(points), of))

    def close(self) -> None:
        """End the thread."""
        if self._latest is not None:
            self._latest.close()

    def tell(self, question: tuple[tuple[Any, ...], Believed]) -> "Iterator[Told]":
        """Fit the points that are new; an answer after each."""
        points, of = question
        taken = tuple(_of_the_same_drive([p for p in points if _tells(p)]))
        base = self._told.believed
        goes_on = (of.stamp, of.words) == (base.stamp, base.words) and taken[: len(self._taken)] == self._taken
        if self._fit is None or not goes_on or not self._taken:
            self._fit = self._begin(taken, of)
            yield self._told
        for point in taken[len(self._taken) :]:
            got = self._fit.add(point.frequency, point.fundamental * np.exp(1j * point.phase), point.fundamental_errors)
            errors = dict(self._told.errors or {})
            for e in got.estimates:
                if e.value and np.isfinite(e.standard_error):
                    errors[e.name] = (*errors.get(e.name, ()), abs(e.standard_error / e.value))
            self._taken = (*self._taken, point)
            self._told = Told(got.estimates, got.words, len(self._taken), of, errors)
            yield self._told

    def _begin(self, taken: tuple[Any, ...], of: Believed) -> "LiveFit":
        from model.identification.fit_options import Setting
        from model.identification.live_fit import LiveFit  # scipy's optimisers, for which no window waits

        self._taken, self._told = (), Told(believed=of)
        setting = Setting(tactor=of.tactor, amplifier=self._map)
        if not taken:  # what the first point needs is imported by now
            return LiveFit(setting)
        offset_v = float(taken[0].drive_offset)
        # The guard let no drive leave the amplifier's range; what the card saw beyond it is the card's error.
        room_v = min(offset_v - self._map.low_v, self._map.high_v - offset_v)
        elongation = float(getattr(taken[0], "elongation", np.nan))
        return LiveFit(
            setting,
            min(float(taken[0].drive_amplitude), room_v),
            offset_v,
            None if np.isnan(elongation) else elongation,
            BUDGET_S,
        )

    def _keep(self, _question: object, answer: Told | Exception) -> None:
        self._newest = answer if isinstance(answer, Told) else replace(Told(), words=str(answer))


def _tells(point: Any) -> bool:
    """Whether a point tells of the response: usable, with an error."""
    return hasattr(point, "fundamental_errors") and Quality(point.quality).usable and point.fundamental_errors > 0


def _of_the_same_drive(points: Sequence[Any]) -> list[Any]:
    """Those of the newest series: a membrane series has one at each elongation."""
    last = points[-1] if points else None
    return [p for p in points if getattr(p, "part", None) == getattr(last, "part", None)]
