"""Mountings of an identification as tables: how repeatable they are, and the difference of each from the last one."""

from collections.abc import Iterator

from app.common import Column, Table, pluralize
from app.identification.specimen_identification import IdentificationResult
from model import format_time
from model.identification import (
    MOUNTING_EFFECTS,
    MountingRepeatability,
    format_size,
    mounting_differences,
    mounting_repeatabilities,
    unrecorded_parts,
)

UNKNOWN_TIME = "at an unknown time"


def mounting_tables(identification: IdentificationResult) -> Iterator[Table]:
    """Yield how repeatable mountings are, and every mounting; none where each part was mounted once."""
    fit = identification.joint_fit
    if fit is None or not (found := mounting_repeatabilities(fit)):
        return
    units = [MOUNTING_EFFECTS[each.part].unit for each in found]
    yield Table(
        "mountings",
        "How repeatable mountings are: standard deviation from one to the next",
        (
            Column("part", "", [each.part for each in found]),
            Column("count", "", [each.count for each in found], "mountings"),
            Column("found_text", "", [format_size(r.found, r.found_error, u) for r, u in zip(found, units, strict=True)], "found"),
            Column("expected_text", "", [format_size(r.expected, None, u) for r, u in zip(found, units, strict=True)], "expected"),
            Column("words", "", [_meaning(identification, each) for each in found], "meaning"),
            Column("found", "", [each.found for each in found], displayed=False),
            Column("found_error", "", [each.found_error for each in found], displayed=False),
            Column("expected", "", [each.expected for each in found], displayed=False),
            Column("probability", "", [each.probability for each in found], displayed=False),
            Column("unit", "", units, displayed=False),
        ),
    )  # fmt: skip
    every = mounting_differences(fit)
    units = [MOUNTING_EFFECTS[each.part].unit for each in every]
    yield Table(
        "mounting_differences",
        "Mountings, and the difference of each from the last one, to which the parameters refer",
        (
            Column("part", "", [each.part for each in every]),
            Column("time", "", [format_time(each.time, seconds=True) or UNKNOWN_TIME for each in every], "mounted (UTC)"),
            Column("runs", "", [pluralize(len(each.runs), "curve") for each in every], "seen by"),
            Column("difference", "", [format_size(e.value, e.standard_error, u) if e.standard_error else "" for e, u in zip(every, units, strict=True)]),
            Column("labels", "", [", ".join(each.runs) for each in every], displayed=False),
            Column("value", "", [each.value for each in every], displayed=False),
            Column("standard_error", "", [each.standard_error for each in every], displayed=False),
            Column("unit", "", units, displayed=False),
        ),
    )  # fmt: skip


def mounting_line(identification: IdentificationResult) -> str:
    """Return the parts whose mountings no run states and that count as mounted once, as text; empty without any."""
    fit = identification.joint_fit
    parts = () if fit is None else tuple(unrecorded_parts(fit.observations))
    return f"no mounting is recorded of {', '.join(parts)}: taken as mounted once for all runs." if parts else ""


def _meaning(identification: IdentificationResult, repeatability: MountingRepeatability) -> str:
    stated = identification.sheet is not None and repeatability.part in identification.sheet.mountings
    source = "expected by the sheet" if stated else "expected value assumed"
    if repeatability.is_contradicted:
        return f"differ more than expected; {source}"
    return source if repeatability.found else f"no difference seen; {source}"
