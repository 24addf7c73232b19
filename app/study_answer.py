"""How a study is told: a table of its peaks, a picture, its result for JSON."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.answer import Column
from model.figures import Curve, Figure
from model.study import UNITS, Study, StudyResult

MOST_CURVES = 8
"""Combinations that a picture can hold."""
SHOWN = {"m": "µm", "m/V": "nm/V"}


def result(wanted: Study, values: NDArray[Any]) -> StudyResult:
    """All values, (sets, F), over the study's axes."""
    return StudyResult(wanted.measure, UNITS[wanted.measure], wanted.axes, values.reshape(*wanted.shape, -1))


def record(found: StudyResult) -> dict[str, Any]:
    """The result for JSON: nested lists; a complex number is a pair."""
    v = found.values
    lists = (np.stack((v.real, v.imag), -1) if np.iscomplexobj(v) else v).tolist()
    axes = [{"name": a.name, "unit": a.unit, "values": a.values} for a in found.axes]
    return {"axes": axes, found.measure: {"unit": found.unit, "values": lists}}


def summary(wanted: Study, amplitude: NDArray[np.float64]) -> tuple[Column, ...]:
    """Each combination with its peak, for a person."""
    f, peak = np.asarray(wanted.frequency_hz), amplitude.argmax(1)
    index = np.unravel_index(np.arange(len(amplitude)), wanted.shape or (1,))
    varied = (
        Column(axis.name, axis.unit, np.asarray(axis.values)[i])
        for axis, i in zip(wanted.axes[:-1], index, strict=False)
    )
    unit = UNITS[wanted.measure]
    shown = SHOWN[unit]
    ends = (
        (f"at_{f[0]:g}_hz", amplitude[:, 0], f"at {f[0]:g} Hz"),
        (f"at_{f[-1]:g}_hz", amplitude[:, -1], f"at {f[-1]:g} Hz"),
    )
    return (
        *varied,
        Column("peak", unit, amplitude.max(1), "highest", shown, ".1f"),
        Column("peak_frequency", "Hz", f[peak], "at frequency", form="g"),
        *(Column(name, unit, values, head, shown, ".1f") for name, values, head in ends),
    )


def picture(wanted: Study, values: NDArray[Any]) -> Figure:
    """A few curves over frequency."""
    f = np.asarray(wanted.frequency_hz)
    curves = []
    for k in np.unique(np.linspace(0, len(values) - 1, min(len(values), MOST_CURVES)).astype(int)):
        index = np.unravel_index(k, wanted.shape or (1,))
        label = ", ".join(
            f"{a.name} = {a.values[i]:.4g} {a.unit}".rstrip() for a, i in zip(wanted.axes, index, strict=False)
        )
        curves.append(Curve(label, f, np.abs(values[k])))
    some = f" {len(curves)} of {len(values)} combinations." if len(curves) < len(values) else ""
    where = "Free tactor" if wanted.specimen.membrane is None else "Tactor on the membrane"
    caption = f"{where}: {wanted.title}.{some}"
    return Figure("study", "frequency", "Hz", "amplitude of the centre", UNITS[wanted.measure], tuple(curves), caption)
