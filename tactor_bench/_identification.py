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
    source = "found"


class Identification:
    """Parameters of one specimen, identified from its runs.

    Attributes:
        specimen: its name.
        estimates: by name: value, standard error, unit; `.to_pandas()` for a frame.
        names: of the estimates, (P,), in the order of the covariance.
        covariance: of the estimates, (P, P), in their units.
        fixed: every other parameter of the model, with the value it was given.
        tactor, membrane: as identified; what was not identified has its fixed value.
        adequacy: of a joint fit: `.adequate` (None where the runs cannot test the model), `.message`, `.findings`.
        verdict: how well the runs are explained, in a sentence.
        unidentified: combinations that the runs do not determine, in words.
        notes: what was left out, and why.
        shapes: number of shape functions of the fit.
        budget: of a joint fit: `.names`, `.statistical`, `.systematic` and `.total`, (P,) each, and `.shares`, (S, P), of the
            squared total by `.sources`.
        found: the whole result of the service.
    """

    specimen = _Fact(lambda found: found.specimen)
    verdict = _Fact(lambda found: found.verdict)
    unidentified = _Fact(lambda found: found.unidentified)
    notes = _Fact(lambda found: found.notes)
    fixed = _Fact(lambda found: found.fixed)
    tactor = _Fact(lambda found: found.tactor)
    membrane = _Fact(lambda found: found.membrane)
    adequacy = _Fact(lambda found: found.adequacy)
    shapes = _Fact(lambda found: found.shapes)
    budget = _Fact(lambda found: found.budget)

    def __init__(self, found: IdentificationResult, paths: Sequence[Path] = ()) -> None:
        self.found = found
        self.estimates = EstimateTable(found.estimates)
        self.names: tuple[str, ...] = tuple(self.estimates)
        self.covariance: Array = np.asarray(found.covariance, float)
        self._paths = tuple(paths)

    def accept(self, by: str = "", note: str = "", reason: str = "", folder: str | Path | None = None) -> Calibration:
        """Store the result as the next version of the specimen's calibration, which becomes the active one.

        Args:
            by: name of the person who accepts it.
            note: a note stored with it.
            reason: why a result that is not adequate, or was not tested, is used all the same; needed for such a result.
            folder: of the calibrations; by default the folder of the first run.

        Raises:
            CalibrationError: a reason is needed, nothing was identified, or the file cannot be written.

        Example:
            >>> found.accept(by="K. Tanaka", reason="only for the demonstration on Friday").decision  # doctest: +SKIP
            'NOT ADEQUATE: ... Accepted all the same: only for the demonstration on Friday'
        """
        where = Path(folder) if folder is not None else self._paths[0].parent
        return accept_identification(self.found, where, self._paths, by, note, reason)[0]

    def posterior(self, draws: int = 1500) -> Posterior:
        """Sample the posterior of a joint fit, which its linear uncertainties are checked with: draws, means, deviations, ratios.

        Raises:
            ParameterError: it is not the result of a joint fit, or the posterior cannot be sampled.
        """
        if self.found.joint_fit is None:
            raise ParameterError("a posterior is of a joint fit: identify with method='joint'")
        return sample_posterior(self.found.joint_fit, draws)

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
    """Identify the parameters of a specimen from any runs of it, as `tactor-bench identify`.

    Args:
        runs: run files of one specimen: paths, opened runs, or entries of `runs(...)`.
        method: `joint` fits all runs at once, weighted by their errors; `chain` goes step by step as the paper did.
        free: names of the free parameters, for example `["k2", "mu", "m_add", "c0"]`; default: what the runs determine.
        also: names that are free in addition, for example `["mass_fraction"]`, the share of the added masses that acts.
        fixed: values to hold, by name, SI.
        priors: value and standard uncertainty, by name, SI, from ruler, caliper or scale; these parameters become free
            within that, and their uncertainty is in all errors: `{"h_Al": (0.20e-3, 0.01e-3)}`.
        robust: a Cauchy loss, which is robust against outliers, instead of least squares.
        shapes: number of shape functions, 3 to 60; default: 20, of a simulated tactor as many as it has.
        sheet: specimen sheet with dimensions and masses; default: the one beside the runs, or else the paper's Table I with the
            uncertainties of ruler and caliper; "none" holds them at Table I as exact.
        plain: the beam model alone; otherwise creep, hysteresis and the other usual nonidealities are fitted with it, and where
            the model is not adequate the likeliest causes are added in turn (`found.steps`).

    Raises:
        RunReadError: a file is not a run.
        SheetError: the specimen sheet is invalid.
        ObservationError: the runs do not belong together, or contain nothing about the model.
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
        raise ValueError(
            "free, also, fixed, priors and robust are for the joint fit; the chain's steps are the paper's"
        )
    known = dict(priors or {})
    setting = FitOptions(
        free=None if free is None else (*free, *(name for name in known if name not in free)),
        also=tuple(also),
        fixed=dict(fixed or {}),
        priors=known,
        loss="cauchy" if robust else "linear",
        amplifier=amplifier_of(paths),
    )
    chosen: SheetChoice = None if sheet is None else "none" if sheet == "none" else Path(sheet)
    return Identification(identify_runs(paths, method, setting, shapes, sheet=chosen, plain=plain), paths)


def calibration(specimen: str, folder: str | Path = "runs", version: int | None = None) -> Calibration:
    """Return a calibration of a specimen: estimates that were accepted, with their covariance.

    Args:
        specimen: its name.
        folder: where its runs are.
        version: which one; default is the active one.

    Raises:
        CalibrationError: there is none, or its file is damaged.

    Example:
        >>> tb.response([160.0], calibration=calibration("T7")).peak_to_peak_band.upper  # doctest: +SKIP
        array([0.00093])
    """
    return read_calibrations(Path(folder), specimen).get(version)
