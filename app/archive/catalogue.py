"""SQLite index (catalogue) of the run files in a folder; a cache that is rebuilt from the files.

The index is in the user's cache directory, not in the folder of the runs: a folder of runs may be read-only, or on a network drive
where SQLite locking is unreliable. Tags and notes are in a small file next to each run, see `protocols.runfile.sidecar`.
"""

import hashlib
import marshal
import os
import sqlite3
import time
from collections.abc import Collection, Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple

from app.archive.run_summary import RunState, RunSummary
from app.common import NO_PROGRESS, Progress, own_cache_folder
from drivers import Deadline
from protocols import BUILT_IN_PROTOCOLS
from protocols.runfile import NOTES_SUFFIX

SCHEMA = 10 * 14 + marshal.version
"""Raise its tens when `RunSummary` changes: an index of another schema is thrown away."""

SHORT_SCAN_FILES = 20
"""A scan of so few files ends before a text could be read."""

PAGE_BYTES, MAPPED_BYTES = 65_536, 200_000_000
"""Largest pages of SQLite and a mapped file: a list of ten thousand runs takes two thirds of the time."""

STAMP_COLUMNS = ("path", "state", "modified_ns", "size", "notes_ns")
"""Columns compared by a scan. The whole summary is one further column: thirty columns take SQLite twice as long."""

UNSETTLED, SETTLED_NS = -1, 2_000_000_000
"""Two changes within this time may give a folder the same modification time: some file systems store even seconds."""

FILES_PER_COMMIT = 100
"""Files read between two commits; other connections see the entries after a commit."""


@dataclass(frozen=True, slots=True)
class ScanResult:
    """Result of a scan: number of changed entries, and unreadable files."""

    added: int = 0
    changed: int = 0
    removed: int = 0
    skipped: tuple[str, ...] = ()
    """A message for each folder that could not be read. Unreadable files are entries with the state `damaged`."""
    complete: bool = True
    """False if the scan was cancelled."""

    @property
    def has_changes(self) -> bool:
        return bool(self.added or self.changed or self.removed)


class _FileStamp(NamedTuple):
    """Times and size by which a changed file is detected."""

    modified_ns: int
    size: int
    notes_ns: int


@dataclass
class _FolderListing:
    """Run files and notes in a folder and below."""

    runs: dict[str, os.stat_result] = field(default_factory=dict)
    notes: dict[str, int] = field(default_factory=dict)
    skipped: list[str] = field(default_factory=list)
    folder_times: dict[str, int] = field(default_factory=dict)
    """Modification time of each folder, taken before it was listed; `UNSETTLED` where a later change may have the same one."""

    def notes_path_of(self, run: str) -> str:
        """Return the notes of a run: next to it, or at its former place if the run file was moved alone."""
        beside = run.removesuffix(".h5") + NOTES_SUFFIX
        if beside in self.notes:
            return beside
        name = beside.rpartition("/")[2]
        for other in self.notes:
            if other.rpartition("/")[2] == name and other.removesuffix(NOTES_SUFFIX) + ".h5" not in self.runs:
                return other
        return ""


class Catalogue:
    """The runs in `folder` and below. Methods may be called from any thread; `scan` and `annotate` write.

    Args:
        index: the SQLite file; default is one in the user's cache, named by the folder.
    """

    def __init__(self, folder: Path, index: Path | None = None) -> None:
        self.folder = folder
        self.index = index or index_path(folder)
        self._folder_times: dict[str, int] = {}

    def entries(self) -> list[RunSummary]:
        """Return every indexed run, newest first."""
        return sorted(self._summaries(), key=attrgetter("start_time", "path"), reverse=True)

    def figure_entries(self) -> list[RunSummary]:
        """Return the indexed runs that have figures, and all of laboratories' protocols, oldest first."""
        entries = (e for e in self._summaries() if e.figures_json != "[]" or e.protocol not in BUILT_IN_PROTOCOLS)
        return sorted(entries, key=attrgetter("start_time", "path"))

    def _summaries(self) -> list[RunSummary]:
        try:
            return self._read_summaries()
        except (EOFError, TypeError, ValueError):  # a damaged row: the index is rebuilt from the files
            self.index.unlink(missing_ok=True)
            self.scan()
            return self._read_summaries()

    def _read_summaries(self) -> list[RunSummary]:
        with self._connection() as db:
            rows = db.execute("SELECT summary FROM runs").fetchall()
        return [RunSummary._make(marshal.loads(row)) for (row,) in rows]  # noqa: S302 - only this user writes the index

    def scan(self, progress: Progress = NO_PROGRESS, exclude: Collection[Path] = ()) -> ScanResult:
        """Update the index: read added, changed or moved files, remove deleted ones.

        Args:
            progress: the scan ends between two files if it is cancelled; only a long scan reports with a text.
            exclude: files that this program is writing; they are listed but not opened.
        """
        left = {str(path.resolve()) for path in exclude}
        walk = _list_folder(self.folder)
        self._folder_times = walk.folder_times
        added = changed = 0
        with self._connection() as db:
            indexed = {
                path: (_FileStamp(*seen), state)
                for path, state, *seen in db.execute(f"SELECT {', '.join(STAMP_COLUMNS)} FROM runs")  # noqa: S608
            }
            gone = indexed.keys() - walk.runs.keys()
            read: dict[str, RunSummary | None] = dict.fromkeys(gone)
            _store(db, read)
            due = []
            for path, stat in walk.runs.items():
                notes = walk.notes_path_of(path)
                seen = _FileStamp(stat.st_mtime_ns, stat.st_size, walk.notes.get(notes, 0))
                # A file marked `running` does not change when its writer is killed.
                if path not in indexed or indexed[path][0] != seen or indexed[path][1] == RunState.RUNNING:
                    due.append((path, notes, seen))
            # Newest first, as users look for recent runs: file names begin with the start time.
            due.sort(key=lambda item: item[0].rpartition("/")[2], reverse=True)
            complete = True
            for done, (path, notes, seen) in enumerate(due, 1):
                if progress.cancelled:
                    complete = False
                    break
                read[path] = entry = self._read(path, notes, seen, left)
                if entry is not None:
                    added += path not in indexed
                    changed += path in indexed and indexed[path] != (seen, entry.state)
                text = f"reading {done} of {len(due)}" if len(due) > SHORT_SCAN_FILES else ""
                progress.update(done / len(due), text)
                if done % FILES_PER_COMMIT == 0:
                    _store(db, read)
            _store(db, read)
        return ScanResult(added, changed, len(gone), tuple(walk.skipped), complete)

    def has_changed_folder(self) -> bool:
        """Whether files were added, moved or deleted since the last scan, by the modification times of the folders."""
        times = self._folder_times
        return any(_modified_ns(self.folder / inside) != seen for inside, seen in times.items())

    def upsert(self, entries: Sequence[RunSummary]) -> None:
        """Insert or replace entries unchecked; the next scan corrects entries that do not match the files."""
        with self._connection() as db:
            _upsert(db, entries)

    def _read(self, path: str, notes: str, stamp: _FileStamp, excluded: Collection[str]) -> RunSummary | None:
        # Slow to load, and not needed for a list of known runs.
        from app.archive.run_reading import read_run_summary, summary_from_file_name

        file = self.folder / path
        if excluded and str(file.resolve()) in excluded:
            entry: RunSummary | None = summary_from_file_name(path, RunState.RUNNING, "being written by this program")
        else:
            entry = read_run_summary(file, path, self.folder / notes if notes else None)
        return entry and entry._replace(**stamp._asdict())

    @contextmanager
    def _connection(self) -> Iterator[sqlite3.Connection]:
        """Open the index.

        Raises:
            OSError: it cannot be read or written; a damaged one is removed, and made anew by the next scan.
        """
        try:
            with closing(self._open()) as db, db:
                yield db
        except sqlite3.Error as error:
            if isinstance(error, sqlite3.DatabaseError) and not isinstance(error, sqlite3.OperationalError):
                self._remove()
            raise OSError(f"the index of the runs cannot be used: {error}; try again ({self.index})") from error

    def _open(self) -> sqlite3.Connection:
        self.index.parent.mkdir(parents=True, exist_ok=True)
        for _ in range(2):
            db = sqlite3.connect(self.index, timeout=Deadline.RUN_INDEX.seconds)
            try:
                if self._ensure_schema(db):
                    db.execute(f"PRAGMA mmap_size = {MAPPED_BYTES}")
                    return db
            except sqlite3.OperationalError:
                db.close()
                raise
            except sqlite3.DatabaseError:  # not a database, or damaged: it is rebuilt from the files
                pass
            db.close()
            self._remove()
        raise sqlite3.DatabaseError(f"the index {self.index} cannot be made")

    def _remove(self) -> None:
        for suffix in ("", "-wal", "-shm"):
            self.index.with_name(self.index.name + suffix).unlink(missing_ok=True)

    @staticmethod
    def _ensure_schema(db: sqlite3.Connection) -> bool:
        """Return whether the index has the current schema; create the table in an empty one."""
        (version,) = db.execute("PRAGMA user_version").fetchone()
        if version == SCHEMA:
            return True
        if version != 0 or db.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
            return False
        db.execute(f"PRAGMA page_size = {PAGE_BYTES}")
        db.execute("PRAGMA journal_mode = WAL")
        db.execute(f"CREATE TABLE runs (path PRIMARY KEY, {', '.join(STAMP_COLUMNS[1:])}, summary) WITHOUT ROWID")
        db.execute(f"PRAGMA user_version = {SCHEMA}")
        db.commit()
        return True


def index_path(folder: Path) -> Path:
    """Return the index path of a folder, in the user's cache."""
    return own_cache_folder() / f"runs-{hashlib.sha256(os.fsencode(folder.resolve())).hexdigest()[:16]}.sqlite"


def _store(db: sqlite3.Connection, read: dict[str, RunSummary | None]) -> None:
    """Write the entries that were read, and remove the paths without one; no file is read while others wait for the lock."""
    db.executemany("DELETE FROM runs WHERE path = ?", [(path,) for path, entry in read.items() if entry is None])
    _upsert(db, [entry for entry in read.values() if entry is not None])
    db.commit()
    read.clear()


def _upsert(db: sqlite3.Connection, entries: Sequence[RunSummary]) -> None:
    stamps = attrgetter(*STAMP_COLUMNS)
    rows = ((*stamps(each), marshal.dumps(tuple(map(_plain, each)))) for each in entries)
    db.executemany("INSERT OR REPLACE INTO runs VALUES (?, ?, ?, ?, ?, ?)", rows)


def _plain(value: str | float | None) -> str | float | None:
    """Return a value of a built-in type: of an enumeration its text, of NumPy its number."""
    if value is None or type(value) in (str, int, float):
        return value
    return str(value) if isinstance(value, str) else int(value) if isinstance(value, int) else float(value)


def _list_file(walk: _FolderListing, folder: Path, path: str, item: os.DirEntry[str]) -> None:
    """Add a run file or notes to the listing; an inaccessible one does not hide the others."""
    try:
        path.encode()
        stat = item.stat()
    except UnicodeEncodeError:
        walk.skipped.append(f"{folder / path} has a name that is not UTF-8 text; rename it")
    except FileNotFoundError:  # deleted meanwhile, or a link that leads nowhere
        pass
    except OSError as error:
        walk.skipped.append(f"{folder / path} cannot be read: {error.strerror or error}")
    else:
        if item.name.endswith(".h5"):
            walk.runs[path] = stat
        else:
            walk.notes[path] = stat.st_mtime_ns


def _modified_ns(folder: Path) -> int:
    try:
        return folder.stat().st_mtime_ns
    except OSError:
        return 0


def _list_folder(folder: Path) -> _FolderListing:
    """List run files and notes in a folder and below by relative path; hidden folders are skipped."""
    walk = _FolderListing()
    pending = [""]
    while pending:
        inside = pending.pop()
        modified_ns = _modified_ns(folder / inside)
        walk.folder_times[inside] = UNSETTLED if time.time_ns() - modified_ns < SETTLED_NS else modified_ns
        try:
            with os.scandir(folder / inside) as items:
                for item in items:
                    if item.name.startswith("."):
                        continue
                    path = f"{inside}{item.name}"
                    if item.is_dir(follow_symlinks=False):
                        pending.append(f"{path}/")
                    elif item.name.endswith((".h5", NOTES_SUFFIX)):
                        _list_file(walk, folder, path, item)
        except FileNotFoundError:
            if inside:  # deleted during the scan; the root folder itself may not exist yet
                continue
        except OSError as error:
            walk.skipped.append(f"{folder / inside} cannot be read: {error.strerror or error}")
    return walk
