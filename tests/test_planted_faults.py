"""Planted faults: mutants are made as described, and the tests find a seeded sample of them."""

import ast
import os
import random
from pathlib import Path

import pytest

from tests import planted_faults
from tests.planted_faults import AREAS, PER_AREA, ROOT, Mutant, find_mutants, sample

FILES = sorted(file for files in AREAS.values() for file in files)


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


def test_listed_equivalent_mutants_exist() -> None:
    known = {
        (mutant.file, (ROOT / mutant.file).read_text("utf-8").splitlines()[mutant.line - 1].strip(), mutant.kind)
        for file in FILES
        for mutant in find_mutants(file)
    }
    assert planted_faults.EQUIVALENT.keys() <= known


@pytest.mark.deep
@pytest.mark.parametrize("area", ["safety", "runner", "signals"])
def test_a_sample_of_planted_faults_is_found(area: str) -> None:
    """PLANTED_FAULT_SEED chooses another sample; python tests/planted_faults.py tries all of them."""
    seed = int(os.environ.get("PLANTED_FAULT_SEED", "1"))
    survivors = planted_faults.run([(area, mutant) for mutant in sample(area, 3, seed)], 1)
    assert len(survivors) <= 1, f"seed {seed}: {[mutant.describe() for _, mutant in survivors]}"


def test_a_mutant_is_applied_by_offsets(tmp_path: Path) -> None:
    source = "x = 'µ'\ny = 1 < 2\n".encode()
    start = source.index(b"1 < 2")
    assert Mutant("a.py", 2, start, start + 5, "1 >= 2", "comparison negated").apply(source) == (
        "x = 'µ'\ny = 1 >= 2\n".encode()
    )
