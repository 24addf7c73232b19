"""Copies of run files with one flipped bit at a random place: each flip must be found, or be in unused space.

`python -m tests.helpers.flipped_bits RUN... [--count 1000] [--seed 1]` does many, and prints how many were found.
"""

import argparse
import collections
import random
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from protocols.runfile.verify import FileState, verify_run


def everything(path: Path) -> dict[str, Any]:
    """Return every attribute and every value of a file, read through plain h5py."""
    found: dict[str, Any] = {}

    def add(name: str, it: Any) -> None:
        found[name] = type(it).__name__
        for key in sorted(it.attrs):
            found[f"{name}@{key}"] = _plain(it.attrs[key])
        if isinstance(it, h5py.Dataset):
            found[f"{name}="] = (it.shape, it.maxshape, it.chunks, str(it.dtype.descr), _plain(it[()]))

    with h5py.File(path, "r") as file:
        add("/", file)
        file.visititems(add)
    return found


def _plain(value: Any) -> Any:
    array = np.asarray(value)
    return repr(array.tolist()) if array.dtype.hasobject else (array.shape, array.dtype.str, array.tobytes())


def flips(paths: Sequence[Path], count: int, seed: int, folder: Path) -> Iterator[tuple[Path, int, int, str]]:
    """Flip one bit in each of `count` copies; yield the file, place, bit, and 'found', 'unused' or 'missed'."""
    chance = random.Random(seed)
    contents = {path: (path.read_bytes(), everything(path)) for path in paths}
    for i in range(count):
        path = paths[i % len(paths)]
        whole, before = contents[path]
        place, bit = chance.randrange(len(whole)), chance.randrange(8)
        copy = folder / f"flip-{i}.h5"
        copy.write_bytes(whole[:place] + bytes([whole[place] ^ (1 << bit)]) + whole[place + 1 :])
        if verify_run(copy).state is not FileState.GOOD:
            result = "found"
        else:
            try:
                result = "unused" if everything(copy) == before else "missed"
            except (OSError, RuntimeError, ValueError, KeyError):
                result = "missed"
        copy.unlink()
        yield path, place, bit, result


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--count", type=int, default=1000)
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    counts: collections.Counter[str] = collections.Counter()
    with tempfile.TemporaryDirectory() as folder:
        for path, place, bit, result in flips(options.runs, options.count, options.seed, Path(folder)):
            counts[result] += 1
            if result == "missed":
                print(f"missed: {path} byte {place} bit {bit}", flush=True)
    print(f"{options.count} flipped bits: {dict(counts)}")
    return 1 if counts["missed"] else 0


if __name__ == "__main__":
    sys.exit(main())
