"""Does the default campaign cover the truth of the default simulated bench? python benchmarks/coverage/campaigns.py FOLDER [--seeds 20]

Each seed has a bench file of its own: dimensions and masses are drawn about the specimen sheet within its uncertainties, likewise gains and delay
of sensor and amplifier and the membrane's reference; `k2`, `mu`, `m_add` and `c0` by 3 %, the weights by the seed. `campaign new`,
`campaign run --all` and `identify --json` run in FOLDER/SEED, about two minutes each; an identification that is there is not made again.
Prints the deviations from the truth in total errors, with their root mean square and mean.
"""

import argparse
import json
import re
import subprocess
import sys
import tomllib
from importlib import resources
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from sim_hardware.plant.parameters import MountingScatter

SPECIMEN, SPECIMEN_SPREAD = ("k2", "mu", "m_add", "c0"), 0.03
LAST_MASS_MOUNTING, MASS_PUT_IN_KG = 2, 7.73e-3
TACTOR, MEMBRANE = "simulation.tactor", "simulation.membrane"


def bench_text(seed: int) -> str:
    """Return the bench file `realistic.toml` with the truth of a seed."""
    folder = resources.files("sim_hardware")
    text = (folder / "realistic.toml").read_text("utf-8")
    sheet = tomllib.loads((folder / "realistic.specimen.toml").read_text("utf-8"))
    truth = tomllib.loads(text)["simulation"]
    draw = np.random.default_rng((20261129, seed)).standard_normal
    values = {("simulation.sensor", "gain_m_per_v"): 1e-4 * (1 + 0.005 * draw())}
    values["simulation.sensor", "delay_s"] = 1e-4 + 3e-6 * draw()
    for key, nominal in (("slope_below", 200.0), ("slope_above", 600.0)):
        values["simulation.amplifier.map", key] = nominal * (1 + 0.005 * draw())
    values["simulation.hands", "reference_m"] = truth["hands"]["reference_m"] * draw()
    values |= {(TACTOR, name): truth["tactor"][name] * (1 + SPECIMEN_SPREAD * draw()) for name in SPECIMEN}
    for part, section in (("plate", TACTOR), ("masses", TACTOR), ("membrane", MEMBRANE)):
        for name, entry in sheet[part].items():
            value, error = (_si(entry[key]) for key in ("value", "uncertainty"))
            values[section, name] = value + error * draw()
    for (section, key), value in values.items():
        pattern = rf"(?ms)(^\[{re.escape(section)}\][^\n]*\n(?:(?!^\[).)*?^{key} = )[^\s#]+"
        text, count = re.subn(pattern, rf"\g<1>{value:.9g}", text, count=1)
        assert count == 1, (section, key)
    return text.replace("speed = 1.0 ", f"seed = {seed}\nspeed = 1.0 ")


def _si(text: str) -> float:
    number, unit = text.split()
    return float(number) * {"mm": 1e-3, "g/m": 1e-3}[unit]


def measure(folder: Path, seed: int) -> None:
    """Measure and identify the specimen of a seed."""
    folder.mkdir(parents=True, exist_ok=True)
    bench = folder / "bench.toml"
    bench.write_text(bench_text(seed), "utf-8")
    program, runs = [str(Path(sys.executable).with_name("tactor-bench"))], folder / "runs"
    at = ["--bench", str(bench), "--out", str(runs), "--specimen", "T7"]
    for words in (["new", *at], ["run", "--all", "--speed", "max", *at]):
        subprocess.run([*program, "campaign", *words], check=True, stdin=subprocess.DEVNULL)
    files = sorted(str(each) for each in runs.rglob("*.h5"))
    done = subprocess.run([*program, "identify", "--json", *files], stdout=subprocess.PIPE, text=True, check=False)
    (folder / "identified.json").write_text(done.stdout, "utf-8")


def deviations(folder: Path) -> tuple[str, dict[str, float]]:
    """Return the verdict of an identification, and the deviations from the truth in total errors, by parameter."""
    record = json.loads((folder / "identified.json").read_text("utf-8"))
    bench = tomllib.loads((folder / "bench.toml").read_text("utf-8"))["simulation"]
    beyond, maps = bench["beyond"], bench["amplifier"]["map"]
    truth = {**bench["tactor"], **bench["membrane"]}
    truth |= {"creep": beyond["creep_per_decade"], "mass_fraction": beyond["mass_share"]}
    truth |= {"hysteresis": 2 * beyond["hysteresis_width"], "elongation_slip": beyond["membrane_slip"]}
    truth["gain_below_rest"] = 3 * maps["slope_below"] / maps["slope_above"] - 1  # against the slope above rest
    scatter = MountingScatter(**bench["mounting"])
    # The cylinder is glued anew before each dwell: with the mass that was put in then, of the last run.
    truth["m_add"] = MASS_PUT_IN_KG + scatter.difference("mass", LAST_MASS_MOUNTING, bench["seed"])
    z = {}
    for rows in (
        each
        for each in record.values()
        if isinstance(each, dict) and {"name", "standard_error"} <= set(each) and isinstance(each["name"], list)
    ):
        for name, value, error in zip(rows["name"], rows["value"], rows["standard_error"], strict=True):
            if name in truth and error:
                z[name] = (value - truth[name]) / error
    return record["verdict"].partition("\n")[0], z


def table(folder: Path) -> str:
    """Return the table of the seeds that were identified, in Markdown."""
    seeds = sorted(int(each.parent.name) for each in folder.glob("*/identified.json"))
    found = {seed: deviations(folder / str(seed)) for seed in seeds}
    names = list(dict.fromkeys(name for _, z in found.values() for name in z))
    lines = [f"| seed | {' | '.join(names)} | verdict |", "|---" * (len(names) + 2) + "|"]
    columns = [np.array([z[name] for _, z in found.values() if name in z]) for name in names]
    figures = {
        "rms": [np.sqrt(np.mean(z**2)) for z in columns],
        "mean": [np.mean(z) for z in columns],
        "share beyond 1.96": [np.mean(np.abs(z) > 1.96) for z in columns],
    }
    lines += [f"| {label} | {' | '.join(f'{each:.2f}' for each in row)} | |" for label, row in figures.items()]
    for seed, (verdict, z) in found.items():
        shown = " | ".join(f"{z[name]:+.2f}" if name in z else "–" for name in names)
        lines.append(f"| {seed} | {shown} | {verdict} |")
    return "\n".join(lines)


def main() -> None:
    """Measure the seeds that FOLDER does not have, and print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seeds", type=int, default=20)
    args = parser.parse_args()
    for seed in range(1, args.seeds + 1):
        if not (args.folder / str(seed) / "identified.json").exists():
            measure(args.folder / str(seed), seed)
    print(table(args.folder))


if __name__ == "__main__":
    main()
