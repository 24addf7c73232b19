"""Response lines of a sweep as a joint fit takes them: independent, without mains harmonics, of a bounded number."""

from dataclasses import replace

import numpy as np

from protocols.base import Series
from protocols.signals import MAINS_HZ

BLOCK_HZ = 1.0
"""Lines that lie closer are averaged over this width; at a damping of 0.2 that blunts the resonance by less than 1e-4."""

SHARE_OF_SPACING = 0.25
"""Lines this near to a harmonic of the mains, as a share of their distance, are left out: hum repeats with every period."""


def response_lines(curve: Series, overlaps: bool) -> Series:
    """Return the usable lines of a frequency response; `overlaps` where neighbours share half of their samples."""
    lines = curve.at(np.argsort(curve.x)[:: 2 if overlaps else 1])
    f, errors = lines.x, lines.errors
    assert errors is not None
    good = np.isfinite(lines.y) & np.isfinite(errors) & (errors > 0) & (f > 0)
    if f.size > 1:
        spacing = float(np.median(np.diff(f)))
        for mains in MAINS_HZ:
            good &= np.abs(f - np.maximum(np.round(f / mains), 1) * mains) > SHARE_OF_SPACING * spacing
    return _averaged(lines.at(good))


def _averaged(lines: Series) -> Series:
    """Return weighted means over blocks of `BLOCK_HZ`; lines farther apart stay as they are."""
    f, errors = lines.x, lines.errors
    if errors is None or f.size < 2 or np.median(np.diff(f)) > 0.5 * BLOCK_HZ:
        return lines
    block = np.floor((f - f[0]) / BLOCK_HZ).astype(int)
    starts = np.flatnonzero(np.diff(block, prepend=-1))
    weights = errors**-2
    total = np.add.reduceat(weights, starts)
    real, imaginary = (np.add.reduceat(weights * part, starts) / total for part in (lines.y.real, lines.y.imag))
    centre = np.add.reduceat(weights * f, starts) / total
    return replace(lines, x=centre, y=real + 1j * imaginary, errors=total**-0.5, fit=None, coherence=None)
