"""Planted faults: mutants are made as described, and the tests find a seeded sample of them."""

import ast
import os
import random
from pathlib import Path

import pytest

from tests import planted_faults
from tests.planted_faults import AREAS, PER_AREA, ROOT, Mutant, find_mutants, sample

FILES = sorted(file for files in AREAS.values() for file in files)


@pytest.mark.deep
@pytest.mark.one_in(5)
@pytest.mark.parametrize("file", FILES)
def test_every_mutant_is_valid_python_and_changes_the_code(file: str) -> None:
    source = (ROOT / file).read_bytes()
    original = ast.dump(ast.parse(source))
    mutants = find_mutants(file)
    assert mutants
    for mutant in random.Random(1).sample(mutants, min(len(mutants), 25)):
        assert ast.dump(ast.parse(mutant.apply(source))) != original, mutant.describe()


def test_responsible_tests_exist_and_there_are_200_mutants() -> None:
    for files in AREAS.values():
        assert all((ROOT / test).is_file() for tests in files.values() for test in tests.split())
    assert sum(PER_AREA.values()) >= 200


def test_the_same_seed_gives_the_same_mutants() -> None:
    assert sample("safety", 10, 3) == sample("safety", 10, 3)
    assert sample("safety", 10, 3) != sample("safety", 10, 4)


@pytest.mark.deep
def test_listed_equivalent_mutants_exist() -> None:
    known = {
        (mutant.file, (ROOT / mutant.file).read_text("utf-8").splitlines()[mutant.line - 1].strip(), mutant.text)
        for file in FILES
        for mutant in find_mutants(file)
    }
    assert planted_faults.EQUIVALENT.keys() <= known


@pytest.mark.deep
@pytest.mark.timeout(3600)  # three times the tests of three modules, on a slow computer with other work
@pytest.mark.parametrize("area", ["safety", "runner", "signals"])
def test_a_sample_of_planted_faults_is_found(area: str) -> None:
    """PLANTED_FAULT_SEED chooses another sample; python tests/planted_faults.py tries all of them."""
    seed = int(os.environ.get("PLANTED_FAULT_SEED", "1"))
    mutants = [(area, mutant) for mutant in sample(area, 3, seed) if not mutant.is_equivalent]
    survivors = planted_faults.run(mutants, 1)
    assert len(survivors) <= 1, f"seed {seed}: {[mutant.describe() for _, mutant in survivors]}"


def test_a_change_elsewhere_leaves_the_sample_as_it_is(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lines = [f"def limit_{i}(x):\n    return x > {i} and x + {i}\n" for i in range(2, 40)]
    monkeypatch.setattr(planted_faults, "ROOT", tmp_path)
    monkeypatch.setattr(planted_faults, "AREAS", {"one": {"limits.py": ""}})

    def chosen() -> list[str]:
        return [mutant.describe().split("  ", 1)[1] for mutant in sample("one", 20, 1)]

    (tmp_path / "limits.py").write_text("\n".join(lines))
    before = chosen()
    (tmp_path / "limits.py").write_text("\n".join([lines[0].replace("> 2", "> 1000"), *lines[1:]]))
    assert len(set(before) & set(chosen())) >= 17


SMALL = "def at_rest(volts):\n    return volts < 1\n"
"""A module of which every test of this kind takes a moment only."""

HANGS = "import small\n\n\ndef test_it():\n    while small.at_rest(2):\n        pass\n"
PASSES = "import small\n\n\ndef test_it():\n    assert small.at_rest(0) is not None\n"
FINDS = "import small\n\n\ndef test_it():\n    assert small.at_rest(0)\n"
FAILS = "def test_it():\n    raise AssertionError\n"


@pytest.mark.deep
@pytest.mark.parametrize(("code", "found"), [(HANGS, True), (PASSES, False), (FINDS, True), (FAILS, None)])
def test_tests_that_fail_or_hang_find_a_mutant_and_those_that_fail_anyway_find_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: str, found: bool | None
) -> None:
    (tmp_path / "small.py").write_text(SMALL)
    (tmp_path / "test_small.py").write_text(code)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers = deep\n")
    monkeypatch.setattr(planted_faults, "copy_repository", lambda _: None)
    monkeypatch.setattr(planted_faults, "LEAST_LIMIT_S", 2.0)
    monkeypatch.setattr(planted_faults, "SLOWER", 1.0)
    begin = SMALL.index("volts < 1")
    mutant = Mutant("small.py", 2, begin, begin + 9, "volts > 1", "comparison negated")  # as long as the original
    tree = planted_faults.Tree(tmp_path)
    if found is None:
        with pytest.raises(RuntimeError, match="fail without any planted fault"):
            tree.is_found(mutant, "test_small.py")
    else:
        assert tree.is_found(mutant, "test_small.py") == found
    assert (tmp_path / "small.py").read_text() == SMALL


def test_a_mutant_is_applied_by_offsets(tmp_path: Path) -> None:
    source = "x = 'µ'\ny = 1 < 2\n".encode()
    start = source.index(b"1 < 2")
    assert Mutant("a.py", 2, start, start + 5, "1 >= 2", "comparison negated").apply(source) == (
        "x = 'µ'\ny = 1 >= 2\n".encode()
    )
