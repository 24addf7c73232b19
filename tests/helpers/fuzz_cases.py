"""Fuzz cases: seeded damage to every kind of file that the program reads, and what reads it."""

import json
import math
import random
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np

ROOT = Path(__file__).parents[1]
DATA = ROOT / "data" / "format-2"
NASTY_TEXT = "=T\x1b]0;owned\x07\x9b\u202e\x00\n"
NASTY: tuple[Any, ...] = (
    None, True, -1, 0, 1e308, -1e-320, math.nan, math.inf, 10**18, 10**400, "", "x", NASTY_TEXT, "x" * 100_000,
    "\ud800", [], {}, [None], [[1, "x"], 2], {"x": 1}, "2026-13-45", "..", "/etc/passwd", "=1+1",
)  # fmt: skip

Read = Callable[[Path], Any]
"""Reads the file and prints what it finds; returns an exit code, or anything else."""


# -- damage ---------------------------------------------------------------------------------------------------------------


def damaged_bytes(data: bytes, rng: random.Random) -> bytes:
    """Flip bits, cut off, blank, swap, double or overwrite pieces."""
    work = bytearray(data)
    for _ in range(rng.choice((1, 1, 1, 2, 8))):
        at, length = rng.randrange(len(work) or 1), min(rng.choice((1, 4, 16, 64, 512, 4096)), len(work))
        other = rng.randrange(max(len(work) - length, 1))
        at = min(at, max(len(work) - length, 0))
        match rng.randrange(7):
            case 0 | 1 if work:
                work[at] ^= 1 << rng.randrange(8)
            case 2:
                del work[at:]
            case 3:
                work[at : at + length] = bytes(length)
            case 4:
                work[at : at + length], work[other : other + length] = (
                    work[other : other + length],
                    work[at : at + length],
                )
            case 5:
                work[at:at] = work[other : other + length]
            case _:
                work[at : at + length] = rng.randbytes(length)
        if not work:
            break
    return bytes(work)


def damaged_record(value: Any, rng: random.Random) -> Any:
    """Replace, remove or add values of a JSON or TOML record."""
    if not isinstance(value, dict | list) or not value or rng.random() < 0.15:
        return rng.choice(NASTY)
    keys = list(value) if isinstance(value, dict) else list(range(len(value)))
    key = rng.choice(keys)
    copy: Any = dict(value) if isinstance(value, dict) else list(value)
    match rng.randrange(5):
        case 0:
            del copy[key]
        case 1 if isinstance(copy, dict):
            copy[rng.choice(("x", NASTY_TEXT, "name", ""))] = rng.choice(NASTY)
        case _:
            copy[key] = damaged_record(value[key], rng)
    return copy


DEEP = "[" * 100_000


def json_text(record: Any, rng: random.Random) -> bytes:
    text = json.dumps(record)
    if rng.random() < 0.1:
        text = DEEP if rng.random() < 0.3 else text.replace(": ", f": {DEEP if rng.random() < 0.5 else '9' * 5000}", 1)
    return text.encode()


def damaged_json(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.3:
        return damaged_bytes(data, rng)
    record = json.loads(data)
    for _ in range(rng.choice((1, 1, 2, 3))):
        record = damaged_record(record, rng)
    return json_text(record, rng)


TOML_VALUES = (
    "1", "-1", "1e400", "nan", "inf", "9" * 400, "9" * 5000, '""', '"x"', '"\\u001b[2J"', "[]", "{}", "true", "[" * 5000,
    "[1, 2, [3]]", "{x = 1}", "1979-05-27", '"3 V"', '"-3 kg"', "0x7fffffffffffffffff", '"""' + "x" * 50_000 + '"""',
    "{a = " * 2000, "a." * 3000 + "b",
)  # fmt: skip


def damaged_toml(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.3:
        return damaged_bytes(data, rng)
    lines = data.decode().splitlines()
    for _ in range(rng.choice((1, 1, 2, 4))):
        at = rng.randrange(len(lines))
        key = lines[at].partition("=")[0]
        match rng.randrange(5):
            case 0:
                del lines[at]
            case 1:
                lines.insert(at, rng.choice(lines))
            case 2:
                lines.insert(
                    at, rng.choice(("[x]", "[[x]]", "[a." + "b." * 5000 + "c]", "x.y.z = 1", "[simulation]", "\x1b[2J"))
                )
            case _:
                lines[at] = f"{key.strip() or 'x'} = {rng.choice(TOML_VALUES)}"
        if not lines:
            break
    return "\n".join(lines).encode("utf-8", "surrogatepass")


def damaged_table(data: bytes, rng: random.Random) -> bytes:
    if rng.random() < 0.4:
        return damaged_bytes(data, rng)
    lines = data.decode().splitlines()
    for _ in range(rng.choice((1, 2, 4))):
        at = rng.randrange(len(lines))
        cells = lines[at].split(",")
        cells[rng.randrange(len(cells))] = rng.choice(
            (
                NASTY_TEXT,
                "=1+1",
                "1e999",
                "-1e400",
                "nan",
                "9" * 5000,
                '"',
                "",
                "1,2",
                "x" * 200_000,
                "١٢",
                "0x10",
                "1_0",
            )
        )
        lines[at] = rng.choice((",", ";", "\t", " ", ",")).join(cells)
    return "\n".join(lines).encode("utf-8", "replace")


# -- damage to the structure of run files ----------------------------------------------------------------------------------


def _names(file: h5py.File) -> list[str]:
    names: list[str] = []
    file.visit(names.append)
    return names


def _new_value(data: h5py.Dataset, rng: random.Random) -> Any:
    if data.dtype.kind == "O" or (data.dtype.kind == "S" and not data.shape):
        text = data.asstr()[()] if not data.shape and data.dtype.kind == "O" else ""
        if text.startswith("{"):
            return json_text(damaged_record(json.loads(text), rng), rng)
        return rng.choice(
            ("", NASTY_TEXT.replace("\0", ""), "sweep", "completed", "running", b"\xff", "null", DEEP, "x" * 99_999)
        )
    return rng.choice((math.nan, math.inf, -1, 0, 2**63 - 1, 1e300, 1e-300, 42.0))


def damage_structure(file: h5py.File, rng: random.Random) -> None:
    """Replace, resize, retype, link or remove one object or attribute."""
    name = rng.choice(_names(file))
    found = file[name]
    attributes = dict(found.attrs)
    kind = rng.randrange(12)
    if kind == 0 and attributes:
        found.attrs[rng.choice(list(attributes))] = rng.choice(
            (1.5, "x", NASTY_TEXT.replace("\0", ""), np.zeros(9), b"\xff", -1, 2**62)
        )
        return
    if kind == 1 and attributes:
        del found.attrs[rng.choice(list(attributes))]
        return
    if kind == 2 and isinstance(found, h5py.Dataset) and found.chunks:
        found.resize(rng.choice((0, 1, 3, 10_000, 10**6, 10**9, 2**40)), axis=0)
        return
    if kind in (3, 4, 5) and isinstance(found, h5py.Dataset) and found.shape == () and found.dtype.kind != "b":
        value = _new_value(found, rng)
        del file[name]
        file[name] = value
        file[name].attrs.update(attributes)
        return
    if kind in (6, 7) and isinstance(found, h5py.Dataset) and found.shape and found.size:
        row = rng.randrange(found.shape[0])
        if found.dtype.names:
            values = found[row]
            field = rng.choice(found.dtype.names)
            text = json_text(damaged_record({"point": {"x": 1}, "index": 0, "text": "x"}, rng), rng)[:900]
            values[field] = text if found.dtype[field].kind == "S" else rng.choice((-1, 0, 2**40, 10**15))
            found[row] = values
        else:
            value = (
                rng.choice((-1, 0, 2**14))
                if found.dtype.kind in "iu"
                else rng.choice((math.nan, math.inf, -1e300, 1e300, 0.0))
            )
            found[row] = value
        return
    del file[name]
    match kind:
        case 8:
            file[name] = rng.choice(
                (h5py.SoftLink("/entry"), h5py.ExternalLink("fifo", "/x"), h5py.ExternalLink("/etc/passwd", "/"))
            )
        case 9:
            file.create_dataset(
                name,
                shape=(rng.choice((3, 10**9)),),
                dtype=rng.choice(("f8", "i2", "S1000")),
                chunks=(1024,),
                maxshape=(None,),
            )
        case 10:
            file.create_dataset(name, shape=(3,), dtype="f8", external=[("/etc/passwd", 0, 24)])
        case 11:
            file[name] = rng.choice(
                (np.zeros((2, 2)), 1 + 2j, b"x", "{}", np.zeros(3, "i8"), True, h5py.Empty("f8"), np.zeros(3, "f8,i4"))
            )
        case _:
            file.create_group(name)
    if isinstance(file.get(name, getlink=True), h5py.HardLink):
        file[name].attrs.update(attributes)


def damage_run(path: Path, rng: random.Random) -> None:
    if rng.random() < 0.35:
        path.write_bytes(damaged_bytes(path.read_bytes(), rng))
        return
    shutil.copy(path, path.with_name("other.h5"))
    with h5py.File(path, "r+") as file:
        for _ in range(rng.choice((1, 1, 2, 3))):
            damage_structure(file, rng)
