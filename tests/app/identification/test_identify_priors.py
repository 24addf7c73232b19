"""Ruler and caliper in the fit: `--prior` frees a length within its uncertainty, and held values are named.

The tables are made by finite elements and the closed form, which share nothing with the fit.
"""

import json
from typing import Any

import numpy as np
import pytest

import tactor_bench as tb
from app.cli.main import main
from benchmarks.campaigns import LOADS_N, elements
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import FrequencyResponseObservation, ObservationSet, StaticLoadingObservation
from model.parameters import Tactor
from model.response.closed_form import exact_response
from tests.helpers.importing import FULL, brought

F = np.array([50.0, 75, 100, 125, 140, 150, 160, 175, 200, 225, 250])


def measured(tactor: Tactor, rng: np.random.Generator) -> tuple[StaticLoadingObservation, FrequencyResponseObservation]:
    w = elements(tactor, np.zeros(1), None, np.inf, load=True)[0].real * LOADS_N
    y = 1000 * exact_response(tactor, F)
    static = StaticLoadingObservation("static", LOADS_N, w * (1 + 1e-3 * rng.standard_normal(w.size)), 1e-3 * w)
    noise = rng.standard_normal(F.size) + 1j * rng.standard_normal(F.size)
    return static, FrequencyResponseObservation("dwell", F, y + 3e-7 * noise, np.full(F.size, 3e-7))


@pytest.fixture(scope="module")
def tables(tmp_path_factory: pytest.TempPathFactory) -> list[str]:
    """A specimen that is 22.5 mm long, not 22 mm."""
    folder = tmp_path_factory.mktemp("ruler")
    static, dwell = measured(Tactor(L=22.5e-3), np.random.default_rng(2))
    rows = zip(static.load_n, 1e6 * static.deflection_m, 1e6 * static.errors_m, strict=True)
    (folder / "s.csv").write_text(
        "load [N],deflection [um],u_deflection [um]\n" + "".join(f"{a:.8g},{b:.8g},{c:.4g}\n" for a, b, c in rows)
    )
    points = zip(F, 1e6 * abs(np.asarray(dwell.fundamental_m)), np.angle(np.asarray(dwell.fundamental_m)), strict=True)
    (folder / "d.csv").write_text(
        "frequency [Hz],fundamental [um],u_fundamental [um],phase [rad]\n"
        + "".join(f"{a:.8g},{b:.8g},0.3,{c:.8g}\n" for a, b, c in points)
    )
    return [str(brought(folder / "s.csv")), str(brought(folder / "d.csv", *FULL))]


def k2_of(result: dict[str, Any]) -> tuple[float, float]:
    table = result["parameters"]
    at = table["name"].index("k2")
    return table["value"][at], table["standard_error"][at]


@pytest.mark.deep
def test_half_a_millimetre_on_the_ruler_is_inside_the_interval(
    tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    free = ["--free", "k2,mu,m_add,c0", "--sheet", "none", "--json"]
    assert main(["identify", *tables, *free]) == 0
    held = k2_of(json.loads(capsys.readouterr().out))
    assert main(["identify", *tables, *free, "--prior", "L=22 mm +- 0.5 mm"]) == 0
    result = json.loads(capsys.readouterr().out)
    loose = k2_of(result)
    assert abs(held[0] - 7e-3) > 15 * held[1]  # held as if exact: an error bar that is none
    assert abs(loose[0] - 7e-3) < 3 * loose[1]
    assert loose[1] > 5 * held[1]
    assert result["known"]["name"] == ["L"]
    assert result["known"]["known_uncertainty"] == [0.5e-3]
    assert "L" not in result["specimen"]
    budget = result["budget"]["k2"]
    assert budget["total"] == pytest.approx(loose[1])
    assert budget["statistical"] < 0.8 * budget["total"]
    assert budget["components"]["L"] > 0.6 * budget["total"]


def test_held_values_are_named_first(tables: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    prior = "h_Al=0.20 mm ± 2 %"
    assert main(["identify", *tables, "--sheet", "none", "--prior", prior]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert (
        "held as exact (--prior gives a value its uncertainty): L 22 mm, L1 8 mm, L2 15 mm, b_Al 20 mm, rho1 11.3 g/m"
        in said
    )
    assert "E_m" not in said


@pytest.mark.parametrize(
    ("prior", "says"),
    [
        ("h_Al=0.2 mm", "write NAME=VALUE+-ERROR"),
        ("h_Al=0.2 mm +- 0 mm", "the uncertainty must be positive"),
        ("weight=3 +- 1", "weight is not an identifiable parameter"),
        ("L=22 kg +- 1 mm", "is not a quantity in m"),
        ("L=-22 mm +- 1 mm", "L"),
    ],
)
def test_a_malformed_prior_is_a_sentence(
    prior: str, says: str, tables: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["identify", *tables, "--prior", prior]) == 2
    assert says in capsys.readouterr().err
    assert main(["identify", *tables, "--method", "chain", "--prior", "L=22 mm +- 1 mm"]) == 2


def test_python_takes_priors(tables: list[str]) -> None:
    found = tb.identify(tables, priors={"L": (22e-3, 0.5e-3)})
    assert {"k2", "L"} <= set(found.names)
    with pytest.raises(ValueError, match=r"priors.*chain"):
        tb.identify(tables, method="chain", priors={"L": (22e-3, 0.5e-3)})


@pytest.mark.deep
def test_intervals_with_ruler_and_caliper_cover_the_truth() -> None:
    """40 specimens whose lengths and thickness differ from what was measured by what ruler and caliper have."""
    known = {"L": (22e-3, 2e-4), "L1": (8e-3, 2e-4), "h_Al": (2e-4, 4e-6), "rho2": (2.5e-2, 5e-4)}
    z = []
    for seed in range(40):
        rng = np.random.default_rng((9, seed))  # these 40 draws have an rms of 1.01
        true = Tactor(**{name: value + error * rng.standard_normal() for name, (value, error) in known.items()})
        fit = joint_fit(ObservationSet(measured(true, rng)), FitOptions(priors=known, n=20))
        z.append([(e.value - getattr(true, e.name)) / e.standard_error for e in fit.estimates()])
    z_all = np.array(z)
    assert z_all.shape[1] == 8
    assert np.sqrt((z_all**2).mean()) == pytest.approx(1, abs=0.2)
    assert (abs(z_all) < 1.96).mean() > 0.9
