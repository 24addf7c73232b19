"""Earlier runs of a specimen: expected values of a protocol, and figures of the newest run that has them."""

from dataclasses import replace
from pathlib import Path

from protocols.base import EstimatedQuantity, Protocol
from protocols.rehearsal import AdaptedProtocol
from protocols.runfile import safe_name

LOOKED_AT = 20
"""Number of the newest runs that are read."""


def with_history(adapted: AdaptedProtocol, folder: Path, specimen: str, simulated: bool) -> AdaptedProtocol:
    """Return the protocol with expected values from an earlier run; unchanged if it needs none, or there is no such run."""
    protocol = adapted.protocol
    if type(protocol).with_history is Protocol.with_history:
        return adapted
    from protocols.runfile import Run, RunReadError  # only where runs are read: a run would begin later

    earlier = sorted(folder.glob(f"*_{safe_name(specimen)}_{protocol.name}*.h5"), reverse=True)
    for path in earlier[:LOOKED_AT]:
        try:
            with Run(path) as run:
                record = run.record
                if (record.protocol, record.specimen, record.simulated) != (protocol.name, specimen, simulated):
                    continue
                if not record.verdict.outcome.has_result:
                    continue
                compared = protocol.with_history(run.points())
        except RunReadError:
            continue
        before, after = (each.model_dump(mode="json") for each in (protocol, compared))
        if not (changed := {name: value for name, value in before.items() if after[name] != value}):
            return adapted
        message = f"{protocol.title}: the specimen is compared with {path.name}"
        return replace(
            adapted,
            protocol=compared,
            requested={**changed, **adapted.requested},
            message="; ".join(filter(None, (adapted.message, message))),
        )
    return adapted


def newest_estimates(folder: Path, specimen: str, *names: str) -> tuple[EstimatedQuantity, ...]:
    """Return estimates by name from the newest run of a specimen that has them all, in the order of the names; empty without one.

    An estimate that a run has at several drives and frequencies counts at the last one.
    """
    from protocols.runfile import Run, RunReadError

    for path in sorted(folder.glob(f"*_{safe_name(specimen)}_*.h5"), reverse=True):
        try:
            with Run(path) as run:
                record = run.record
        except RunReadError:
            continue
        found = {each.name.partition(",")[0]: each for each in record.estimates}
        if record.specimen == specimen and record.verdict.outcome.has_result and set(names) <= set(found):
            return tuple(found[name] for name in names)
    return ()
