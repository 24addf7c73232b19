"""Import contracts of pyproject.toml: kept by the product, and each detects a forbidden import."""

import ast
from collections.abc import Iterator
from contextlib import contextmanager
from copy import deepcopy
from pathlib import Path
from typing import Any

import grimp
import pytest
from importlinter import api  # noqa: F401 - configures import-linter
from importlinter.application import use_cases
from importlinter.domain.contract import Contract, registry

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture(scope="module")
def contracts() -> dict[str, Contract]:
    """The contracts of pyproject.toml by name."""
    options = use_cases.read_user_options(str(ROOT / "pyproject.toml"))
    use_cases._register_contract_types(options)
    return {
        each["name"]: registry.get_contract_class(each["type"])(each["name"], options.session_options, each)
        for each in options.contracts_options
    }


@pytest.fixture(scope="module")
def graph() -> grimp.ImportGraph:
    """The import graph of the product, built as import-linter builds it."""
    options = use_cases.read_user_options(str(ROOT / "pyproject.toml")).session_options
    return grimp.build_graph(*options["root_packages"], include_external_packages=True, cache_dir=None)


def kept(contract: Contract, graph: grimp.ImportGraph) -> bool:
    return contract.check(deepcopy(graph), verbose=False).kept


@contextmanager
def planted(graph: grimp.ImportGraph, importer: str, imported: str) -> Iterator[None]:
    """A graph in which one module imports what it should not."""
    assert importer in graph.modules
    assert imported in graph.modules
    assert not graph.direct_import_exists(importer=importer, imported=imported)
    graph.add_import(importer=importer, imported=imported, line_number=1, line_contents=f"import {imported}")
    try:
        yield
    finally:
        graph.remove_import(importer=importer, imported=imported)


def test_the_product_keeps_every_contract(contracts: dict[str, Any], graph: grimp.ImportGraph) -> None:
    assert [name for name, contract in contracts.items() if not kept(contract, graph)] == []


@pytest.mark.parametrize(
    ("importer", "imported", "broken"),
    [
        ("drivers.clock", "protocols.base.events", "Product layers"),
        ("model.membrane", "drivers", "Product layers"),
        ("protocols.base.steps", "sim_hardware.plant.plant", "Product layers"),
        ("app.common.exit_codes", "app.session.session", "App layers"),
        ("app.archive.transfer", "app.cli.main", "App layers"),
        ("app.gui.widgets.form", "app.gui.plots.chart", "GUI layers"),
        ("app.gui.runs.page", "app.gui.explore.page", "Pages are independent"),
        ("app.gui.shell.tabs", "app.gui.shell.menus", "Main window layers"),
        ("app.cli.output", "app.gui.widgets.form", "Front ends do not"),
        ("tactor_bench._bench", "app.cli.headless", "Front ends do not"),
        ("protocols.base.steps", "protocols.runfile.writer", "Protocol layers"),
        ("drivers.transport.scpi", "drivers.generators.keysight", "Driver layers"),
        ("model.membrane", "model.identification.joint_least_squares", "Model layers"),
        ("sim_hardware.plant.plant", "sim_hardware.bench", "Simulator layers"),
        ("drivers.sensors.laser_sensor", "model.parameters", "Drivers use only"),
        ("model.membrane", "pydantic", "The model needs numpy"),
        ("app.session.session", "PySide6", "Qt only"),
        ("app.session.session", "h5py", "h5py only"),
        ("app.session.session", "matplotlib", "matplotlib only"),
        ("drivers.transport.scpi", "nidaqmx", "NI libraries only"),
        ("app.session.bench_connection", "pyvisa", "pyvisa and pyserial only"),
    ],
)
def test_a_wrong_import_breaks_its_contract(
    importer: str, imported: str, broken: str, contracts: dict[str, Contract], graph: grimp.ImportGraph
) -> None:
    (contract,) = (contract for name, contract in contracts.items() if name.startswith(broken))
    with planted(graph, importer, imported):
        assert not kept(contract, graph)


def test_drivers_take_the_amplifier_map_alone_from_the_model() -> None:
    taken = {
        name.name
        for path in (ROOT / "drivers").rglob("*.py")
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        if isinstance(node, ast.ImportFrom) and (node.module or "").split(".")[0] == "model"
        for name in node.names
    }
    assert taken == {"AmplifierMap"}
