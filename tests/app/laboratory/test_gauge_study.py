"""Gauge study: the worked example of AIAG, unbalanced plans with known spreads, and runs that exist."""

import json
from pathlib import Path

import numpy as np
import pytest

from app.cli.main import main
from app.fleet.catalogue_values import FleetError
from app.fleet.gauge_study import gauge_study
from protocols.base import RunConditions, SpecimenMounted
from tests.helpers.fleet_runs import write_run

AIAG = {
    "A": "0.29 -0.56 1.34 0.47 -0.80 0.02 0.59 -0.31 2.26 -1.36 0.41 -0.68 1.17 0.50 -0.92 -0.11 0.75 -0.20 1.99 -1.25 0.64 -0.58 1.27 0.64 -0.84 -0.21 0.66 -0.17 2.01 -1.31",
    "B": "0.08 -0.47 1.19 0.01 -0.56 -0.20 0.47 -0.63 1.80 -1.68 0.25 -1.22 0.94 1.03 -1.20 0.22 0.55 0.08 2.12 -1.62 0.07 -0.68 1.34 0.20 -1.28 0.06 0.83 -0.34 2.19 -1.50",
    "C": "0.04 -1.38 0.88 0.14 -1.46 -0.29 0.02 -0.46 1.77 -1.49 -0.11 -1.13 1.09 0.20 -1.07 -0.67 0.01 -0.56 1.45 -1.77 -0.15 -0.96 0.67 0.11 -1.45 -0.49 0.21 -0.49 1.87 -2.16",
}
"""Ten parts in a row, three times, by three appraisers: AIAG, Measurement Systems Analysis, 4th ed., 2010, ch. III, section B."""


def aiag() -> tuple[np.ndarray, dict[str, list[str]]]:
    values = np.array([float(x) for row in AIAG.values() for x in row.split()])
    parts = [str(i % 10) for i in range(90)]
    appraisers = [who for who in AIAG for _ in range(30)]
    both = [f"{p} {a}" for p, a in zip(parts, appraisers, strict=True)]
    return values, {"specimen": parts, "operator": appraisers, "specimen x operator": both}


def test_the_worked_example_of_aiag() -> None:
    values, factors = aiag()
    cells = values.reshape(3, 3, 10)
    squares = 30 * np.var(cells.mean(axis=(1, 2))) * 3, 10 * 9 * np.var(cells.mean(axis=(0, 1)))
    assert squares == pytest.approx((3.1673, 88.3619), abs=5e-5)  # the book's sums of squares: the data are the book's
    study = gauge_study(values, factors)
    found = {each.name: each.sd for each in study.components}
    assert found["repeat"] == pytest.approx(0.199933, abs=2e-6)
    assert found["operator"] == pytest.approx(0.226838, abs=2e-6)
    assert found["specimen"] == pytest.approx(1.042327, abs=2e-6)
    assert found["specimen x operator"] == pytest.approx(0.0, abs=1e-6)
    assert study.gauge.sd == pytest.approx(0.302373, abs=2e-6)
    assert study.total.sd == pytest.approx(1.0853, abs=1e-4)
    assert study.categories == 4
    error = 0.199933 * np.sqrt(
        1 / (2 * 60)
    )  # with the book's 60 degrees of freedom: the interaction is not known to be none
    assert study.components[-1].sd_error == pytest.approx(error, rel=1e-3)


@pytest.mark.deep
def test_unbalanced_plans_give_the_spreads_that_were_drawn_and_errors_that_hold() -> None:
    true = np.array([3.0, 1.5, 1.0, 0.3]) ** 2
    found, errors = [], []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        specimens, operators = rng.normal(0, 3.0, 12), rng.normal(0, 1.5, 8)
        values, labels = [], []
        for s in range(12):
            for o in rng.choice(8, 4, replace=False):
                for m in range(rng.integers(1, 4)):
                    mounted = rng.normal(0, 1.0)
                    for _ in range(rng.integers(1, 3)):
                        values.append(specimens[s] + operators[o] + mounted + rng.normal(0, 0.3))
                        labels.append((f"{s}", f"{o}", f"{s} {o} {m}"))
        names = ("specimen", "operator", "mounting")
        study = gauge_study(np.array(values), {n: [each[i] for each in labels] for i, n in enumerate(names)})
        found.append([each.variance for each in study.components])
        errors.append([each.variance_error for each in study.components])
    scatter, stated = np.std(found, axis=0, ddof=1), np.sqrt(np.mean(np.square(errors), axis=0))
    assert np.abs((np.mean(found, axis=0) - true) / (stated / np.sqrt(12))).max() < 3
    assert ((scatter / stated > 0.5) & (scatter / stated < 1.6)).all(), scatter / stated


def test_repeats_that_hardly_differ_leave_the_other_errors_as_they_are() -> None:
    means, tiny = np.array([1.0, 2.0, 4.0, 5.0]), 1e-3
    values = np.repeat(means, 3) + np.tile([-tiny, 0.0, tiny], 4)
    study = gauge_study(values, {"mounting": [str(i // 3) for i in range(12)]})
    mounting, repeat = study.components
    assert mounting.sd == pytest.approx(np.std(means, ddof=1), rel=1e-3)
    assert mounting.sd_error == pytest.approx(mounting.sd / np.sqrt(2 * 3), rel=0.01)
    assert repeat.sd == pytest.approx(tiny, rel=0.01)


def test_sources_that_change_together_are_named_and_not_shared_out() -> None:
    values = np.array([1.0, 1.1, 2.0, 2.1, 3.0, 3.2])
    names = ["a", "a", "b", "b", "c", "c"]
    study = gauge_study(values, {"specimen": names, "operator": ["x"] * 6, "mounting": [n * 2 for n in names]})
    assert [each.name for each in study.components] == ["specimen", "repeat"]
    assert study.inseparable == (
        "one operator only",
        "mounting cannot be told from specimen: they change together",
    )
    with pytest.raises(FleetError, match=r"nothing repeats in these 3 values .*every value has a specimen of its own"):
        gauge_study(np.array([1.0, 2.0, 4.0]), {"specimen": ["a", "b", "c"], "operator": ["x", "x", "x"]})


@pytest.mark.deep
def test_the_command_splits_the_scatter_of_runs_that_exist(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng, minute = np.random.default_rng(5), 0
    specimens = {name: rng.normal(160, 4.0) for name in ("T1", "T2", "T3")}
    for name, own in specimens.items():
        for operator, bias in (("Anna", 0.0), ("Ben", 1.5)):
            for mounting in range(2):
                placed = rng.normal(0, 0.5)
                for _ in range(2):
                    minute += 1
                    at = f"2026-03-01T0{mounting}:0{len(operator)}:00+00:00"
                    facts = {
                        "conditions": RunConditions(operator, "given"),
                        "mountings": (SpecimenMounted("mass", at, operator),),
                    }
                    resonance_hz = own + bias + placed + rng.normal(0, 0.05)
                    write_run(tmp_path, name, minute / 1440, 5e-4, resonance_hz, 1, **facts)
    picture = tmp_path / "gauge.png"
    arguments = ["repeatability", str(tmp_path), "--quantity", "natural_frequency"]
    assert main([*arguments, "--json", "--picture", str(picture)]) == 0
    assert picture.read_bytes().startswith(b"\x89PNG")
    answer = json.loads(capsys.readouterr().out)
    assert answer["components"]["source"] == [
        "specimen", "operator", "mounting", "specimen x operator", "repeat", "gauge (R&R)", "total"
    ]  # fmt: skip
    sd = dict(zip(answer["components"]["source"], answer["components"]["sd"], strict=True))
    assert 0.03 < sd["repeat"] < 0.08
    assert 0.2 < sd["mounting"] < 1.0
    assert sd["specimen"] > 1.0
    assert answer["components"]["levels"][:5] == ["3", "2", "12", "6", "24"]
    assert main(arguments) == 0
    assert "where the scatter comes from" in capsys.readouterr().out
