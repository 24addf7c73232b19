"""Numeric summary of a specimen from its runs: fit, perception margins, latency, figures of merit."""

from collections.abc import Mapping
from dataclasses import dataclass

from app.report.figures_of_merit import (
    FigureOfMerit,
    PerceptionMargin,
    StepLatency,
    figures_of_merit,
    perception_margin_of,
    step_latency_of,
)
from app.report.runs import ReportProgress, ReportRun
from app.report.specimen import SpecimenModel, fit_specimen
from model.identification import FrequencyResponseObservation, ObservationSet


@dataclass(frozen=True, slots=True)
class SpecimenSummary:
    """A specimen with its observations, margins and figures of merit."""

    specimen: SpecimenModel
    observations: ObservationSet | None
    perception_margins: tuple[PerceptionMargin, ...]
    """Free, then on the membrane at every measured elongation."""
    latency: StepLatency | None
    figures_of_merit: Mapping[str, FigureOfMerit]


def summarize_specimen(name: str, runs: tuple[ReportRun, ...], progress: ReportProgress) -> SpecimenSummary:
    """Identify a specimen from its runs, then compute margins and latency."""
    progress("identifying", 0, 1)
    found, campaign = fit_specimen(name, runs, lambda evaluations, _: progress("identifying", min(evaluations, 40), 41))
    if campaign is None or found.identification is None:
        return SpecimenSummary(found, campaign, (), None, figures_of_merit(found, campaign, None, None, None))
    progress("margins and latency", 0, 1)
    on = sorted({r.elongation_m for r in campaign.of_type(FrequencyResponseObservation) if r.elongation_m is not None})
    free = perception_margin_of(found, None) if found.identifies_free_response else None
    pressed = [perception_margin_of(found, elongation) for elongation in on if found.identifies_response_at(elongation)]
    soon = step_latency_of(found) if found.identifies_free_response else None
    merits = figures_of_merit(found, campaign, free, pressed[-1] if pressed else None, soon)
    return SpecimenSummary(found, campaign, tuple(f for f in (free, *pressed) if f is not None), soon, merits)
