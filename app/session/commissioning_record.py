"""Commissioning records: measurements of a source, by make, model, serial number and firmware."""

import hashlib
import json
import math
import re
from dataclasses import asdict, dataclass, fields
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from platformdirs import user_data_path

from app.config import BenchConfig
from drivers import OTHER_BYTE_ORDER, Identity, open_regular
from drivers.evidence import OutputCheck, assumptions_about, assumptions_about_card
from drivers.watchdog import version
from protocols.base import write_atomic
from protocols.commissioning import CheckedOutput, MeasuredTimes, OutputVerdict, checked_assumptions, worst_verdict

if TYPE_CHECKING:
    from protocols.commissioning import Commissioned

FORMAT = 1
MAX_BYTES = 1_000_000

CARD_MAKER = "NI"
"""Maker in the identity of a card, as the source of a bench."""


def records_folder() -> Path:
    """Return the folder of the records of this user."""
    return user_data_path("tactor-bench", appauthor=False) / "commissioning"


def record_path(identity: Identity, simulated_bench: str = "") -> Path:
    """Return the record of an instrument with its present firmware; records of a simulated bench are kept apart."""
    instrument = "-".join(_file_name(part) for part in (identity.maker, identity.model, identity.serial) if part)
    folder = records_folder() / "simulated" / simulated_bench if simulated_bench else records_folder()
    return folder / instrument / f"{_file_name(identity.firmware) or 'unknown'}.json"


def simulated_bench_key(config: BenchConfig) -> str:
    """Return the identification of simulated instruments, by their parameters and the seed of their traits; empty for real ones."""
    if not config.simulated:
        return ""
    given = config.simulation or {}
    instruments = {name: given.get(name) for name in ("generator", "supply", "card", "seed", "source", "interlock")}
    text = json.dumps([instruments, config.source.model_dump(mode="json")], sort_keys=True, default=str)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _file_name(text: str) -> str:
    return re.sub(r"[^A-Za-z0-9.]+", "_", text).strip("._")


@dataclass(frozen=True, slots=True)
class CommissioningRecord:
    """A stored commissioning.

    Attributes:
        verdict: the worst of its checks.
        date: when it was made, ISO 8601.
        failed: the checks that did not pass, as sentences.
        times: measured times.
        simulated: whether the instrument was a simulated one.
        path: of its file.
        byte_order: order of the waveforms in which the source was commissioned; empty if it has only one.
    """

    verdict: OutputVerdict
    date: str
    failed: tuple[str, ...]
    times: MeasuredTimes
    simulated: bool
    path: Path
    byte_order: str = ""

    @property
    def is_valid(self) -> bool:
        """Whether everything that shows at the output of a real instrument is as the driver assumes."""
        return self.verdict is OutputVerdict.PASS and not self.simulated


def save_record(
    identity: Identity,
    simulated: bool,
    rate_hz: float,
    result: "Commissioned",
    simulated_bench: str = "",
    card_driver: str = "ni",
) -> Path:
    """Write the record of an instrument, measured by a card, and the traces beside it; return the record's path.

    Raises:
        OSError: it cannot be written.
    """
    path = record_path(identity, simulated_bench)
    path.parent.mkdir(parents=True, exist_ok=True)
    traces = {f"{i:02d} {trace.name}": trace.volts.astype(np.float32) for i, trace in enumerate(result.traces)}
    with path.with_suffix(".npz").open("wb") as file:
        np.savez_compressed(file, **{**traces, "rate_hz": np.array(rate_hz)})  # type: ignore[arg-type]
    record = make_record(identity, simulated, rate_hz, result, card_driver)
    write_atomic(path, json.dumps(record, indent=1, ensure_ascii=False) + "\n")
    return path


def make_record(
    identity: Identity, simulated: bool, rate_hz: float, result: "Commissioned", card_driver: str = "ni"
) -> dict[str, Any]:
    """Return the record of an instrument as plain values; a figure that was not measured is null."""
    return {
        "format": FORMAT,
        "maker": identity.maker,
        "model": identity.model,
        "serial": identity.serial,
        "firmware": identity.firmware,
        "simulated": simulated,
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "program": version(),
        "rate_hz": rate_hz,
        "byte_order": result.byte_order,
        "verdict": worst_verdict(result.checks),
        "checks": [
            {
                "name": check.check,
                "verdict": check.verdict,
                "value": _finite(check.value),
                "unit": check.unit,
                "low": check.low,
                "high": check.high,
                "detail": check.detail,
            }
            for check in result.checks
        ],
        "assumptions": [
            {
                "property": each.assumption.quantity,
                "value": each.assumption.value,
                "evidence": each.assumption.evidence,
                "verdict": each.verdict,
            }
            for each in checked_assumptions(
                (
                    *assumptions_about(identity.model),
                    *assumptions_about_card(plays=identity.maker == CARD_MAKER, driver=card_driver),
                ),
                result.checks,
            )
        ],
        "times": {name: _finite(value) for name, value in asdict(result.times).items()},
        "commands": [asdict(each) for each in result.commands],
        "errors": list(result.errors),
    }


def load_record(identity: Identity, simulated_bench: str = "") -> CommissioningRecord | None:
    """Return the readable record of an instrument with its present firmware, or None."""
    path = record_path(identity, simulated_bench)
    try:
        with open_regular(path) as file:
            read = json.loads(file.read(MAX_BYTES))
        if read["format"] != FORMAT or any(
            read[k] != getattr(identity, k) for k in ("maker", "model", "serial", "firmware")
        ):
            return None
        checks = [
            CheckedOutput(
                OutputCheck(check["name"]),
                math.nan if check["value"] is None else float(check["value"]),
                str(check["unit"]),
                check["low"],
                check["high"],
                str(check["detail"]),
            )
            for check in read["checks"]
        ]
        names = {each.name for each in fields(MeasuredTimes)} & read["times"].keys()  # older records have fewer
        times = {name: math.nan if (value := read["times"][name]) is None else float(value) for name in names}
        failed = tuple(describe_check(check) for check in checks if not check.passed)
        return CommissioningRecord(
            worst_verdict(checks),
            str(read["date"]),
            failed,
            MeasuredTimes(**times),
            bool(read["simulated"]),
            path,
            order if (order := read.get("byte_order")) in OTHER_BYTE_ORDER else "",  # older records have none
        )
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return None


def firmwares_with_record(identity: Identity) -> list[str]:
    """Return the firmwares of this instrument's commissionings, by the names of their records."""
    return sorted(path.stem for path in record_path(identity).parent.glob("*.json"))


def describe_check(check: CheckedOutput) -> str:
    """Return a check as a line: verdict, name, figure and limits."""
    unit = "" if check.unit == "1" else f" {check.unit}"
    if not math.isfinite(check.value):
        return f"{check.verdict}: {check.check}"
    limits = " to ".join(f"{limit:g}" for limit in (check.low, check.high) if limit is not None)
    limits = limits if check.low is not None else f"at most {limits}"
    detail = f" ({check.detail})" if check.detail else ""
    return f"{check.verdict}: {check.check} {check.value:.4g}{unit}, limit {limits}{unit}{detail}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
