"""Verification and repair of run files: every damage is found, and a killed program leaves nothing that stays broken."""

import os
import random
import re
import shutil
import socket
from pathlib import Path
from unittest import mock

import h5py
import numpy as np
import pytest

from app.cli.main import main
from app.common import ExitCode
from protocols.base import EstimatedQuantity
from protocols.runfile import transaction
from protocols.runfile.errors import StorageError
from protocols.runfile.names import notes_path
from protocols.runfile.presence import Superblock, writer_is_alive
from protocols.runfile.reader import Run
from protocols.runfile.repair import _mend_last_chunks, needs_repair, repair_folder, repair_run
from protocols.runfile.transaction import journal_path
from protocols.runfile.verify import FileState, verify_run
from protocols.runfile.writer import append_estimates, append_results
from tests.helpers.flipped_bits import flips
from tests.helpers.killed_writers import check, kill_one
from tests.helpers.messages import assert_names
from tests.helpers.run_files import crashed_run, finished_run

OLD_RUNS = Path(__file__).parents[2] / "data" / "format-2" / "runs"


@pytest.fixture(scope="module")
def good(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return finished_run(tmp_path_factory.mktemp("good"))


def chunk_place(path: Path, dataset: str) -> int:
    with h5py.File(path, "r") as file:
        return int(file[dataset].id.get_chunk_info(0).byte_offset)


def flip(path: Path, place: int, bit: int = 4) -> None:
    data = bytearray(path.read_bytes())
    data[place] ^= 1 << bit
    path.write_bytes(data)


def test_a_good_file_is_good_and_its_checksums_follow_what_the_program_appends(good: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(good, tmp_path))
    assert verify_run(path).state is FileState.GOOD
    with append_results(path) as file:
        del file["entry/estimates"]
        append_estimates(file, [EstimatedQuantity("quality factor", 2.4, 0.1, "1", "by hand")])
    assert verify_run(path).state is FileState.GOOD
    assert main(["verify", str(path)]) == ExitCode.DONE


@pytest.mark.parametrize("dataset", ["entry/points/fundamental", "entry/trace/displacement", "entry/events"])
def test_a_flipped_bit_in_points_samples_or_events_is_found_and_is_one_sentence(
    dataset: str, good: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = Path(shutil.copy(good, tmp_path))
    flip(path, chunk_place(path, dataset) + 6)
    (finding,) = verify_run(path).findings
    assert finding.startswith(f"{dataset}: ")
    assert_names(finding, "rows", 0, "checksum")
    assert main(["verify", str(tmp_path)]) == ExitCode.FAILED
    assert f"damaged: {path}\n  {finding}" in capsys.readouterr().out
    commands = {
        "entry/points/fundamental": ["show", str(path)],
        "entry/trace/displacement": ["export", str(path), "--part", "raw", "--out", str(tmp_path)],
        "entry/events": ["export", str(path), "--part", "events", "--out", str(tmp_path)],
    }
    assert main(commands[dataset]) != ExitCode.DONE
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert str(path) in said
    assert_names(said, "damaged")


def test_a_flipped_bit_in_the_free_space_of_names_is_found(good: Path, tmp_path: Path) -> None:
    """HDF5 reads it where another program lists a group, and not where the objects are opened one by one."""
    path = Path(shutil.copy(good, tmp_path))
    flip(path, path.read_bytes().index(b"FSHD") + 10)
    with h5py.File(path, "r") as file, pytest.raises(RuntimeError, match="checksum"):
        file.visit(lambda _: None)
    found = verify_run(path)
    assert found.state is FileState.DAMAGED
    assert "cannot be listed by other programs" in found.findings[0]


def test_a_text_and_an_attribute_changed_by_another_program_are_named(good: Path, tmp_path: Path) -> None:
    path = Path(shutil.copy(good, tmp_path))
    with h5py.File(path, "r+") as file:
        del file["entry/specimen"]
        file["entry/specimen"] = "T8"
        file["entry/points/phase"].attrs["units"] = "deg"
        file["entry/trace/sample_rate"][()] = 5001.0
    found = verify_run(path)
    assert found.state is FileState.DAMAGED
    names = {finding.split()[0] for finding in found.findings}
    assert {"entry/specimen", "entry/points/phase", "entry/trace/sample_rate"} <= names
    with pytest.raises(StorageError, match=rf"{path.name}.*checksums"), append_results(path):
        pass


def test_old_and_unclosed_files_are_not_checkable(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in [*OLD_RUNS.glob("*.h5")][:2]:
        shutil.copy(path, tmp_path)
        assert verify_run(path).state is FileState.NOT_CHECKABLE
    crashed = crashed_run(tmp_path)
    (finding,) = verify_run(crashed).findings
    assert (
        "its program was killed, and it has no checksums of its texts; its samples are as they were written" in finding
    )
    assert "--repair" in finding
    assert main(["verify", str(tmp_path)]) == ExitCode.NO_RESULT
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["x"] = 1
    assert main(["verify", str(tmp_path)]) == ExitCode.NO_RESULT  # a folder may hold other files
    assert main(["verify", str(tmp_path / "other.h5")]) == ExitCode.USAGE
    capsys.readouterr()
    assert main(["verify", str(tmp_path / "none.h5")]) == ExitCode.USAGE


def test_a_crashed_run_is_repaired_once_and_opens_plainly(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = crashed_run(tmp_path)
    with pytest.raises(OSError, match="already open for write"):
        h5py.File(path, "r")
    with Run(path) as run:
        before = (run.record.state, run.trace.sample_count, run.record.point_count, [e.kind for e in run.events()])
    assert main(["verify", str(path), "--repair"]) == ExitCode.DONE
    assert "left by a program that was killed; it is repaired" in capsys.readouterr().err
    with h5py.File(path, "r") as file:
        assert file["entry/trace/drive"].shape == (2000,)
    with Run(path) as run:
        assert (
            run.record.state,
            run.trace.sample_count,
            run.record.point_count,
            [e.kind for e in run.events()],
        ) == before
    assert verify_run(path).state is FileState.GOOD
    assert repair_run(path) == ""
    assert list(repair_folder(tmp_path)) == []


@pytest.mark.deep
def test_the_next_start_repairs_what_a_killed_program_left_and_says_so(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = crashed_run(tmp_path)
    main(["run", "wiring-check", "--speed", "max", "--out", str(tmp_path)])
    assert re.search(rf"{re.escape(str(path))} .*killed", " ".join(capsys.readouterr().err.split()))
    with h5py.File(path, "r") as file:
        assert file["entry/status"][()] == b"running"


def test_a_chunk_that_was_being_overwritten_is_mended_without_loss(tmp_path: Path) -> None:
    """A kill within a write leaves a chunk with its new first part, its old rest, and a checksum that fits neither."""
    path = crashed_run(tmp_path)
    with h5py.File(path, "r", swmr=True) as file:
        before = file["entry/trace/drive"][:]
        place = int(file["entry/trace/drive"].id.get_chunk_info(0).byte_offset)
    data = bytearray(path.read_bytes())
    data[place + 10_000 : place + 10_002] = b"\x7f\x7f"  # rows that were not acknowledged
    path.write_bytes(data)
    assert verify_run(path).state is FileState.NOT_CHECKABLE
    assert_names(repair_run(path), 2000, 1)
    with h5py.File(path, "r") as file:
        assert np.array_equal(file["entry/trace/drive"][:], before)
    assert verify_run(path).state is FileState.GOOD


def test_the_last_two_chunks_of_a_table_are_mended(tmp_path: Path) -> None:
    """A write across the border of two chunks overwrites both."""
    path, rows = tmp_path / "table.h5", np.arange(25.0)
    with h5py.File(path, "w") as file:
        table = file.create_dataset("table", data=rows, maxshape=(None,), chunks=(10,), fletcher32=True)
        places = [int(table.id.get_chunk_info(k).byte_offset) for k in range(3)]
    data = bytearray(path.read_bytes())
    for place in places[1:]:
        data[place + 80] ^= 1  # the checksum after ten values
    path.write_bytes(data)
    with h5py.File(path, "r+") as file:
        _mend_last_chunks(file["table"])
        assert file["table"][:].tolist() == rows.tolist()


def test_a_file_killed_before_the_first_sample_is_repaired(tmp_path: Path) -> None:
    path = crashed_run(tmp_path)
    block = Superblock.read(path)
    assert block is not None
    repair_run(path)
    data = bytearray(path.read_bytes())
    found = Superblock.read(path)
    assert found is not None
    assert found.cleared(found.end - 100).end == found.end  # a file that was cut is not called whole
    assert found.cleared(found.end + 100).end == found.end + 100
    data[:48] = Superblock(3, 1, found.base, found.extension, found.end, found.root).pack()  # not yet in SWMR mode
    path.write_bytes(data)
    for swmr in (True, False):
        with pytest.raises(OSError, match="open"):
            h5py.File(path, "r", swmr=swmr)
    assert needs_repair(path)
    assert list(repair_folder(tmp_path))
    with h5py.File(path, "r") as file:
        assert file["entry/status"][()] == b"running"


def test_a_file_that_a_program_still_writes_is_left_alone(tmp_path: Path) -> None:
    path = crashed_run(tmp_path)
    before = path.read_bytes()
    with mock.patch("protocols.runfile.repair.writer_is_alive", return_value=True):
        with pytest.raises(StorageError, match=r"\bprocess 4200000\b"):
            repair_run(path)
        assert list(repair_folder(tmp_path)) == []
    here = socket.gethostname()
    with (
        mock.patch("protocols.runfile.repair.socket.gethostname", return_value="elsewhere"),
        pytest.raises(StorageError, match=rf"\b{re.escape(here)}\b"),
    ):
        repair_run(path)
    assert path.read_bytes() == before


@pytest.mark.skipif(not Path("/proc/self/fd").exists(), reason="the system does not say which files are open")
def test_a_process_number_in_use_by_another_program_is_not_the_writer(tmp_path: Path) -> None:
    path = tmp_path / "run.h5"
    path.write_bytes(b"")
    assert not writer_is_alive(path, os.getppid())


def test_results_interrupted_by_a_kill_are_stored_by_the_next_start(tmp_path: Path) -> None:
    path = finished_run(tmp_path)
    before = path.read_bytes()

    def die(*_: object) -> None:
        raise KeyboardInterrupt

    with (
        mock.patch("protocols.runfile.transaction._apply", die),
        pytest.raises(KeyboardInterrupt),
        append_results(path) as file,
    ):
        file["entry/more"] = 1.0
    assert path.read_bytes() == before
    journal = journal_path(path).read_bytes()
    assert verify_run(path).state is FileState.NOT_CHECKABLE
    (sentence,) = repair_folder(tmp_path)
    assert "are stored now" in sentence
    with h5py.File(path, "r") as file:
        assert file["entry/more"][()] == 1.0
    assert verify_run(path).state is FileState.GOOD
    assert sorted(tmp_path.iterdir()) == [path, notes_path(path)]
    after = path.read_bytes()
    flipped = bytearray(journal)
    flipped[len(journal) // 2] ^= 1
    for damaged in (journal[:-40], flipped):  # the program died while it wrote the journal; a bit of the disk changed
        journal_path(path).write_bytes(damaged)
        repair_run(path)
        assert path.read_bytes() == after
        assert sorted(tmp_path.iterdir()) == [path, notes_path(path)]


@pytest.mark.one_in(100)
@pytest.mark.parametrize("pages", [1, 2, -1])
def test_a_kill_between_two_pages_of_the_results_is_completed_by_the_next_start(
    pages: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file is then neither the old one nor the new one; the first page alone declares a longer file."""
    path = finished_run(tmp_path)

    def apply_some(file: Path, size: int, body: bytes) -> None:
        every = list(transaction._pages(body))
        some = b"".join(transaction._PAGE.pack(start, len(data)) + data for start, data in every[:pages])
        apply(file, path.stat().st_size if pages > 0 else size, some)
        raise KeyboardInterrupt

    apply = transaction._apply
    with (
        mock.patch("protocols.runfile.transaction._apply", apply_some),
        pytest.raises(KeyboardInterrupt),
        append_results(path) as file,
    ):
        file["entry/more"] = np.ones(5000)
    found = verify_run(path)
    assert (found.state, "--repair" in found.findings[0]) == (FileState.NOT_CHECKABLE, True)
    assert main(["show", str(path)]) in (ExitCode.DONE, ExitCode.USAGE, ExitCode.FAILED)
    assert capsys.readouterr().err.count("\n") <= 1
    (sentence,) = repair_folder(tmp_path)
    assert str(path) in sentence
    assert verify_run(path).state is FileState.GOOD
    assert sorted(tmp_path.iterdir()) == [path, notes_path(path)]
    with h5py.File(path, "r") as after:
        assert after["entry/more"].shape == (5000,)


@pytest.mark.skipif(os.name != "posix", reason="needs locks of files")
def test_a_journal_that_a_program_is_applying_is_left_alone(tmp_path: Path) -> None:
    path = finished_run(tmp_path)

    def look(*_: object) -> None:
        with pytest.raises(StorageError, match="another program is storing results"):
            repair_run(path)
        assert list(repair_folder(tmp_path)) == []
        raise KeyboardInterrupt

    with (
        mock.patch("protocols.runfile.transaction._apply", look),
        pytest.raises(KeyboardInterrupt),
        append_results(path) as file,
    ):
        file["entry/more"] = 1.0
    assert list(repair_folder(tmp_path))


def test_a_journal_of_something_else_is_removed(tmp_path: Path) -> None:
    path = finished_run(tmp_path)
    before = path.read_bytes()
    beyond = transaction._HEADER.pack(transaction._MAGIC, 10, 16) + transaction._PAGE.pack(1 << 60, 0)
    for text in (b"", b"x" * 100, beyond + transaction._digest(beyond)):
        journal_path(path).write_bytes(text)
        assert repair_run(path) == ""
        assert (path.read_bytes(), journal_path(path).exists()) == (before, False)
    os.mkfifo(journal_path(path))
    assert repair_run(path) == ""


@pytest.mark.deep
def test_flipped_bits_are_found_or_in_unused_space(good: Path, tmp_path: Path) -> None:
    seed = random.randrange(10**6)
    missed = [found for found in flips([good], 100, seed, tmp_path) if found[-1] == "missed"]
    assert not missed, f"seed {seed}"


@pytest.mark.deep
@pytest.mark.skipif(os.name != "posix", reason="needs fork and kill")
def test_killed_writers_lose_nothing_and_are_repaired_once(tmp_path: Path) -> None:
    chance = random.Random(seed := random.randrange(10**6))
    for i in range(15):
        (folder := tmp_path / str(i)).mkdir()
        told, _ = kill_one(folder, chance.uniform(0, 1.0))
        assert check(folder, told), f"seed {seed}"
