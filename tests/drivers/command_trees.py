"""Command trees of the generator families: headers as data, and what the driver does with each."""

import re
import tomllib
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from drivers.generators.dialect import Levels
from tests.drivers.test_instrument_commands import FILES, recorded
from tests.helpers.generators import truth
from tests.helpers.instrument_commands import Recorded

TREES = Path(__file__).parents[2] / "docs" / "evidence" / "commands"
DRIVERS = tuple(sorted(path.stem for path in TREES.glob("*.toml")))

DEFAULT_NODES = ("STAT", "STATE", "FIX", "CW", "IMM", "SEQ", "LEV", "AMPL", "SHAP", "RLST", "NEXT")
"""Nodes that may be omitted, or that are one setting with the node before them."""

EFFECTS = {
    "form": ({"frequency_hz": 160.0}, "has another form"),
    "amplitude": ({"emf_vpp": 0.02}, "load (high impedance)"),
    "no start": ({"advances_by_trigger": True}, "did not start"),
    "no end": ({"cycles": 60.0}, "does not end at rest"),
}
"""Effects of a setting on the burst of the self-test: settings of a simulated output stage, and words of the refusal."""


@cache
def tree(driver: str) -> Mapping[str, Any]:
    return tomllib.loads((TREES / f"{driver}.toml").read_text("utf-8"))


def plain(header: str) -> str:
    """Return a header without channel numbers and nodes that may be omitted: `SOUR1:BURS:STAT` is `BURS`."""
    nodes = [re.sub(r"\d$", "", node) for node in header.removeprefix(":").split(":")]
    kept = [node for node in nodes[1:] if node not in DEFAULT_NODES]
    return ":".join([nodes[0], *kept] if nodes[0] != "SOUR" or not kept else kept)


def headers_of(command: str) -> list[str]:
    """Return the headers of a command or query; with Siglent's pairs, one for each parameter."""
    header, _, parameters = command.partition(" ")
    if not header.startswith("C1:") and (header != "COUP" or "," not in parameters):
        return [] if header.startswith("*") else [plain(header.rstrip("?"))]
    name, fields = header.removeprefix("C1:"), parameters.split(",")
    if name in ("OUTP", "INVT", "CMBN") and fields[0] in ("ON", "OFF"):
        fields = ["STATE", *fields]
    return [
        f"{name} {field}" for field in ([fields[0]] if name in ("WVDT", "BTWV") and len(fields) % 2 else fields[::2])
    ]


@cache
def used(driver: str) -> tuple[frozenset[str], frozenset[str]]:
    """Return the headers that a driver sets, and those that it asks for at arming, over all its models with recorded commands."""
    sent: set[str] = set()
    asked: set[str] = set()
    for model in FILES[driver]["models"]:
        log: Recorded = recorded(driver, model)
        is_siglent = driver == "siglent-sdg"
        for _, command in log:
            header = command.partition(" ")[0]
            if header.endswith("?"):
                asked |= set() if is_siglent else set(headers_of(command))
            else:
                sent |= set(headers_of(command))
        asked |= expected(driver, model)
    return frozenset(sent), frozenset(asked)


def expected(driver: str, model: str) -> set[str]:
    """Return the headers of the settings that arming compares."""
    from app.config.driver_registry import SOURCES, load_driver
    from sim_hardware.bench import SimulatedBench
    from sim_hardware.clock import VirtualClock

    bench = SimulatedBench(truth(model), VirtualClock())
    dialect = load_driver(SOURCES, driver)(bench.link(), bench.clock).dialect
    names = [setting.name for setting in dialect.expected_settings(Levels(2.5, 0.0, 5.0))]
    named = {name if " " in name else plain(name) for name in names}
    coupled = {f"COUP {each}" for each in ("STATE", "TRACE", "FCOUP", "PCOUP", "ACOUP")}
    return named - {"COUP any"} | (coupled if "COUP any" in named else set())


def rule(driver: str, header: str) -> tuple[str, str]:
    """Return the status and its reason of a header that the driver does not use; two empty texts if it is unaccounted."""
    found = [
        (key, status, reason)
        for status in ("neutral", "card", "unproven")
        for key, reason in tree(driver)[status].items()
        if header == key or header.startswith((f"{key}:", f"{key} "))
    ]
    _, status, reason = max(found, key=lambda each: len(each[0]), default=("", "", ""))
    return status, reason


def status(driver: str, header: str) -> tuple[str, str]:
    """Return what the driver does with a header, and why that suffices."""
    sent, asked = used(driver)
    name = header if " " in header else plain(header)
    if name in sent or name in asked:
        return " and ".join(word for word, those in (("set", sent), ("asked", asked)) if name in those), ""
    return rule(driver, header)
