"""Summaries of built-in protocols, which a list shows without importing any."""

from inspect import getdoc

from protocols import PROTOCOLS
from protocols.registry import BUILT_IN_PROTOCOLS, ProtocolRegistry


def test_a_summary_is_the_first_line_of_the_description_and_imports_nothing() -> None:
    registry = ProtocolRegistry(BUILT_IN_PROTOCOLS)
    summaries = {name: registry.summary(name) for name in registry}
    assert all(isinstance(place, str) for place in registry._classes.values())
    assert summaries == {name: (getdoc(PROTOCOLS[name]) or "").splitlines()[0] for name in BUILT_IN_PROTOCOLS}
