"""Rules of tests/structure.py: each detects what it forbids."""

import ast

import pytest

from tests.structure import built_in_protocols, composes_uncertainty, names_a_protocol, names_of_families

NAMES = frozenset(built_in_protocols())


@pytest.mark.parametrize(
    "code",
    [
        "from protocols.measurements.sweep import Sweep",
        'KINDS = {"sine-dwell": 1}',
        'if run.protocol == "sweep": pass',
        'kind = PROTOCOLS["latency"]',
        'match name:\n    case "free-decay": pass',
    ],
)
def test_a_protocol_named_outside_protocols_is_detected(code: str) -> None:
    assert names_a_protocol(ast.parse(code), NAMES)


@pytest.mark.parametrize(
    "code",
    [
        'effects = {"hysteresis": 0.15}',
        'help = "a protocol, such as sine-dwell"',
        "aspects = PROTOCOLS[run.protocol].aspects",
    ],
)
def test_other_texts_are_no_protocol_names(code: str) -> None:
    assert not names_a_protocol(ast.parse(code), NAMES)


@pytest.mark.parametrize(
    "code",
    [
        'f"{value} ± {error:.2g} Hz"',
        'f"(limit ±{limit:g} V)"',
        '"±" + error',
        'value + " +- " + error',
        '" ± ".join((value, error))',
        'TEXT = "{} ± {}"',
    ],
)
def test_an_uncertainty_composed_by_hand_is_detected(code: str) -> None:
    assert composes_uncertainty(ast.parse(code))


@pytest.mark.parametrize(
    "code", ['HEAD = "value ± total"', 'f"{name}; ± is the total uncertainty"', 're.match(r"[+-]?[0-9]+", text)']
)
def test_a_sign_that_explains_composes_nothing(code: str) -> None:
    assert not composes_uncertainty(ast.parse(code))


@pytest.mark.parametrize(
    "text", ['"siglent-sdg"', "class X(SiglentSdg): ...", "# as an SDG1032X", "the SDG6000X series"]
)
def test_a_family_of_generators_that_is_named_is_detected(text: str) -> None:
    assert [family for family, pattern in names_of_families().items() if pattern.search(text)] == ["siglent"]
