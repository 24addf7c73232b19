"""Dialects of the sensors that are read over a wire, from meters.toml."""

import tomllib
from dataclasses import dataclass
from importlib.resources import files
from typing import Any


@dataclass(frozen=True, slots=True)
class Averaging:
    """Questions about the averaging of a controller that sends text.

    Args:
        begin, end: commands around the questions.
        period, count: questions; the last field of a reply is the number of one of `periods_s` and `counts`.
        kind: field before the count, of an average.
    """

    begin: str
    end: str
    period: str
    count: str
    kind: str
    periods_s: tuple[float, ...]
    counts: tuple[int, ...]


@dataclass(frozen=True, slots=True)
class TextDialect:
    """Question and reply of a controller that sends text; see meters.toml."""

    maker: str
    model: str
    baud: int
    ask: str
    end: str
    head: str
    field: str
    invalid: str
    checks: tuple[tuple[str, str, str], ...] = ()
    averaging: Averaging | None = None


@dataclass(frozen=True, slots=True)
class BlockDialect:
    """Blocks of measured values and commands of a controller on Ethernet; see meters.toml.

    Args:
        channel_bits: bits of a channel in the field of channels of the header; 0: the header has no status, and one value is sent.
        range_mm, range_um: pattern of the measuring range in the reply to `asked`, in its unit.
        average_kind, average_count: questions about averaging, and patterns of kind and count in their replies; empty: there is none.
        average_kinds: kinds that average the last values, as many as the count; 0 is none.
    """

    maker: str
    model: str
    channel_bits: int
    scale: str
    invalid_from: int
    prompt: str
    commands: tuple[str, ...]
    asked: str
    full: int = 0
    range_mm: str = ""
    range_um: str = ""
    average_kind: tuple[str, str] = ("", "")
    average_count: tuple[str, str] = ("", "")
    average_kinds: tuple[str, ...] = ()


def _read_dialects() -> tuple[dict[str, TextDialect], dict[str, BlockDialect], dict[str, Any]]:
    """Return the dialects by the name of their driver, and the whole table with sources and quotes."""
    table = tomllib.loads(files("drivers.sensors").joinpath("meters.toml").read_text("utf-8"))
    texts, blocks = {}, {}
    for name, row in table.items():
        if name == "sources":
            continue
        values = {key: value for key, value in row.items() if key not in ("quotes", "unproven")}
        if "ask" in row:
            checks = tuple((str(ask), str(reply), str(why)) for ask, reply, why in values.pop("checks", ()))
            averaging = Averaging(**_with_tuples(values.pop("averaging"))) if "averaging" in values else None
            texts[name] = TextDialect(**values, checks=checks, averaging=averaging)
        else:
            blocks[name] = BlockDialect(**_with_tuples(values))
    return texts, blocks, table


def _with_tuples(values: dict[str, Any]) -> dict[str, Any]:
    return {key: tuple(value) if isinstance(value, list) else value for key, value in values.items()}


TEXT_DIALECTS, BLOCK_DIALECTS, METER_EVIDENCE = _read_dialects()
