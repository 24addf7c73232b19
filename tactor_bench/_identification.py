"""Identification of a specimen from its runs, and its accepted calibration."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TypeVar

import numpy as np

from app.identification import (
    CalibrationError,
    IdentificationResult,
    Method,
    ObservationError,
    SheetChoice,
    SheetError,
    accept_identification,
    amplifier_of,
    read_calibrations,
)
from app.identification import identify as identify_runs
from model import Array, ParameterError
from model.identification import Calibration, FitOptions, IdentificationError, Posterior, sample_posterior
from tactor_bench._catalogue import CatalogueEntry
from tactor_bench._run import Fact, MeasuredRun
from tactor_bench._tables import EstimateTable

__all__ = [
    "Calibration",
    "CalibrationError",
    "Identification",
    "IdentificationError",
    "ObservationError",
    "SheetError",
    "calibration",
    "identify",
]

T = TypeVar("T")
Source = str | Path | MeasuredRun | CatalogueEntry


class _Fact(Fact[IdentificationResult, T]):
    source = "result"


class Identification:
    """Parameters of one specimen, identified from its runs.

    Attributes:
        specimen: its name.
        estimates: by name: value, standard error, unit; `.to_pandas()` for a frame.
        names: names of the estimates, (P,), in the order of the covariance.
        covariance: covariance of the estimates, (P, P), in their units.
        fixed: values of all other parameters of the model.
        tactor, membrane: with the identified and the fixed values.
        adequacy: of a joint fit: `.adequate` (None if the runs cannot test the model), `.message`, `.findings`.
        verdict: agreement of model and runs, in a sentence.
        unidentified: combinations that the runs do not determine, as text.
        notes: omitted data, and the reasons.
        shapes: number of shape functions of the fit.
        budget: of a joint fit: `.names`, `.statistical`, `.systematic` and `.total`, (P,) each, and `.shares`, (S, P), of the
            squared total by `.sources`.
        result: the whole result of the service.
    """

    specimen = _Fact(lambda result: result.specimen)
    verdict = _Fact(lambda result: result.verdict)
    unidentified = _Fact(lambda result: result.unidentified)
    notes = _Fact(lambda result: result.notes)
    fixed = _Fact(lambda result: result.fixed)
    tactor = _Fact(lambda result: result.tactor)
    membrane = _Fact(lambda result: result.membrane)
    adequacy = _Fact(lambda result: result.adequacy)
    shapes = _Fact(lambda result: result.shapes)
    budget = _Fact(lambda result: result.budget)

    def __init__(self, result: IdentificationResult, paths: Sequence[Path] = ()) -> None:
        self.result = result
        self.estimates = EstimateTable(result.estimates)
        self.names: tuple[str, ...] = tuple(self.estimates)
        self.covariance: Array = np.asarray(result.covariance, float)
        self._paths = tuple(paths)

    def accept(self, by: str = "", note: str = "", reason: str = "", folder: str | Path | None = None) -> Calibration:
        """Store the result as the next version of the specimen's calibration, which becomes the active one.

        Args:
            by: name of the person who accepts it.
            note: note stored with the result.
            reason: reason for accepting an inadequate or untested result; needed for such a result.
            folder: folder of the calibrations; default: the folder of the first run.

        Raises:
            CalibrationError: a reason is needed, nothing was identified, or the file cannot be written.

        Example:
            >>> identification.accept(by="K. Tanaka", reason="only for the demonstration on Friday").decision  # doctest: +SKIP
            'NOT ADEQUATE: ... Accepted all the same: only for the demonstration on Friday'
        """
        where = Path(folder) if folder is not None else self._paths[0].parent
        return accept_identification(self.result, where, self._paths, by, note, reason)[0]

    def posterior(self, draws: int = 1500) -> Posterior:
        """Sample the posterior of a joint fit as a check of its linear uncertainties: draws, means, deviations, ratios.

        Raises:
            ParameterError: it is not the result of a joint fit, or the posterior cannot be sampled.
        """
        if self.result.joint_fit is None:
            raise ParameterError("a posterior is of a joint fit: identify with method='joint'")
        return sample_posterior(self.result.joint_fit, draws)

    def __repr__(self) -> str:
        return f"{self.specimen}: {self.verdict}\n{self.estimates!r}"


def identify(
    runs: Source | Sequence[Source],
    *,
    method: Method = "joint",
    free: Sequence[str] | None = None,
    also: Sequence[str] = (),
    fixed: Mapping[str, float] | None = None,
    priors: Mapping[str, tuple[float, float]] | None = None,
    robust: bool = False,
    shapes: int | None = None,
    sheet: str | Path | None = None,
    plain: bool = False,
) -> Identification:
    """Identify the parameters of a specimen from any of its runs, like `tactor-bench identify`.

    Args:
        runs: run files of one specimen: paths, opened runs, or entries of `runs(...)`.
        method: `joint` fits all runs at once, weighted by their errors; `chain` proceeds step by step as in the paper.
        free: names of the free parameters, for example `["k2", "mu", "m_add", "c0"]`; default: the parameters that the runs
            determine.
        also: names of additional free parameters, for example `["mass_fraction"]`, the acting share of the added masses.
        fixed: held values, by name, SI.
        priors: value and standard uncertainty, by name, SI, from ruler, caliper or scale; these parameters become free within
            their uncertainty, which enters all errors: `{"h_Al": (0.20e-3, 0.01e-3)}`.
        robust: a Cauchy loss, which is robust against outliers, instead of least squares.
        shapes: number of shape functions, 3 to 60; default: 20, for a simulated tactor its own number.
        sheet: specimen sheet with dimensions and masses; default: the sheet beside the runs, or else the paper's Table I with the
            uncertainties of ruler and caliper; "none": exact values of Table I.
        plain: the beam model alone; otherwise creep, hysteresis and the other usual nonidealities are fitted, and for an
            inadequate model the likeliest causes are added in turn (`result.steps`).

    Raises:
        RunReadError: a file is not a run.
        SheetError: the specimen sheet is invalid.
        ObservationError: the runs do not belong together, or have no relation to the model.
        IdentificationError, ChainError, ParameterError: why it cannot be identified so; all three are ValueErrors.
        ValueError: free, also, fixed, priors or robust with the chain, whose steps are the paper's.

    Example:
        >>> found = identify(runs("runs", specimen="T7"))  # doctest: +SKIP
        >>> found.estimates["k2"].value, found.estimates["k2"].standard_error, found.adequacy.adequate  # doctest: +SKIP
        (0.00702, 2.1e-05, True)
    """
    sources = [runs] if isinstance(runs, str | Path | MeasuredRun | CatalogueEntry) else list(runs)
    paths = [source.path if isinstance(source, MeasuredRun | CatalogueEntry) else Path(source) for source in sources]
    if not paths:
        raise ValueError("there are no runs to identify; give at least one")
    if method == "chain" and (free or also or fixed or priors or robust):
        raise ValueError("free, also, fixed, priors and robust are for the joint fit; the chain has fixed steps")
    priors_in_si = dict(priors or {})
    setting = FitOptions(
        free=None if free is None else (*free, *(name for name in priors_in_si if name not in free)),
        also=tuple(also),
        fixed=dict(fixed or {}),
        priors=priors_in_si,
        loss="cauchy" if robust else "linear",
        amplifier=amplifier_of(paths),
    )
    chosen: SheetChoice = None if sheet is None else "none" if sheet == "none" else Path(sheet)
    return Identification(identify_runs(paths, method, setting, shapes, sheet=chosen, plain=plain), paths)


def calibration(specimen: str, folder: str | Path = "runs", version: int | None = None) -> Calibration:
    """Return a calibration of a specimen: accepted estimates with their covariance.

    Args:
        specimen: its name.
        folder: folder of its runs.
        version: number of the version; default: the active one.

    Raises:
        CalibrationError: there is none, or its file is damaged.

    Example:
        >>> tb.response([160.0], calibration=calibration("T7")).peak_to_peak_band.upper  # doctest: +SKIP
        array([0.00093])
    """
    return read_calibrations(Path(folder), specimen).get(version)
