"""Unphysical input is rejected in one sentence with parameter, value, limit and remedy."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Annotated

import numpy as np
import pytest
from annotated_types import Interval, Unit

from model.amplifier_map import AmplifierMap
from model.membrane import sag, skin
from model.parameter_spec import ParameterError, parameter_specs, validate_parameters
from model.parameters import Membrane, Skin, Tactor, beams
from model.response.closed_form import exact_response
from model.response.drive_spectrum import fourier_series
from model.response.harmonic_response import amplifier_response, frequency_response, poles, tactor_modal_form
from model.response.latency import sine_latency, step_latency, step_response
from model.response.perception import PerceptionThreshold, usable_bands
from model.response.statics import deflection
from model.specimen import Specimen
from model.studies.parameter_study import Study
from model.studies.sensitivity import sobol_indices_of
from model.studies.shape_function_convergence import convergence
from model.studies.uncertainty import EstimateSet, linear_band
from tests.helpers.model.sweep_response import sweep_response
from tests.helpers.sampled import model_curve

T, M = Tactor(), Membrane()
ONE = EstimateSet(("k2",), (7e-3,), np.array([[1e-10]]))
BAD: list[tuple[Callable[[], object], tuple[str, ...]]] = [
    (lambda: Tactor(k2=-7e-3), ("k2", "-0.007 N m^2", "greater than 0", "bending stiffness")),
    (lambda: Tactor(E_Al=0.0), ("E_Al", "0 Pa", "greater than 0")),
    (lambda: Tactor(c0=-1.0), ("c0", "-1", "at least 0 kg/(m s)")),
    (lambda: Tactor(mu=float("nan")), ("mu", "nan", "finite")),
    (lambda: Tactor(L=float("inf")), ("L (", "inf m")),
    (lambda: Tactor(rho1="heavy"), ("rho1", "'heavy'", "real number in kg/m")),  # type: ignore[arg-type]
    (lambda: Tactor(rho1=True), ("rho1", "True", "real number")),
    (lambda: Tactor(rho1=1j), ("rho1", "1j", "real number")),  # type: ignore[arg-type]
    (lambda: Tactor(L1=0.015), ("L1 is 0.015 m", "less than L2 = 0.015 m", "correct L1 or L2")),
    (lambda: Tactor(L2=0.03), ("L2 is 0.03 m", "less than L = 0.022 m")),
    (lambda: Membrane(h_m=0.0), ("h_m", "0 m", "greater than 0")),
    (lambda: Skin(k_s=-1.0), ("k_s", "-1 N/m^2", "at least 0")),
    (lambda: skin(M, -0.01), ("delta", "-0.01", "at least 0")),
    (lambda: skin(M, 0.01, contact_length=0.0), ("contact_length", "0 m", "greater than 0")),
    (lambda: skin(Membrane(c_s_delta=-5e4), 0.01), ("c_s", "-335", "at least 0")),
    (lambda: poles(T, n=2), ("n (", "is 2", "from 3 to 300")),
    (lambda: poles(T, n=301), ("is 301", "from 3 to 300")),
    (lambda: poles(T, n=7.5), ("7.5", "whole number")),  # type: ignore[arg-type]
    (lambda: poles(T, n=True), ("True", "whole number")),
    (lambda: convergence(T, n=(2, 7)), ("is 2", "from 3")),
    (lambda: frequency_response(T, [10.0, -1.0]), ("frequency", "-1 Hz", "at least 0")),
    (lambda: frequency_response(T, float("nan")), ("frequency", "nan")),
    (lambda: frequency_response(T, 10.0, x=0.03), ("x (", "0.03 m", "at most 0.022 m")),
    (lambda: exact_response(T, -2.0), ("frequency", "-2 Hz")),
    (lambda: exact_response(T, 2.0, x=-1e-3), ("x (", "-0.001 m", "at least 0")),
    (lambda: tactor_modal_form(T, x=[0.0, 1.0]), ("x (", "1 m")),
    (lambda: deflection(T, 0.5), ("x (", "0.5 m")),
    (lambda: amplifier_response(T, 0.0), ("frequency", "0 Hz", "greater than 0")),
    (lambda: amplifier_response(T, 10.0, amplitude_v=3.0), ("-0.5..5.5 V", "0..5 V", "lower the amplitude")),
    (lambda: amplifier_response(T, 10.0, offset_v=float("nan")), ("nan", "0..5 V")),
    (lambda: amplifier_response(T, 10.0, waveform="saw"), ("'saw'", "sine or square")),  # type: ignore[arg-type]
    (lambda: fourier_series("square", 1.0, 2.5, AmplifierMap(), duty=1.0), ("duty is 1.0", "between 0 and 1")),
    (lambda: step_response(T, -1.0), ("time", "-1 s")),
    (lambda: step_latency(T, threshold_m=0.0), ("threshold", "0 m", "greater than 0")),
    (lambda: step_latency(T, tolerance=1.0), ("tolerance", "1", "less than 1")),
    (lambda: sine_latency(T, 0.0), ("frequency", "0 Hz")),
    (lambda: sweep_response(T, [301.0]), ("time", "301 s", "at most 300 s")),
    (lambda: sweep_response(T, [1.0], duration_s=0.0), ("duration", "0 s")),
    (lambda: sweep_response(T, [1.0], orders=0), ("orders is 0",)),
    (lambda: sag(M, -1.0), ("load", "-1 N/m")),
    (lambda: sag(M, delta=-1e-3), ("delta", "-0.001")),
    (lambda: PerceptionThreshold((), ()), ("0 frequencies",)),
    (lambda: PerceptionThreshold((20.0, 10.0), (1e-6, 1e-6)), ("do not rise", "sort")),
    (lambda: PerceptionThreshold((20.0,), (0.0,)), ("threshold amplitude", "0 m")),
    (lambda: usable_bands([2.0, 1.0], [1e-3, 1e-3]), ("rising row",)),
    (lambda: beams(T, {"E_m": [1.0]}), ("E_m", "choose from L, L1")),
    (lambda: beams(T, {"k2": [1.0, -1.0]}), ("k2", "-1 N m^2")),
    (lambda: beams(T, {"L1": np.array([5e-3, 16e-3])}), ("L1 is 0.016 m", "L2 = 0.015 m")),
    (lambda: Study({"colour": (1.0,)}, (1.0,)), ("colour", "choose from")),
    (lambda: Study({"E_m": (1e6,)}, (1.0,)), ("E_m", "free tactor", "membrane")),
    (lambda: Study({"k2": ()}, (1.0,)), ("k2", "no values")),
    (lambda: Study({"k2": (-1.0,)}, (1.0,)), ("k2", "-1 N m^2")),
    (lambda: Study({}, (-1.0,)), ("frequency", "-1 Hz")),
    (lambda: Study({}, (0.0,), measure="peak_to_peak"), ("0 Hz", "leave 0 out")),
    (lambda: Study({}, (1.0,), memory_mb=0.0), ("memory_mb is 0.0",)),
    (lambda: Study({}, (1.0,), n=2), ("is 2", "from 3")),
    (lambda: Study({}, (1.0,), amplitude_v=9.0), ("-6.5..11.5 V",)),
    (lambda: Specimen(membrane=M, delta=-1.0), ("delta", "-1")),
    (lambda: Specimen(k_s=-1.0), ("k_s", "-1")),
    (lambda: Specimen().value("E_m"), ("E_m", "not a variable of this specimen")),
    (lambda: sobol_indices_of(Study({}, (1.0,)), {"k2": (8e-3, 6e-3)}), ("k2 ranges from 0.008 to 0.006",)),
    (
        lambda: sobol_indices_of(Study({}, (1.0,)), {"k2": (6e-3, 8e-3)}, samples=100),
        ("samples is 100", "power of two"),
    ),
    (
        lambda: sobol_indices_of(Study({}, (1.0,), measure="receptance"), {"k2": (6e-3, 8e-3)}),
        ("receptance", "fundamental"),
    ),
    (lambda: EstimateSet(("k2",), (7e-3,), np.eye(2)), ("shape (2, 2)", "need (1, 1)")),
    (lambda: EstimateSet(("k2",), (7e-3,), np.array([[-1.0]])), ("negative variance",)),
    (
        lambda: EstimateSet(("k2", "c0"), (7e-3, 1.0), np.array([[1.0, 2.0], [2.0, 1.0]])),
        ("not symmetric and positive",),
    ),
    (lambda: EstimateSet(("k2",), (-7e-3,), np.eye(1)), ("k2", "-0.007")),
    (lambda: EstimateSet(("colour",), (1.0,), np.eye(1)), ("colour", "choose from")),
    (lambda: EstimateSet(("k2", "c0"), (7e-3,), np.eye(1)), ("2 names but 1 values",)),
    (lambda: linear_band(model_curve(Study({}, (1.0,))), ONE, coverage=1.0), ("coverage is 1.0",)),
]


@pytest.mark.parametrize(("attempt", "words"), BAD, ids=[str(i) for i in range(len(BAD))])
def test_refused_by_name_value_and_limit(attempt: Callable[[], object], words: tuple[str, ...]) -> None:
    with pytest.raises(ParameterError) as refusal:
        attempt()
    message = str(refusal.value)
    assert all(word in message for word in words), message
    assert "\n" not in message


def test_sign_of_the_coupling_and_no_damping_are_physical() -> None:
    assert Tactor(mu=1e-5, c0=0.0, m_add=0.0).eta == 0


def test_annotations_are_read_once_and_for_all() -> None:
    @dataclass(frozen=True)
    class Sweep:
        start_hz: Annotated[float, Unit("Hz"), Interval(gt=0, le=1000), "first frequency"]
        label: str = "x"

        def __post_init__(self) -> None:
            validate_parameters(self)

    (start,) = parameter_specs(Sweep)
    assert (start.name, start.unit, start.description, start.default) == ("start_hz", "Hz", "first frequency", None)
    assert start.limits == "greater than 0 Hz and at most 1000 Hz"
    assert start.is_valid([0.0, 1.0, 1000.0, 1001.0]).tolist() == [False, True, True, False]
    with pytest.raises(ParameterError, match=r"start_hz \(first frequency\) is 2000 Hz"):
        Sweep(2000.0)


def test_every_parameter_of_table_i_has_unit_words_and_default() -> None:
    for cls in (Tactor, Membrane):
        for q in parameter_specs(cls):
            assert q.unit
            assert q.description != q.name
            assert q.default == getattr(cls(), q.name)
