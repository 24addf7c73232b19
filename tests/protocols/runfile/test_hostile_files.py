"""Run files built to do harm: links, foreign storage, sparse sizes, wrong types, runs that continue themselves."""

import os
import resource
import shutil
from collections.abc import Callable, Iterator
from functools import cached_property
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from protocols.runfile import open as open_run
from protocols.runfile.reader import NotARunError, Run, RunReadError
from tests.helpers.run_files import finished_run


@pytest.fixture(scope="module")
def original(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory.mktemp("original"))


@pytest.fixture
def path(original: Path, tmp_path: Path) -> Path:
    return Path(shutil.copy(original, tmp_path))


@pytest.fixture(autouse=True)
def little_memory() -> Iterator[None]:
    """One GB more than the process has, so that a reader that takes what a file declares fails here."""
    before = resource.getrlimit(resource.RLIMIT_AS)
    used = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
    resource.setrlimit(resource.RLIMIT_AS, (used + 1_000_000_000, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_AS, before)


def replaced(file: h5py.File, name: str, **new: Any) -> None:
    del file[name]
    file.create_dataset(name, **new)


def external_storage(file: h5py.File) -> None:
    replaced(file, "entry/points/noise", shape=(2,), dtype="f8", external=[("/etc/passwd", 0, 16)])
    file["entry/points/noise"].attrs["units"] = "m"


def virtual(file: h5py.File) -> None:
    layout = h5py.VirtualLayout((2,), "f8")
    layout[:] = h5py.VirtualSource("/tmp/other.h5", "x", (2,))
    del file["entry/points/phase"]
    file.create_virtual_dataset("entry/points/phase", layout)


def linked(name: str, link: Any) -> Callable[[h5py.File], None]:
    def mutate(file: h5py.File) -> None:
        if name in file:
            del file[name]
        file[name] = link

    return mutate


def nested(file: h5py.File) -> None:
    group = file["entry"]
    for _ in range(40):
        group = group.create_group("deeper")


def in_itself(file: h5py.File) -> None:
    file["entry/points/again"] = file["entry"]


def sparse(name: str, dtype: Any, **more: Any) -> Callable[[h5py.File], None]:
    def mutate(file: h5py.File) -> None:
        units = dict(file[name].attrs)
        replaced(file, name, shape=(10**9,), dtype=dtype, maxshape=(None,), chunks=(1024,), **more)
        file[name].attrs.update(units)

    return mutate


def chunk_of_a_gigabyte(file: h5py.File) -> None:
    replaced(file, "entry/points/phase", shape=(2,), dtype="f8", maxshape=(None,), chunks=(2**27,))


def texts_of_any_length(file: h5py.File) -> None:
    file.create_dataset("entry/points/words", data=["x"] * 3, dtype=h5py.string_dtype())


MUTATORS: dict[str, tuple[Callable[[h5py.File], None], str]] = {
    "link to a FIFO": (linked("entry/title", h5py.ExternalLink("fifo", "/x")), r"entry/title is a link to another file, 'fifo'"),
    "link to a file": (linked("entry/points", h5py.ExternalLink("/tmp/x.h5", "/")), "entry/points is a link to another file"),
    "earlier elsewhere": (linked("entry/earlier", h5py.ExternalLink("/tmp/x.h5", "/entry")), "entry/earlier is a link"),
    "soft link": (linked("entry/title", h5py.SoftLink("/entry/earlier/title")), "link to another place"),
    "storage elsewhere": (external_storage, "entry/points/noise has its data in another file, '/etc/passwd'"),
    "virtual": (virtual, "entry/points/phase is a virtual dataset"),
    "nested": (nested, "nested more than 16 deep"),
    "in itself": (in_itself, "nested more than 16 deep"),
    "sparse column": (sparse("entry/points/phase", "f8"), "declare 8000 MB, and the file has"),
    "sparse and compressed": (sparse("entry/points/phase", "f8", compression="gzip"), "declare 8000 MB"),
    "sparse blocks": (sparse("entry/blocks", "i8"), "declare 8000 MB"),
    "large chunk": (chunk_of_a_gigabyte, "chunks of 1074 MB"),
    "texts": (texts_of_any_length, "array of texts of any length"),
    "unknown filter": (sparse("entry/points/phase", "f8", compression="lzf"), "a filter that this program does not use"),
}  # fmt: skip


@pytest.mark.parametrize("name", MUTATORS)
def test_a_file_that_leads_out_of_itself_is_refused_before_anything_is_read(
    name: str, path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(path.parent)
    os.mkfifo("fifo")
    mutate, says = MUTATORS[name]
    with h5py.File(path, "r+") as file:
        mutate(file)
    with pytest.raises(RunReadError, match=says) as caught:
        Run(path)
    assert str(caught.value).startswith(f"{path} is not read: ")
    assert str(caught.value).endswith("which no run file has; take another copy of it")
    with h5py.File(path, "r+"):  # it was closed
        pass


def test_a_file_of_another_program_is_none_of_ours_whatever_it_links_to(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = h5py.ExternalLink("/tmp/y.h5", "/")
        file.attrs["format"] = np.zeros(3)
    with pytest.raises(NotARunError):
        Run(tmp_path / "other.h5")


@pytest.mark.parametrize(
    "name", ["/etc/passwd.h5", "C:\\runs\\a.h5", "\\\\server\\share\\a.h5", "..", "a.txt", "a\nb.h5"]
)
def test_what_a_run_continues_is_a_run_file_beside_it(name: str, path: Path) -> None:
    with h5py.File(path, "r+") as file:
        replaced(file, "entry/continues", data=name)
    with Run(path) as run, pytest.raises(RunReadError, match="it continues '"):
        list(run.recordings())


@pytest.mark.parametrize("count", [1, 2])
def test_a_run_that_continues_itself_is_refused(count: int, tmp_path: Path) -> None:
    paths = [finished_run(tmp_path, specimen) for specimen in ("A", "B")[:count]]
    for path, other in zip(paths, paths[::-1], strict=True):
        with h5py.File(path, "r+") as file:
            replaced(file, "entry/continues", data=other.name)
    with Run(paths[0]) as run:
        assert run.resumed_from == paths[-1]
        for read in (run.entries, lambda: list(run.recordings())):
            with pytest.raises(RunReadError, match="continues this run in its turn"):
                read()


def everything(run: Run) -> Iterator[Callable[[], Any]]:
    """Every lazy property and method of a run and its trace."""
    for owner in (run, run.trace):
        for name, member in vars(type(owner)).items():
            if name.startswith("_") or name in ("close", "channel_scale", "read_raw", "recording"):
                continue
            if isinstance(member, property | cached_property):
                yield lambda owner=owner, name=name: getattr(owner, name)  # type: ignore[misc]
            elif name in ("recordings", "events"):
                yield lambda owner=owner, name=name: list(getattr(owner, name)())  # type: ignore[misc]
            else:
                yield lambda owner=owner, name=name: getattr(owner, name)()  # type: ignore[misc]


def all_names(path: Path) -> list[str]:
    names: list[str] = []
    with h5py.File(path) as file:
        file.visit(names.append)
    return names


REPLACEMENTS: dict[str, Callable[[h5py.File, str], Any]] = {
    "a group": lambda file, name: file.create_group(name),
    "no text": lambda file, name: file.create_dataset(name, data=b"\xff\xfe"),
    "null JSON": lambda file, name: file.create_dataset(name, data="null"),
    "deep JSON": lambda file, name: file.create_dataset(name, data="[" * 100_000),
    "a matrix": lambda file, name: file.create_dataset(name, data=np.zeros((2, 3, 4))),
    "nothing": lambda file, name: file.create_dataset(name, data=h5py.Empty("f8")),
    "a large integer": lambda file, name: file.create_dataset(name, data=2**64 - 1),
    "not a number": lambda file, name: file.create_dataset(name, data=float("nan")),
    "missing": lambda file, name: None,
    "a reference": lambda file, name: file.create_dataset(name, data=file.ref, dtype=h5py.ref_dtype),
}


def read_all(path: Path) -> list[str]:
    """Read every property; return the sentences of those that were refused."""
    refusals: list[str] = []
    try:
        with Run(path) as run:
            for read in everything(run):
                try:
                    read()
                except RunReadError as error:
                    refusals.append(str(error))
    except RunReadError as error:
        refusals.append(str(error))
    return refusals


def replace_each(path: Path, replacement: str, names: list[str]) -> None:
    whole = path.read_bytes()
    for name in names:
        path.write_bytes(whole)
        with h5py.File(path, "r+") as file:
            attributes = dict(file[name].attrs)
            del file[name]
            if REPLACEMENTS[replacement](file, name) is not None:
                file[name].attrs.update(attributes)
        assert all("\n" not in sentence and str(path) in sentence for sentence in read_all(path)), name


@pytest.mark.deep
@pytest.mark.parametrize("replacement", REPLACEMENTS)
def test_whatever_stands_in_a_known_place_every_property_is_read_or_refused(replacement: str, path: Path) -> None:
    replace_each(path, replacement, all_names(path))


KNOWN = ("trace/sample_rate", "points/frequency", "points", "events", "configuration", "estimates")


@pytest.mark.parametrize(("name", "replacement"), list(zip(KNOWN, REPLACEMENTS, strict=False)))
def test_a_wrong_type_in_a_known_place_is_read_or_refused(name: str, replacement: str, path: Path) -> None:
    replace_each(path, replacement, [f"entry/{name}"])


def test_text_of_a_file_gives_no_orders_to_a_terminal(path: Path) -> None:
    with h5py.File(path, "r+") as file:
        for name in ("title", "specimen", "start_time", "reason"):
            replaced(file, f"entry/{name}", data="T\x1b]0;owned\x07\nsecond line\u202e")
        file["entry/points/frequency"].attrs["units"] = "Hz\x1b[2J"
    with Run(path) as run:
        for text in (
            run.record.title,
            run.record.specimen,
            run.record.start_time,
            run.record.reason,
            *run.units().values(),
        ):
            assert text.isprintable()
        assert run.record.title == r"T\x1b]0;owned\x07\nsecond line\u202e"


def test_a_file_found_in_order_is_checked_again_when_it_changes(path: Path) -> None:
    long_ago = path.stat().st_mtime - 3600
    os.utime(path, (long_ago, long_ago))
    open_run.SETTLED_NS, kept = -1, open_run.SETTLED_NS  # the times of a copy are of now
    try:
        with Run(path) as run:
            assert run.record.title
        with h5py.File(path, "r+") as file:
            linked("entry/points", h5py.SoftLink("/entry/trace"))(file)
        os.utime(path, (long_ago, long_ago))
        with pytest.raises(RunReadError):
            Run(path)
    finally:
        open_run.SETTLED_NS = kept
