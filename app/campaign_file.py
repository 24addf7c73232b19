"""The file a campaign is kept in: one JSON file beside the runs, replaced whole, named for the specimen."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from app.whole_file import write_whole
from protocols.names import safe_name

SUFFIX = ".campaign.json"
VERSION = 1


class CampaignError(Exception):
    """A campaign cannot be opened, changed or kept. The sentence says which, why and what to do."""


def campaign_path(folder: Path, specimen: str) -> Path:
    """Where a specimen's campaign stands: beside its runs."""
    return folder / f"{safe_name(specimen)}{SUFFIX}"


def campaigns_in(folder: Path) -> list[Path]:
    """The campaigns of a folder, the one changed last first."""
    try:
        found = [(path.stat().st_mtime_ns, path) for path in folder.glob(f"*{SUFFIX}")]
    except OSError:
        return []
    return [path for _, path in sorted(found, reverse=True)]


def read_record(path: Path) -> dict[str, Any]:
    """What a campaign's file says.

    Raises:
        CampaignError: it is none, or of a newer version.
        OSError, ValueError, KeyError, TypeError: it cannot be read or understood.
    """
    record = json.loads(path.read_text("utf-8"))
    if record["kind"] != "campaign" or record["version"] > VERSION:
        raise CampaignError(f"{path} is of a newer version of this program; install that")
    return dict(record)


def write_record(path: Path, record: Mapping[str, Any]) -> None:
    """Replace a campaign's file.

    Raises:
        CampaignError: it cannot be written.
    """
    whole = {"kind": "campaign", "version": VERSION, **record}
    text = json.dumps(whole, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_whole(path, text)
    except OSError as error:
        raise CampaignError(f"the campaign {path} cannot be written: {error.strerror}") from None
