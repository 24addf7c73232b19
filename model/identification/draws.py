"""A campaign measured once more: every point with an error of its own, every shared error drawn once."""

from dataclasses import replace

import numpy as np

from model.identification.observations import Acts, Campaign, FrequencyResponse, MassResonance, Observation


def redrawn(campaign: Campaign, rng: np.random.Generator) -> tuple[Campaign, dict[str, float]]:
    """The campaign with normal errors of the sizes it states added to its values, and the shared errors that were drawn."""
    drawn = {e.name: float(e.standard_error * rng.standard_normal()) for e in campaign.common.values()}
    return Campaign(tuple(_measured(run, drawn, rng) for run in campaign.runs)), drawn


def _measured(run: Observation, drawn: dict[str, float], rng: np.random.Generator) -> Observation:
    def of(acts_on: Acts) -> float:
        return sum(drawn[e.name] for e in run.common if e.acts_on == acts_on)

    gain = (1 + of("displacement")) * (1 + of("volts")) * (1 + of("load"))
    match run:
        case MassResonance():
            f = run.frequency_hz
            if offset := of("mass"):
                # the mass that is there differs from the one written down
                squares = np.polynomial.Polynomial.fit(run.mass_kg, f**-2.0, min(3, f.size - 1))
                f = squares(run.mass_kg + offset) ** -0.5 * f / squares(run.mass_kg) ** -0.5
            return replace(run, frequency_hz=f + run.errors_hz * rng.standard_normal(f.size))
        case FrequencyResponse():
            width = run.peak_to_peak_m
            if width is not None and run.peak_to_peak_errors_m is not None:
                width = width * gain + run.peak_to_peak_errors_m * rng.standard_normal(width.size)
            F = run.fundamental_m
            if F is not None and run.errors_m is not None:
                F = F * gain
                if np.iscomplexobj(F):
                    F = F * np.exp(-2j * np.pi * run.frequency_hz * of("delay"))
                    F = F + 1j * run.errors_m * rng.standard_normal(F.size)
                F = F + run.errors_m * rng.standard_normal(F.size)
            h = run.harmonics_m
            error = run.errors_m if run.harmonic_errors_m is None else run.harmonic_errors_m
            if h is not None and error is not None:
                noise = rng.standard_normal(h.shape) + 1j * rng.standard_normal(h.shape)
                h = np.abs(h * gain + error[:, None] * noise)
            return replace(run, fundamental_m=F, peak_to_peak_m=width, harmonics_m=h)
    w = run.deflection_m * gain
    return replace(run, deflection_m=w + run.errors_m * rng.standard_normal(w.size))
