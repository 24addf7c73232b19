"""What `tactor-bench model frequency-response` and `model step` do: the tactor under the amplifier, and in time."""

import argparse

import numpy as np
from annotated_types import Interval
from numpy.typing import NDArray

from app.answer import Answer, Column, Table
from app.model_inputs import DURATION, OFFSET, VOLTAGE, read_specimen, read_values, specimen_words
from app.units import PEAK_TO_PEAK, read_number
from model.amplifier import AmplifierMap
from model.closed_form import exact_response
from model.drive import series
from model.figures import Curve, Figure
from model.latency import THRESHOLD, TOLERANCE, Latency, sine_latency, step_latency
from model.perception import margin, usable_bands
from model.quantity import Quantity
from model.response import PERIODIC, amplifier_response, modal, orders_for
from model.response import frequency_response as receptance
from model.specimen import Specimen, specimen_record
from model.time import onset_response, step_response

DWELL_HZ = "25,50,75,100,125,150,155,160,165,170,175,180,185,190,195,200,225,250"
"""The paper's frequencies."""
CURVE_HZ = "1:250:250"
POINTS = 2001


def frequency_response(options: argparse.Namespace) -> Answer:
    """Fundamental and max - min under the amplifier's drive, and the margin over what can be felt."""
    specimen = read_specimen(options)
    t, skin, n = specimen.tactor, specimen.skin, options.n
    usual = CURVE_HZ if options.csv or options.picture else DWELL_HZ
    f = np.array(read_values(usual if options.frequencies is None else options.frequencies, PERIODIC))
    amplitude, offset = _drive(options)
    at = None if options.at is None else read_number(options.at, _along(specimen))
    got = amplifier_response(t, f, amplitude, offset, skin=skin, waveform=options.waveform, n=n, x=at)
    twice = 2 * np.abs(got.fundamental)
    H = receptance(t, f, skin, n, at)
    columns = [
        Column("frequency", "Hz", f, form=".6g"),
        Column("peak_to_peak", "m", got.peak_to_peak, "max - min", "µm", ".1f"),
        Column("twice_fundamental", "m", twice, "2 x fundamental", "µm", ".1f"),
        Column("phase", "rad", np.angle(got.fundamental), "phase", "°", ".1f"),
        Column("receptance_re", "m/V", H.real, told=False),
        Column("receptance_im", "m/V", H.imag, told=False),
        Column("margin", "", margin(f, got.peak_to_peak), "x 50 µm", form=".2f"),
    ]
    lines = [Curve("max - min", f, got.peak_to_peak), Curve("2 x fundamental", f, twice)]
    if options.exact:
        exact = exact_response(t, f, skin, at)
        V = series(options.waveform, amplitude, offset, AmplifierMap(), 1)
        columns.append(Column("exact", "m", 2 * np.abs(V[1] * exact), "closed form", "µm", ".1f"))
        lines.append(Curve("2 x fundamental, closed form", f, 2 * np.abs(V[1] * exact)))
    where = specimen_words(specimen)
    title = f"Response to a {options.waveform} of {2 * amplitude:g} V peak to peak around {offset:g} V, {where}"
    table = Table("response", title, tuple(columns))
    figure = Figure("response", "frequency", "Hz", "amplitude of the centre", "m", tuple(lines), title + ".")
    note, bands = _felt(f, got.peak_to_peak)
    return Answer(
        "model frequency-response",
        specimen_record(specimen),
        (table,),
        (note,),
        pictures=(figure,),
        more={"felt_hz": bands},
    )


def step(options: argparse.Namespace) -> Answer:
    """Latency of a step and of a sine's onset."""
    specimen = read_specimen(options)
    t, skin, n = specimen.tactor, specimen.skin, options.n
    volts, hz = read_number(options.voltage, VOLTAGE), read_number(options.frequency, PERIODIC)
    amplitude, offset = _drive(options)
    threshold, tolerance = read_number(options.threshold, THRESHOLD), read_number(options.tolerance, TOLERANCE)
    stepped = step_latency(t, volts, threshold, tolerance, skin, n)
    begun = sine_latency(t, hz, amplitude, offset, threshold, tolerance, skin, n=n)
    where, felt = specimen_words(specimen), f"time to {1e6 * threshold:g} µm"
    tables = (
        _latency("step", f"Step of {volts:g} V on the specimen, {where}", "final deflection", felt, stepped, tolerance),
        _latency(
            "sine_onset",
            f"Onset of a sine of {hz:g} Hz, {2 * amplitude:g} V peak to peak around {offset:g} V at the amplifier's input",
            "amplitude of the fundamental",
            felt,
            begun,
            tolerance,
        ),
    )
    longest = max(stepped.settling_s or 0.02, begun.settling_s or 0.02)
    duration = 1.5 * longest if options.duration is None else read_number(options.duration, DURATION)
    time = np.linspace(0, duration, POINTS)
    V = series("sine", amplitude, offset, AmplifierMap(), orders_for(np.array([hz])))
    w = step_response(t, time, volts, skin, n)
    onset = onset_response(modal(t, skin, n), time, hz, V).real
    curve = Table("time", "", (Column("time", "s", time), Column("step", "m", w), Column("sine_onset", "m", onset)))
    lines = (Curve(f"step of {volts:g} V", time, w), Curve(f"onset of {hz:g} Hz", time, onset))
    figure = Figure("step", "time", "s", "deflection of the centre", "m", lines, f"Begun from rest, {where}.")
    return Answer("model step", specimen_record(specimen), tables, curve=curve, pictures=(figure,))


def _drive(options: argparse.Namespace) -> tuple[float, float]:
    return read_number(options.peak_to_peak, PEAK_TO_PEAK) / 2, read_number(options.offset, OFFSET)


def _along(specimen: Specimen) -> Quantity:
    return Quantity("at", "m", Interval(ge=0, le=specimen.tactor.L), "distance from the clamp", None)


def _felt(f: NDArray[np.float64], amplitude: NDArray[np.float64]) -> tuple[str, tuple[tuple[float, float], ...]]:
    """Where max - min exceeds what the abdomen can tell, within the frequencies given: in words and in Hz."""
    rising, order = np.unique(f, return_index=True)
    bands = usable_bands(rising, amplitude[order])
    peak = f"Highest max - min: {1e6 * amplitude.max():.1f} µm at {f[amplitude.argmax()]:g} Hz. "
    if not bands:
        return peak + "Nowhere 50 µm or more: it would not be felt on the abdomen.", bands
    words = ", ".join(f"{low:.4g} to {high:.4g} Hz" for low, high in bands)
    return (
        f"{peak}50 µm or more, felt on the abdomen: {words}, of the {rising[0]:g} to {rising[-1]:g} Hz looked at.",
        bands,
    )


def _latency(name: str, title: str, final: str, felt: str, got: Latency, tolerance: float) -> Table:
    columns = (
        Column("final", "m", [got.final_m], final, "µm", ".1f"),
        Column("to_threshold", "s", [got.to_threshold_s], felt, "ms", ".3f"),
        Column("rise", "s", [got.rise_s], "10 % to 90 % rise", "ms", ".3f"),
        Column("overshoot", "", [got.overshoot], "overshoot", "%", ".1f"),
        Column("settling", "s", [got.settling_s], f"settled within {100 * tolerance:g} %", "ms", ".2f"),
    )
    return Table(name, title, columns, upright=True)
