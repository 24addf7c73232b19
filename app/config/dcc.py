"""Digital calibration certificates (DCC, XML version 3 of the PTB): number, laboratory, dates, item and tables with uncertainties.

Schemas: ptb.de/dcc/v3.3.0/dcc.xsd, and ptb.de/si (D-SI) for the values; elements are found by their names, independent of other
elements.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from app.common import truncate_text
from app.config.certificate import Certificate, CertificateColumn, CertificateError
from drivers import open_regular
from protocols.base import visible_text

MAX_FILE_BYTES = 50_000_000
"""A certificate with attached pictures; more is something else."""
MAX_VALUES = 100_000
DCC = "{https://ptb.de/dcc}"
SI = "{https://ptb.de/si}"
UNCERTAINTY_TAGS = (
    "uncertainty",
    "uncertaintyXMLList",
    "valueExpandedMU",
    "valueExpandedMUXMLList",
    "valueStandardMU",
    "valueStandardMUXMLList",
)
SHORT_UNITS = {
    "milli": "m", "micro": "µ", "nano": "n", "kilo": "k", "metre": "m", "volt": "V", "gram": "g", "newton": "N", "second": "s", "hertz": "Hz", "one": "1",
}  # fmt: skip
"""Prefixes and units of the D-SI."""
COVERAGE_TAGS = ("coverageFactor", "coverageFactorXMLList")


def read_dcc(path: Path) -> Certificate:
    """Read a digital calibration certificate of version 3.

    Raises:
        CertificateError: it cannot be read, is none, or is of another version.
    """
    try:
        with open_regular(path) as file:
            data = file.read(MAX_FILE_BYTES + 1)
    except OSError as error:
        raise CertificateError(f"{path} cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_FILE_BYTES:
        raise CertificateError(f"{path} has more than {MAX_FILE_BYTES / 1e6:g} MB and is no certificate")
    if b"<!DOCTYPE" in data or b"<!ENTITY" in data:  # entities could expand without end; a DCC has none
        raise CertificateError(
            f"{path} has a document type declaration, which no DCC has; give the XML file of the laboratory"
        )
    try:
        root = ElementTree.fromstring(data)  # noqa: S314 - without declarations there are no entities
    except (ElementTree.ParseError, ValueError, RecursionError) as error:
        raise CertificateError(f"{path} is no XML file: {error}; give the DCC of the laboratory") from None
    version = root.get("schemaVersion", "")
    if root.tag != f"{DCC}digitalCalibrationCertificate":
        raise CertificateError(f"{path} is no digital calibration certificate; its root is '{truncate_text(root.tag)}'")
    if not version.startswith("3."):
        raise CertificateError(
            f"{path} is a DCC of version {truncate_text(version) or 'unknown'}; version 3 can be read"
        )
    core, item = f"{DCC}administrativeData/{DCC}coreData/", root.find(f"{DCC}administrativeData/{DCC}items/{DCC}item")
    number = _text(root.find(f"{core}{DCC}uniqueIdentifier"))
    if not number:
        raise CertificateError(f"{path} has no number (uniqueIdentifier)")
    maker = _name(item.find(f"{DCC}manufacturer")) if item is not None else ""
    model = _text(item.find(f"{DCC}model")) if item is not None else ""
    return Certificate(
        number=number,
        laboratory=_name(root.find(f"{DCC}administrativeData/{DCC}calibrationLaboratory/{DCC}contact")),
        date=_text(root.find(f"{core}{DCC}endPerformanceDate"))[:10],
        item=" ".join(filter(None, (maker, model))) or (_name(item) if item is not None else ""),
        serial=_serial(item),
        columns=tuple(_columns(root, path)),
    )


def _text(element: ElementTree.Element | None) -> str:
    return visible_text(" ".join((element.text or "").split())) if element is not None else ""


def _name(element: ElementTree.Element | None) -> str:
    """Return the name of an element: its English content, or the first one."""
    if element is None:
        return ""
    contents = element.findall(f"{DCC}name/{DCC}content")
    chosen = next((each for each in contents if each.get("lang") == "en"), contents[0] if contents else None)
    return _text(chosen)


def _serial(item: ElementTree.Element | None) -> str:
    """Return the manufacturer's identification of the item: its serial number."""
    if item is None:
        return ""
    identifications = item.findall(f"{DCC}identifications/{DCC}identification")
    chosen = [each for each in identifications if _text(each.find(f"{DCC}issuer")) == "manufacturer"] or identifications
    named = [
        each for each in chosen if "serial" in _name(each).casefold() or each.get("refType") == "basic_serialNumber"
    ]
    return _text((named or chosen)[0].find(f"{DCC}value")) if chosen else ""


def _columns(root: ElementTree.Element, path: Path) -> Iterator[CertificateColumn]:
    """Yield the quantities of all results, each with its values and standard uncertainties."""
    for result in root.iterfind(f"{DCC}measurementResults/{DCC}measurementResult/{DCC}results/{DCC}result"):
        for quantity in _quantities(result):
            if (values := _values(quantity)) is not None:
                try:
                    yield _column(_name(quantity) or _name(result), values)
                except ValueError as error:
                    raise CertificateError(
                        f"{path}: '{_name(quantity)}' of '{_name(result)}' is damaged: {error}"
                    ) from None


def _quantities(result: ElementTree.Element) -> Iterator[ElementTree.Element]:
    """Yield the quantities of a result and of its lists, without the quantities in their metadata."""
    for data in result.iterfind(f"{DCC}data"):
        pending = list(data)
        while pending:
            element = pending.pop(0)
            if element.tag == f"{DCC}quantity":
                yield element
            elif element.tag == f"{DCC}list":
                pending[:0] = list(element)


def _values(quantity: ElementTree.Element) -> ElementTree.Element | None:
    """Return the element with the values; the first unit of several."""
    for element in quantity:
        if element.tag in (f"{SI}real", f"{SI}realListXMLList", f"{SI}constant"):
            return element
        if element.tag == f"{SI}hybrid" and len(element):
            return element[0]
    return None


def _column(name: str, element: ElementTree.Element) -> CertificateColumn:
    """Return the column of an element with values.

    Raises:
        ValueError: a value is no number, or numbers and uncertainties are not equally many.
    """
    values = _numbers(element, ("value", "valueXMLList"), direct=True)
    units = [_text(each) for each in element if each.tag in (f"{SI}unit", f"{SI}unitXMLList")]
    errors = _numbers(element, UNCERTAINTY_TAGS)
    factors = _numbers(element, COVERAGE_TAGS) or [1.0]
    if not values:
        raise ValueError("it has no values")
    errors, factors = (each * len(values) if len(each) == 1 else each for each in (errors, factors))
    if errors and not len(errors) == len(factors) == len(values):
        raise ValueError(f"{len(values)} values have {len(errors)} uncertainties and {len(factors)} coverage factors")
    if any(factor <= 0 for factor in factors):
        raise ValueError("a coverage factor is not positive")
    standard = tuple(error / factor for error, factor in zip(errors, factors, strict=True)) if errors else ()
    unit = _short_unit(units[0].split()[0]) if units and units[0] else "1"
    return CertificateColumn(name, unit, tuple(values), standard)


def _numbers(element: ElementTree.Element, tags: tuple[str, ...], direct: bool = False) -> list[float]:
    names = {f"{SI}{tag}" for tag in tags}
    values = next((each for each in (element if direct else element.iter()) if each.tag in names), None)
    texts = (values.text or "").split() if values is not None else []
    if len(texts) > MAX_VALUES:
        raise ValueError(f"it has more than {MAX_VALUES} values")
    numbers = [float(text) for text in texts]
    if not all(map(math.isfinite, numbers)):
        raise ValueError("a value is not finite")
    return numbers


def _short_unit(unit: str) -> str:
    """Return a unit of the D-SI in short where it is a prefix and a name, `mm` for milli and metre; else its words."""
    words = unit.replace("\\", " ").split()
    symbols = [SHORT_UNITS.get(word, "") for word in words]
    return "".join(symbols) if symbols and all(symbols) and "per" not in words else " ".join(words)
