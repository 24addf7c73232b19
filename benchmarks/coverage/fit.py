"""Do the fit's errors mean what they say? python benchmarks/coverage/fit.py [--campaigns 500] [--json]

Seeded campaigns of the paper's specimen, solved in closed form (a share of them by finite elements), with realistic noise and
shared instrument errors. For every parameter of the joint fit: bias in standard errors, how often the 95 % interval holds the
truth, its standard error over the Cramer-Rao bound (computed by plain differences of the closed form), spread over bound; and the
chain's spread beside it. Then how often the verdict is a false alarm, and how large a departure must be to be noticed.
"""

import argparse
import json
import sys
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from benchmarks.campaigns import SHARED, Noise, World, perfect
from model import COVERAGE_FACTOR_95
from model.identification.adequacy import assess_adequacy
from model.identification.fit_options import FitOptions
from model.identification.joint_least_squares import joint_fit
from model.identification.observations import ObservationSet, observed_values
from model.identification.paper_chain import (
    PaperChainError,
    PaperChainOptions,
    identify_by_paper_chain,
    linearized_errors,
)
from model.parameters import Membrane, Tactor
from tests.helpers.model.redrawn import resample

TRUTH = {"k2": 7e-3, "mu": -1.33e-5, "m_add": 7.73e-3, "c0": 159.0, "E_m": 6.95e6, "c_s_0": 165.0, "c_s_delta": 5.48e4}
N = 20
"""Shape functions of the fit: wrong by 1e-4, where the errors are 2e-3 and more."""


def bound() -> np.ndarray:
    """Cramer-Rao bound of each parameter, shared errors in (with their priors), from differences of the closed form alone."""

    def world(values: dict[str, float]) -> World:
        tactor = Tactor(**{n: values[n] for n in ("k2", "mu", "m_add", "c0")})
        return World(tactor, Membrane(**{n: values[n] for n in ("E_m", "c_s_0", "c_s_delta")}))

    def rows(campaign: ObservationSet) -> np.ndarray:
        values = [observed_values(run)[0] for run in campaign.runs]
        return np.concatenate([np.concatenate((v.real, v.imag)) if np.iscomplexobj(v) else v for v in values])

    here = perfect(world(TRUTH), Noise(), SHARED)
    errors = np.concatenate([np.tile(e, 2 if np.iscomplexobj(v) else 1) for v, e in map(observed_values, here.runs)])
    columns = []
    for name, value in TRUTH.items():
        h = 1e-3 * abs(value)
        up, down = (rows(perfect(world({**TRUTH, name: value + s * h}), Noise(), SHARED)) for s in (1, -1))
        columns.append((up - down) / (2 * h) / errors)
    for error in SHARED:
        runs = []
        for run in here.runs:
            value = observed_values(run)[0]
            if error not in run.shared_errors:
                runs.append(0 * value)
            elif error.acts_on == "delay":
                runs.append(-2j * np.pi * run.frequency_hz * value)
            elif error.acts_on == "mass":
                runs.append(np.gradient(value, run.mass_kg, edge_order=2))
            else:
                runs.append(value)
        column = np.concatenate([np.concatenate((v.real, v.imag)) if np.iscomplexobj(v) else v for v in runs])
        columns.append(column / errors * error.standard_error)
    J = np.array(columns).T
    prior = np.diag([0.0] * len(TRUTH) + [1.0] * len(SHARED))
    return np.sqrt(np.diag(np.linalg.inv(J.T @ J + prior)))[: len(TRUTH)]


def coverage(campaigns: int, chains: int = 100) -> dict[str, dict[str, float]]:
    """Per parameter the figures of the module's first lines."""
    sources = {False: perfect(World(), Noise(), SHARED), True: perfect(World(by_elements=True), Noise(), SHARED)}
    names = list(TRUTH)
    found, errors, alarms, steps = [], [], 0, []
    for seed in range(campaigns):
        measured, _ = resample(sources[seed % 5 == 0], np.random.default_rng((20261121, seed)))
        fit = joint_fit(measured, FitOptions(n=N))
        got = {e.name: e for e in fit.estimates()}
        found.append([got[n].value for n in names])
        errors.append([got[n].standard_error for n in names])
        alarms += not assess_adequacy(fit).adequate
        if seed < chains:
            with suppress(PaperChainError):
                steps.append([identify_by_paper_chain(measured, PaperChainOptions(n=N)).values[n] for n in names])
    x, s, truth = np.array(found), np.array(errors), np.array(list(TRUTH.values()))
    z = (x - truth) / s
    limit, chained = bound(), np.array(steps)
    said, _ = linearized_errors(
        sources[False], PaperChainOptions(n=N), identify_by_paper_chain(sources[False], PaperChainOptions(n=N))
    )
    told = {e.name: e.standard_error for e in said}
    out = {}
    for i, n in enumerate(names):
        out[n] = {
            "bias / standard error": float(z[:, i].mean()),
            "coverage of 95 %": float(np.mean(abs(z[:, i]) < COVERAGE_FACTOR_95)),
            "standard error / bound": float(s[:, i].mean() / limit[i]),
            "spread / bound": float(x[:, i].std() / limit[i]),
            "standard error [%]": float(100 * s[:, i].mean() / abs(truth[i])),
            "chain's spread [%]": float(100 * chained[:, i].std() / abs(truth[i])),
            "chain's standard error [%]": float(100 * told[n] / abs(truth[i])),
            "chain / joint": float(chained[:, i].std() / x[:, i].std()),
        }
    out["all"] = {"campaigns": campaigns, "chains": len(steps), "false alarms": alarms / campaigns}
    return out


DEPARTURES = {
    "hysteresis": (0.002, 0.005, 0.01, 0.02),
    "creep": (0.0025, 0.005, 0.01, 0.02),
    "drift": (0.002, 0.005, 0.01, 0.02),
    "clamp": (100.0, 50.0, 25.0, 15.0),
}


def noticed(repeats: int = 10) -> dict[str, dict[str, float]]:
    """Share of campaigns in which a departure of each size is noticed."""
    out: dict[str, dict[str, float]] = {}
    for kind, sizes in DEPARTURES.items():
        out[kind] = {}
        for size in sizes:
            source = perfect(replace(World(), **{kind: size}), Noise(), SHARED)
            seen = 0
            for seed in range(repeats):
                measured, _ = resample(source, np.random.default_rng((1, seed)))
                seen += assess_adequacy(joint_fit(measured, FitOptions(n=N))).adequate is False
            out[kind][f"{size:g}"] = seen / repeats
    return out


def seven_shapes() -> dict[str, float]:
    """What the paper's seven shapes put into the parameters, in standard errors: no noise, n = 7."""
    fit = joint_fit(perfect(World(), Noise(), SHARED))
    return {e.name: (e.value - TRUTH[e.name]) / e.standard_error for e in fit.estimates()}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--campaigns", type=int, default=500)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    args = parser.parse_args()
    numbers = coverage(args.campaigns)
    extra = {"noticed": noticed(), "seven shapes, bias in standard errors": seven_shapes()}
    if args.json:
        print(json.dumps(numbers | extra))
        return
    for name, row in numbers.items():
        print(name)
        for what, value in row.items():
            print(f"  {what:30s} {value:10.4g}")
    for what, table in extra.items():
        print(what, json.dumps(table))
    own = [row for name, row in numbers.items() if name != "all"]
    goals = (
        ("|bias| < 0.2 standard errors", all(abs(r["bias / standard error"]) < 0.2 for r in own)),
        ("coverage 93..97 %", all(0.93 <= r["coverage of 95 %"] <= 0.97 for r in own)),
        ("standard errors within 10 % of the bound", all(abs(r["standard error / bound"] - 1) < 0.1 for r in own)),
    )
    for words, met in goals:
        print(f"goal {words}: {'met' if met else 'not met'}")


if __name__ == "__main__":
    main()
