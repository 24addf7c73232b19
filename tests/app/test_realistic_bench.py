"""The simulated bench `sim`: its own noise in every session, nonidealities on, and a sheet that is true to its uncertainty."""

from importlib import resources
from pathlib import Path

import numpy as np
import pytest

from app.config import load_bench
from app.identification import identify, read_sheet
from app.session.request import choose_bench
from model import Tactor, parameter_specs
from model.identification import FitOptions
from protocols.base import InterferenceMeasured, Quality
from protocols.measurements.mass_resonance import MassResonance
from protocols.measurements.sine_dwell import SineDwell
from protocols.measurements.static_loading import StaticLoading
from protocols.measurements.sweep import Sweep
from protocols.measurements.voltage_steps import VoltageSteps
from protocols.runfile.reader import Run
from tests.helpers.simulated_bench import Ran, laboratory, run


def test_the_ideal_bench_is_the_one_that_comes_with_the_program() -> None:
    ideal = load_bench("ideal")
    assert ideal == load_bench("ideal")
    assert ideal.simulation_parameters.tactor == Tactor()


def test_every_session_draws_a_seed_of_its_noise_unless_one_is_given() -> None:
    seeds = {load_bench("sim").simulation_parameters.noise_seed for _ in range(3)}
    assert len(seeds) == 3
    config, _ = choose_bench("sim", "max", seed=7)
    parameters = config.simulation_parameters
    assert (parameters.seed, parameters.noise_seed) == (7, None)
    assert load_bench("ideal").simulation_parameters.noise_seed is None


def test_a_copy_of_the_file_with_a_seed_repeats_its_noise(tmp_path: Path) -> None:
    text = resources.files("sim_hardware").joinpath("realistic.toml").read_text(encoding="utf-8")
    file = tmp_path / "my.toml"
    file.write_text(text.replace("fresh_noise = true ", "fresh_noise = true\nseed = 7 "), encoding="utf-8")
    assert load_bench(str(file)).simulation_parameters.noise_seed is None
    assert load_bench(str(file)) == load_bench(str(file))


def test_no_value_of_the_specimen_is_the_paper_s_and_all_lie_within_its_instruments() -> None:
    truth, paper = load_bench("sim").simulation_parameters, Tactor()
    differ = [q.name for q in parameter_specs(Tactor) if getattr(truth.tactor, q.name) != getattr(paper, q.name)]
    assert len(differ) == len(parameter_specs(Tactor))
    with resources.as_file(resources.files("sim_hardware").joinpath("realistic.specimen.toml")) as path:
        sheet = read_sheet(path)
    true = {q.name: getattr(truth.tactor, q.name) for q in parameter_specs(Tactor)}
    true |= {name: getattr(truth.membrane, name) for name in ("L_m", "b_m", "h_m")}
    z = {name: (entry.value - true[name]) / entry.uncertainty for name, entry in sheet.values.items() if name in true}
    assert max(map(abs, z.values())) < 2, z
    beyond = truth.beyond
    assert min(beyond.creep_per_decade, beyond.hysteresis_width, beyond.side_difference, beyond.hum_m) > 0
    assert beyond.mass_share < 1


def dwell(folder: Path) -> Ran:
    with laboratory(load_bench("sim")) as lab:
        return run(SineDwell(frequencies_hz=(50, 155)), folder, lab)


@pytest.mark.deep
def test_two_sessions_share_no_noise_and_the_file_has_the_seed(tmp_path: Path) -> None:
    first, second = dwell(tmp_path / "one"), dwell(tmp_path / "two")
    with Run(first.path) as one, Run(second.path) as two:
        count = min(one.trace.sample_count, two.trace.sample_count)
        same = one.trace.read_raw("displacement")[:count] == two.trace.read_raw("displacement")[:count]
        assert np.mean(same) < 0.5
        assert (
            one.record.configuration["simulation"]["noise_seed"] != two.record.configuration["simulation"]["noise_seed"]
        )
    (event,) = [event for event in first.events if isinstance(event, InterferenceMeasured)]
    assert any(abs(line.frequency_hz - 50) < 0.5 for line in event.lines)
    assert Quality.INTERFERENCE in Quality(first.points[0].quality)
    for a, b in zip(first.points, second.points, strict=True):
        assert a.fundamental != b.fundamental
        assert abs(a.fundamental - b.fundamental) < 5 * np.hypot(a.fundamental_errors, b.fundamental_errors)


@pytest.mark.deep
def test_the_hum_s_frequency_lies_within_four_cramer_rao_bounds_of_the_truth(tmp_path: Path) -> None:
    config, _ = choose_bench("sim", "max", seed=7)
    with laboratory(config) as lab:
        ran = run(SineDwell(frequencies_hz=(155,)), tmp_path, lab)
    (event,) = [event for event in ran.events if isinstance(event, InterferenceMeasured)]
    line = event.lines[0]
    duration_s = (event.rows[1] - event.rows[0]) / SineDwell().sample_rate_hz
    bound_hz = np.sqrt(3) / np.pi * line.error_m / (line.amplitude_m * duration_s)
    assert bound_hz == pytest.approx(line.frequency_error_hz, rel=0.02)
    assert abs(line.frequency_hz - config.simulation_parameters.beyond.mains_hz) < 4 * bound_hz


@pytest.mark.deep
def test_a_sweep_is_explained_with_the_loops_of_its_own_drive(tmp_path: Path) -> None:
    """As if each line were driven by a sine alone, chi square is over 4000 with 500 degrees of freedom."""
    config, _ = choose_bench("sim", "max", seed=3)
    with laboratory(config) as lab:
        path = run(Sweep(), tmp_path, lab, safe=False).path
    with resources.as_file(resources.files("sim_hardware").joinpath("realistic.specimen.toml")) as sheet:
        found = identify([path], sheet=sheet)
    assert found.adequacy is not None
    assert found.adequacy.adequate is True, found.adequacy.message
    by_name = {estimate.name: estimate for estimate in found.estimates}
    truth = config.simulation_parameters.tactor
    for name in ("mu", "m_add", "c0"):
        assert abs(by_name[name].value - getattr(truth, name)) < 3 * by_name[name].standard_error, name


@pytest.mark.deep
def test_the_truth_is_identified_with_creep_and_hysteresis(tmp_path: Path) -> None:
    """A load test ends seconds before the voltage steps. With seed 11 all are 0.9 total standard uncertainties off at most."""
    config, _ = choose_bench("sim", "max", seed=11)
    paths = []
    with laboratory(config) as lab:
        for protocol in (StaticLoading(repeats=1), VoltageSteps(repeats=1), SineDwell()):
            lab.operator.clear_specimen()
            paths.append(run(protocol, tmp_path, lab, safe=False).path)
    also = ("asymmetry", "creep", "hysteresis", "gain_below_rest")
    with resources.as_file(resources.files("sim_hardware").joinpath("realistic.specimen.toml")) as sheet:
        found = identify(paths, options=FitOptions(also=also), sheet=sheet)
    assert found.adequacy is not None
    assert found.adequacy.adequate is True, found.adequacy.message
    simulation = config.simulation_parameters
    slopes = simulation.amplifier.map
    truth = {name: getattr(simulation.tactor, name) for name in ("k2", "mu", "m_add", "c0")}
    truth |= {"creep": simulation.beyond.creep_per_decade, "hysteresis": 2 * simulation.beyond.hysteresis_width}
    truth["gain_below_rest"] = 3 * slopes.slope_below / slopes.slope_above - 1
    by_name = {estimate.name: estimate for estimate in found.estimates}
    for name, value in truth.items():
        assert abs(by_name[name].value - value) < 1.96 * by_name[name].standard_error, name
    assert by_name["creep"].standard_error < 0.01 * truth["creep"]


@pytest.mark.deep
@pytest.mark.parametrize("seed", [102, 103])
def test_steps_after_a_mass_resonance_are_adequate(tmp_path: Path, seed: int) -> None:
    """Without the loop before the first level chi square is over 1000 with 49 degrees of freedom."""
    config, _ = choose_bench("sim", "max", seed=seed)
    with laboratory(config) as lab:
        for protocol in (MassResonance(masses_kg=(7.73e-3,), sweep_s=20.0), VoltageSteps()):
            steps = run(protocol, tmp_path, lab, safe=False).path
    with resources.as_file(resources.files("sim_hardware").joinpath("realistic.specimen.toml")) as sheet:
        found = identify([steps], sheet=sheet)
    assert found.adequacy is not None
    assert found.adequacy.adequate is True, found.adequacy.message
    by_name = {estimate.name: estimate for estimate in found.estimates}
    beyond = config.simulation_parameters.beyond
    for name, value in (("creep", beyond.creep_per_decade), ("hysteresis", 2 * beyond.hysteresis_width)):
        assert abs(by_name[name].value - value) < 3 * by_name[name].standard_error, name
