"""How a study is told: its title, a table of its peaks, a picture, its description for the file it is stored in."""

from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from app.answer import Column
from app.model_inputs import specimen_record
from model.figures import Curve, Figure
from model.specimen import variables
from model.study import UNITS, Study, StudyResult
from protocols.studyfile import Parameter, StudyHeader

MOST_CURVES = 8
"""Combinations that a picture can hold."""
SHOWN = {"m": "µm", "m/V": "nm/V"}


def fixed(wanted: Study) -> dict[str, float]:
    """What is not varied, by name, SI; nor what follows from something that is."""
    specimen, follows = wanted.specimen, set()
    if specimen.membrane is not None:
        follows = {name for name in ("k_s", "c_s") if getattr(specimen, name) is None}
    if specimen.contact_length is None and {"L", "L2"} & wanted.vary.keys():
        follows.add("contact_length")
    return {n: v for n, v in specimen_record(specimen).items() if n not in follows and n not in wanted.vary}


def header(wanted: Study) -> StudyHeader:
    """What a file says of the study."""
    known = variables()
    return StudyHeader(
        title=title(wanted),
        signal=wanted.measure,
        unit=UNITS[wanted.measure],
        axes=wanted.axes,
        complex=wanted.measure == "receptance",
        parameters=tuple(Parameter(n, v, known[n].unit, known[n].words) for n, v in fixed(wanted).items()),
        description={
            "measure": wanted.measure,
            "n": wanted.n,
            "amplitude_v": wanted.amplitude_v,
            "offset_v": wanted.offset_v,
            "amplifier": asdict(wanted.amplifier),
        },
    )


def result(wanted: Study, values: NDArray[Any]) -> StudyResult:
    """All values, (sets, F), over the study's axes."""
    return StudyResult(wanted.measure, UNITS[wanted.measure], wanted.axes, values.reshape(*wanted.shape, -1))


def record(found: StudyResult) -> dict[str, Any]:
    """The result for JSON: nested lists; a complex number is a pair."""
    v = found.values
    lists = (np.stack((v.real, v.imag), -1) if np.iscomplexobj(v) else v).tolist()
    axes = [{"name": a.name, "unit": a.unit, "values": a.values} for a in found.axes]
    return {"axes": axes, found.measure: {"unit": found.unit, "values": lists}}


def title(wanted: Study) -> str:
    """What was computed over what."""
    what = {"fundamental": "2 x fundamental", "peak_to_peak": "max - min", "receptance": "receptance"}[wanted.measure]
    return f"{what} of the centre over {', '.join(axis.name for axis in wanted.axes)}"


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
    caption = f"{where}: {title(wanted)}.{some}"
    return Figure("study", "frequency", "Hz", "amplitude of the centre", UNITS[wanted.measure], tuple(curves), caption)
