"""Deprecated names: each resolves, warns with both names, and may be overridden."""

import importlib
import sys
from collections.abc import Iterator

import pytest

from drivers import deprecated
from drivers.deprecated import MODULES, SOURCE_METHODS, adapt, adapt_driver, renamed, renamed_parameters
from drivers.interfaces import Digitizer, Source


def forget_old_modules() -> None:
    """Old paths that an earlier test, or this one, has imported."""
    for name in MODULES.keys() & sys.modules.keys():
        if isinstance(sys.modules[name].__loader__, deprecated._OldModules):
            del sys.modules[name]


@pytest.fixture
def installed() -> Iterator[None]:
    finders = [*sys.meta_path]
    forget_old_modules()
    deprecated.install()
    deprecated.install()
    yield
    sys.meta_path[:] = finders
    forget_old_modules()


@pytest.mark.usefixtures("installed")
@pytest.mark.parametrize("old", MODULES)
def test_an_old_module_has_its_old_names(old: str) -> None:
    new, *pairs = MODULES[old].split()
    if f"{new}.".startswith(f"{old}."):  # the path is in use, as a module or as a package
        module = importlib.import_module(old)
    else:
        with pytest.warns(DeprecationWarning, match=f"'{old}' is deprecated since version 0.1.0; use '{new}'"):
            module = importlib.import_module(old)
    for was, now in (pair.split("=") for pair in pairs):
        with pytest.warns(DeprecationWarning, match=rf"'{old}\.{was}' .*; use '{new}\.{now}'"):
            assert getattr(module, was) is getattr(importlib.import_module(new), now)
    with pytest.raises(AttributeError):
        module.nothing_of_that_name  # noqa: B018


@renamed(old="new", size="length")
class Base:
    length = 1

    def new(self) -> str:
        return "base"

    def call(self) -> str:
        return self.new()


def test_an_override_under_the_old_name_is_called_and_reaches_its_parent() -> None:
    with pytest.warns(DeprecationWarning, match=r"'Lab\.(old|size)' is deprecated .*; use '(new|length)'"):

        class Lab(Base):
            size = 2

            def old(self) -> str:
                return "lab " + super().old()  # type: ignore[misc]

    with pytest.warns(DeprecationWarning, match=r"'Lab\.old'"):
        assert Lab().call() == "lab base"
    assert Lab().length == 2


def test_an_old_attribute_is_read_and_set() -> None:
    base = Base()
    with pytest.warns(DeprecationWarning, match=r"'Base\.size' is deprecated .*; use 'length'"):
        base.size = 3  # type: ignore[attr-defined]
    with pytest.warns(DeprecationWarning, match=r"'Base\.size'"):
        assert base.size == base.length == 3  # type: ignore[attr-defined]


def test_an_old_keyword_argument_is_taken() -> None:
    @renamed_parameters(old="new")
    def double(new: int) -> int:
        return 2 * new

    with pytest.warns(DeprecationWarning, match="'old' is deprecated .*; use 'new'"):
        assert double(old=2) == 4  # type: ignore[call-arg]


def test_a_source_that_inherits_the_interface_gets_the_new_methods() -> None:
    class Lab(Source):
        def play(self, drive: object) -> None:
            raise KeyError(drive)

    with pytest.warns(DeprecationWarning, match=r"'Lab\.play' is deprecated .*; use 'start_drive'"):
        adapt(Lab, SOURCE_METHODS, Source)
    with pytest.raises(KeyError):
        Lab.start_drive(None, "a drive")  # type: ignore[arg-type]


def test_a_stream_of_a_digitizer_gets_its_start_time() -> None:
    class Stream:
        started_s = 7.0

    class Card:
        def stream(self) -> Stream:
            return Stream()

    adapt_driver(Card, Digitizer)
    adapt_driver(Card, Digitizer)
    with pytest.warns(DeprecationWarning, match=r"'Stream\.started_s'"):
        assert Card().stream().start_time_s == 7.0  # type: ignore[attr-defined]
