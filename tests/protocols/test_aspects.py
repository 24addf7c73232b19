"""Aspects of protocols: where a built-in protocol, a laboratory's and an unknown one have theirs."""

import re
from importlib import import_module
from pathlib import Path

import pytest

from protocols import Aspects
from protocols.registry import BUILT_IN_PROTOCOLS, PROTOCOLS, ProtocolFileError, aspects_of, load_protocol_file

OWN = """
from protocols import Aspects
from protocols.measurements.free_decay import FreeDecay as Base

class OwnAspects(Aspects):
    colour = "red"

class Mine(Base):
    name = "mine"
    aspects = OwnAspects()
"""


@pytest.mark.parametrize("name", BUILT_IN_PROTOCOLS)
def test_aspects_of_a_built_in_protocol_are_in_its_module(name: str) -> None:
    module = PROTOCOLS[name].__module__.rpartition(".")[2]
    assert aspects_of(name) is import_module(f"protocols.aspects.{module}").ASPECTS
    assert PROTOCOLS[name].aspects is aspects_of(name)


def test_a_protocol_file_carries_its_own_aspects(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(OWN)
    kind = load_protocol_file(tmp_path / "mine.py")
    try:
        assert aspects_of("mine").colour == "red"
        assert kind.model_validate({}).aspects is kind.aspects
    finally:
        del PROTOCOLS["mine"]


def test_a_class_in_the_place_of_aspects_is_refused_when_the_file_is_read(tmp_path: Path) -> None:
    (tmp_path / "mine.py").write_text(OWN.replace("OwnAspects()", "OwnAspects"))
    message = "the aspects of Mine are the class OwnAspects, not an instance of it; write aspects = OwnAspects()"
    with pytest.raises(ProtocolFileError, match=re.escape(message)):
        load_protocol_file(tmp_path / "mine.py")
    assert "mine" not in PROTOCOLS


def test_a_protocol_file_of_the_environment_is_found_by_name(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "mine.py").write_text(OWN)
    monkeypatch.setenv("TACTOR_BENCH_PROTOCOLS", str(tmp_path / "mine.py"))
    monkeypatch.setattr(PROTOCOLS, "has_searched", False)
    try:
        assert aspects_of("mine").colour == "red"
    finally:
        del PROTOCOLS["mine"]


def test_an_unknown_protocol_has_the_defaults() -> None:
    assert type(aspects_of("from-elsewhere")) is Aspects
