"""Recording of changed files in the audit trail of their folder, with the operator's name."""

from pathlib import Path

from app.common.audit_chain import audited_folder, record_change
from app.common.people import current_conditions
from protocols.base import file_hash


def record_audit(action: str, *paths: Path, subject: str = "", **details: object) -> None:
    """Append an entry on changed files to the audit trail that covers them, if any. Errors are logged, not raised."""
    if not paths or audited_folder(paths[0]) is None:
        return
    hashes = {}
    for path in paths:
        try:
            hashes[path] = file_hash(path)
        except OSError as error:
            hashes[path] = f"unreadable: {error.strerror or error}"
    record_change(paths[0], action, subject, current_conditions().operator, hashes, **details)
