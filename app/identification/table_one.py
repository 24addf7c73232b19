"""The paper's Table I: source of each parameter, and the standard uncertainty that its instrument has; usual sizes of parameters."""

from dataclasses import dataclass

RULER_M = 0.3e-3
"""Standard uncertainty of a length by ruler, read to half a graduation of 1 mm: 0.5 mm / sqrt(3) (GUM 4.3.7)."""
CALIPER_M = 0.01e-3
"""Standard uncertainty of a thickness by digital caliper: limits of error of 0.02 mm (ISO 13385-1), / sqrt(3), rounded."""
LINEAR_DENSITY = 0.01
"""Relative standard uncertainty of a weighed mass over a length: 0.6 g on a scale of 0.01 g, 52 mm by ruler."""
MODULUS_PA = 1e9
"""Standard uncertainty of a handbook modulus: aluminium alloys have 68 to 72 GPa."""

MEASURED = "directly measured"
IDENTIFIED = "identified from"


@dataclass(frozen=True, slots=True)
class TableOneSource:
    """Origin of a value of Table I; a value without uncertainty is identified from runs and has no prior."""

    source: str
    uncertainty: float | None = None
    instrument: str = ""

    @property
    def description(self) -> str:
        """E.g. `directly measured (ruler)`."""
        return f"{self.source} ({self.instrument})" if self.instrument else self.source


_ON_MEMBRANE = f"{IDENTIFIED} the response to a sine with membrane"
TABLE_ONE: dict[str, TableOneSource] = {
    **{name: TableOneSource(MEASURED, RULER_M, "ruler") for name in ("L", "L1", "L2", "b_Al", "L_m", "b_m")},
    **{name: TableOneSource(MEASURED, CALIPER_M, "digital caliper") for name in ("h_Al", "h_m")},
    "rho1": TableOneSource(MEASURED, LINEAR_DENSITY * 1.13e-2, "scale and ruler"),
    "rho2": TableOneSource(MEASURED, LINEAR_DENSITY * 2.50e-2, "scale and ruler"),
    "E_Al": TableOneSource("assumed from the literature", MODULUS_PA),
    "k2": TableOneSource(f"{IDENTIFIED} static loading and the resonance with added masses"),
    "mu": TableOneSource(f"{IDENTIFIED} static deflection under a voltage"),
    "c0": TableOneSource(f"{IDENTIFIED} the response to a sine without membrane"),
    "c_s_delta": TableOneSource(_ON_MEMBRANE),
    "c_s_0": TableOneSource(_ON_MEMBRANE),
    "E_m": TableOneSource(f"{IDENTIFIED} the sag of the membrane under its own weight"),
    "m_add": TableOneSource(f"{IDENTIFIED} the resonance without membrane; 11 g were put in (Sec. IV)"),
}
"""Third column of Table I, by parameter; m_add is in the text only."""

USUAL_RANGES: dict[str, tuple[float, float]] = {
    "L": (2e-3, 0.2), "L1": (5e-4, 0.2), "L2": (1e-3, 0.2), "b_Al": (2e-3, 0.2), "h_Al": (1e-5, 5e-3),
    "rho1": (1e-4, 1.0), "rho2": (1e-4, 1.0), "E_Al": (1e9, 1e12), "k2": (1e-5, 10.0), "mu": (1e-8, 1e-2),
    "c0": (0.1, 1e5), "m_add": (1e-5, 0.2), "L_m": (1e-2, 1.0), "b_m": (1e-3, 1.0), "h_m": (1e-5, 2e-2),
    "E_m": (1e3, 1e10), "delta": (0.0, 0.5), "contact_length": (1e-4, 0.2),
}  # fmt: skip
"""Sizes outside which a value of the model most likely has the wrong unit; 0 is never questioned."""
