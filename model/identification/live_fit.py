"""Live fit: a few parameters fitted again after each point of a running dwell, in milliseconds."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np

from model import EstimatedQuantity, ParameterError
from model.identification.fit_options import FitOptions, IdentificationError
from model.identification.fit_result import JointFit, UnidentifiedCombination
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import FrequencyResponseObservation, ObservationSet
from model.identification.parameters import elongation_parameter


@dataclass(frozen=True)
class LiveFitResult:
    """The parameters after the newest point; empty, with the reason in `message`, while they cannot be identified."""

    estimates: tuple[EstimatedQuantity, ...]
    unidentified_combinations: tuple[UnidentifiedCombination, ...]
    values: Mapping[str, float | None]
    """All parameters, for the model curve of the plot."""
    message: str
    duration_s: float


@dataclass
class LiveFit:
    """Points of one running dwell and the fit so far; one instance per dwell, used by one thread at a time.

    `options` has the values of tactor and membrane, and the priors of the free parameters. Free by default: effective mass,
    damping and coupling of a free dwell; the skin's damping and stiffness on a membrane.
    """

    options: FitOptions = field(default_factory=FitOptions)
    drive_amplitude_v: float = 2.5
    drive_offset_v: float = 2.5
    elongation_m: float | None = None
    max_evaluations: int = 20
    _points: list[tuple[float, complex, float]] = field(default_factory=list)
    _last_fit: JointFit | None = None

    def __post_init__(self) -> None:
        import scipy.optimize  # noqa: F401  (now, not with the first point)

        if self.options.free is None:
            e = self.elongation_m
            free = (
                ("m_add", "c0", "mu") if e is None else (elongation_parameter("c_s", e), elongation_parameter("k_s", e))
            )
            self.options = replace(self.options, free=free)

    def add_point(self, frequency_hz: float, fundamental_m: complex, error_m: float) -> LiveFitResult:
        """Add one usable point and fit again from the last result; never raises for a bad point."""
        began = perf_counter()
        self._points.append((frequency_hz, complex(fundamental_m), error_m))
        f, F, error = (np.array(column) for column in zip(*self._points, strict=True))
        base = self.options.base_values()
        try:
            run = FrequencyResponseObservation(
                "live", f, F, error, self.drive_amplitude_v, self.drive_offset_v, self.elongation_m
            )  # fmt: skip
            start = (
                {}
                if self._last_fit is None
                else dict(zip(self._last_fit.names, self._last_fit.theta.tolist(), strict=True))
            )
            setting = replace(self.options, start={**self.options.start, **start})
            fit = joint_fit(ObservationSet((run,)), setting, max_evaluations=self.max_evaluations, max_starts=1)
        except (ParameterError, IdentificationError) as reason:
            if not (np.isfinite(F[-1]) and error_m > 0 and frequency_hz > 0):
                self._points.pop()
            return LiveFitResult((), (), base, str(reason), perf_counter() - began)
        missing = ", ".join(c.description for c in fit.unidentified_combinations)
        message = f"not identifiable yet: {missing}" if missing else fit.verdict if fit.converged else fit.message
        if not fit.unidentified_combinations:
            self._last_fit = fit
        return LiveFitResult(
            fit.estimates(), fit.unidentified_combinations, fit.values, message, perf_counter() - began
        )
