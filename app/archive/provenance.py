"""People, instruments, certificates and specimen of an archive as entities of its RO-Crate (schema.org types)."""

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Any

from app.archive.run_summary import RunSummary
from app.config import CERTIFICATES, Certificate, read_certificates
from app.identification import SheetError, load_sheet
from protocols.runfile import safe_name

SPECIMEN_ID = "#specimen"
Entity = dict[str, Any]


@dataclass(frozen=True, slots=True)
class Provenance:
    """References to people and measurements, and all entities that they need."""

    authors: list[Entity]
    checkers: list[Entity]
    measurements: list[Entity]
    entities: tuple[Entity, ...]


def certificate_files(folder: Path) -> list[Path]:
    """Return the certificates beside the runs, with their attached files."""
    return sorted(path for path in (folder / CERTIFICATES).glob("*") if path.is_file())


def photograph_files(folder: Path, specimen: str) -> list[Path]:
    """Return the photograph that the sheet of a specimen names, beside it."""
    with suppress(SheetError):
        name = load_sheet(folder, specimen).photograph
        return [path] if name and (path := folder / Path(name).name).is_file() else []
    return []


def people_of(names: Iterable[str]) -> list[Entity]:
    """Return references to people."""
    return [{"@id": f"#person-{safe_name(name)}"} for name in dict.fromkeys(names) if name]


def provenance_of(specimen: str, runs: Sequence[RunSummary], folder: Path) -> Provenance:
    """Return who measured and checked the runs, with which instruments and certificates; and the specimen with its sheet."""
    operators = sorted({run.operator for run in runs if run.operator})
    checkers = sorted({name for run in runs for name in run.checked_by.split(", ") if name})
    certificates, _ = read_certificates(folder)
    entities: dict[str, Entity] = {}
    for name in (*operators, *checkers):
        given, _, family = name.rpartition(" ")
        (reference,) = people_of([name])
        entities[reference["@id"]] = reference | {
            "@type": "Person", "name": name, "givenName": given or name, "familyName": family if given else "",
        }  # fmt: skip
    measurements = []
    for run in runs:
        used = [_instrument(role, identity, certificates) for role, identity in _identities(run)]
        entities |= {each["@id"]: each for each in used}
        stem = PurePosixPath(run.path).stem
        action = {"@id": f"#measurement-{stem}"}
        measurements.append(action)
        entities[action["@id"]] = action | {
            "@type": "CreateAction", "name": f"{run.protocol} of {specimen}", "startTime": run.start_time,
            "agent": people_of([run.operator]), "instrument": [{"@id": each["@id"]} for each in used],
            "object": {"@id": SPECIMEN_ID}, "result": {"@id": f"./{stem}/"},
        }  # fmt: skip
    for each in _specimen_entities(specimen, folder):
        entities[each["@id"]] = each
    return Provenance(people_of(operators), people_of(checkers), measurements, tuple(entities.values()))


def _identities(run: RunSummary) -> Iterator[tuple[str, str]]:
    yield from ((role, str(text)) for role, text in run.record.identities.items() if role != "sensor")
    if run.sensor:
        yield "sensor", run.sensor


def _instrument(role: str, identity: str, certificates: Sequence[Certificate]) -> Entity:
    """Return an instrument with its serial number, and the certificates of this number."""
    name, _, serial = identity.rpartition("#") if "#" in identity else (identity, "", "")
    own = [c for c in certificates if serial and c.serial.casefold() == serial.strip().casefold()]
    files = [f"./{CERTIFICATES}/{safe_name(c.number)}.certificate.json" for c in own]
    return {
        "@id": f"#instrument-{safe_name(f'{role} {identity}')}",
        "@type": "IndividualProduct",
        "name": name.strip(),
        "description": role,
        **({"serialNumber": serial.strip()} if serial else {}),
        **({"subjectOf": [{"@id": file} for file in files]} if files else {}),
    }


def _specimen_entities(specimen: str, folder: Path) -> Iterator[Entity]:
    """Yield the specimen and the values of its sheet; a sheet that cannot be read is in the archive as a file."""
    values: list[Entity] = []
    serial = ""
    with suppress(SheetError):
        sheet = load_sheet(folder, specimen)
        serial = sheet.serial
        values = [
            {
                "@id": f"{SPECIMEN_ID}-{e.name}", "@type": "PropertyValue", "name": e.name, "value": e.value,
                "description": f"standard uncertainty {e.uncertainty:g}{f', {e.instrument}' if e.instrument else ''}",
            }
            for e in sheet.entries.values()
        ]  # fmt: skip
    yield {
        "@id": SPECIMEN_ID,
        "@type": "IndividualProduct",
        "name": specimen,
        **({"serialNumber": serial} if serial else {}),
        "additionalProperty": [{"@id": each["@id"]} for each in values],
    }
    yield from values
