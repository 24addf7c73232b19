"""The command `audit`: start, verify and print the audit trail of a folder of runs."""

from dataclasses import asdict
from pathlib import Path

from app.archive import begin_audit, verify_audit
from app.cli.options import JSON_OBJECT, CommandGroup, argument, command, option, options
from app.cli.output import print_answer
from app.cli.runs import check_folder
from app.common import AuditEntry, AuditError, ExitCode, read_entries, terminal_progress, usage_errors
from model import format_time
from protocols.base import visible_text

SHOWN_LINES = 40


@options
class _AuditOptions:
    folder: Path = argument("folder of the runs (default: runs)", Path("runs"), nargs="?")
    json: bool = JSON_OBJECT


@command("runs")
class StartAuditCommand(_AuditOptions):
    """Begin the trail, with the hashes of all files in the folder."""

    @usage_errors(AuditError)
    def execute(self) -> int:
        check_folder(self.folder)
        with terminal_progress("hashing files", self.json) as progress:
            entry = begin_audit(self.folder, progress)
        text = f"The audit trail of {self.folder} begins with {len(entry.files)} files. Head: {entry.hash}"
        return print_answer({"head": entry.hash, "files": len(entry.files)}, [text], self.json)


@command("runs --head 3f1c0a77b2d4")
class VerifyAuditCommand(_AuditOptions):
    """Verify all lines and files; exit code 1 if something was changed."""

    head: str = option("head hash that was printed or copied elsewhere", metavar="HASH")

    @usage_errors(AuditError)
    def execute(self) -> int:
        with terminal_progress("hashing files", self.json) as progress:
            result = verify_audit(self.folder, self.head, progress)
        state = f"{len(result.problems)} problems" if result.problems else "unchanged"
        up_to = "" if self.head else "; changes that rewrite the whole trail show only against a --head kept elsewhere"
        lines = [
            *(visible_text(f"✕ {problem}") for problem in result.problems),
            *(visible_text(f"? {name} is not in the audit trail") for name in result.unrecorded),
            f"{len(result.entries)} entries: {state}{up_to}. Head: {result.head}",
        ]
        record = {**asdict(result), "entries": len(result.entries), "head": result.head}
        print_answer(record, lines, self.json)
        return ExitCode.FAILED if result.problems else ExitCode.DONE


@command("runs --subject T7")
class ShowAuditCommand(_AuditOptions):
    """Print the entries of the trail."""

    subject: str = option("entries with this text in subject or files", metavar="TEXT")
    action: str = option("run, calibration, campaign, notes, delete ...", metavar="WORD")
    all: bool = option(f"all of them, not only the newest {SHOWN_LINES}")

    @usage_errors(AuditError)
    def execute(self) -> int:
        entries, problems = read_entries(self.folder)
        entries = [
            entry
            for entry in entries
            if (not self.action or entry.action == self.action)
            and (not self.subject or any(self.subject in text for text in (entry.subject, *entry.files)))
        ]
        lines = [_line(entry) for entry in (entries if self.all else entries[-SHOWN_LINES:])]
        lines += [f"✕ {problem}" for problem in problems]
        print_answer(
            {"entries": [asdict(each) for each in entries], "problems": problems}, map(visible_text, lines), self.json
        )
        return ExitCode.FAILED if problems else ExitCode.DONE


def _line(entry: AuditEntry) -> str:
    details = ", ".join(f"{name} {value}" for name, value in entry.details.items() if value not in ("", [], None))
    return f"{entry.number:5} {format_time(entry.time, seconds=True)}  {entry.by}: {entry.action} {entry.subject}{f' ({details})' if details else ''}  {entry.hash[:12]}"


@command("runs")
class HeadAuditCommand(_AuditOptions):
    """Print the hash of the last entry."""

    @usage_errors(AuditError)
    def execute(self) -> int:
        entries, _ = read_entries(self.folder)
        last = entries[-1] if entries else None
        head = {"head": last.hash if last else "", "entries": len(entries), "time": last.time if last else ""}
        return print_answer(head, [str(head["head"])], self.json)


VERBS = CommandGroup(
    "Audit trail: once begun in a folder, every run, acceptance, rejection, note, check, edit and deletion appends a line to audit.jsonl with who, when, why "
    "and the hashes of the files; each line has the hash of the one before it. A hash that is kept elsewhere, such as on a report, proves "
    "everything up to it.",
    "example: tactor-bench audit verify runs --head 3f1c0a77b2d4",
    {"start": StartAuditCommand, "verify": VerifyAuditCommand, "show": ShowAuditCommand, "head": HeadAuditCommand},
)
