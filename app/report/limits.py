"""Limits on figures of merit: TOML file, validation, and verdicts for a specimen."""

import hashlib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Annotated, Any, Literal

from annotated_types import Interval, Unit
from pydantic import Field, ValidationError, create_model, model_validator

from app.common import typeset_unit
from app.config import ConfigTable, validation_messages
from app.report.document import LimitOutcome, Verdict
from app.report.rounding import MINUS, typeset_measurement, typeset_number
from model import COVERAGE_FACTOR_95, QUANTITIES, EstimatedQuantity, Quantity, format_with_uncertainty
from protocols.base import parse_toml, read_toml_text

AMBIGUOUS_RESONANCE = (
    "'resonance' has three meanings; name the limit peak_frequency (of the largest response: its meaning in reports until now), "
    "natural_frequency (undamped: its meaning in the fleet until now) or damped_frequency (of the free decay)"
)
LIMITS_FILE_NAME = "limits.toml"
"""Name of the limits file in the folder of the runs."""

Rule = Literal["guarded", "simple"]

FIGURES_OF_MERIT = (
    "natural_frequency", "damped_frequency", "peak_frequency", "damping_ratio", "amplitude_at_resonance", "usable_from", "usable_to",
    "smallest_margin", "smallest_margin_on_membrane", "latency", "rise_time", "k2", "mu", "m_add", "c0", "E_m", "c_s_0", "c_s_delta",
)  # fmt: skip
"""Quantities that limits can be set on."""

EXAMPLE_LIMITS = """\
# Limits for 'tactor-bench report'. Beside the runs under the name limits.toml it is found by itself; any other file is named
# with --limits FILE. A value may carry a unit, in quotes: low = "150 Hz". Plain numbers are SI.

# "guarded": the whole 95 % interval must lie within the limits, or the verdict is 'cannot tell'. "simple": the value alone counts.
rule = "guarded"

# The specimen that within_golden compares with: its runs in the same folder are identified in the same way.
# golden = "T0"

[limits.peak_frequency]         # of the largest response, as measured: through the four highest points of the free dwell
low = "145 Hz"
high = "170 Hz"

[limits.amplitude_at_resonance] # max - min at full drive
low = "0.9 mm"

[limits.smallest_margin]        # over the threshold of the skin, 50 um, from 5 to 250 Hz
low = 4

# [limits.k2]
# within_golden = "5 %"

# What else a limit can be set on: {names}
"""


class LimitsError(Exception):
    """A limits file is invalid; the message lists every fault with line and remedy."""


@dataclass(frozen=True, slots=True)
class Limit:
    """Limits on one quantity, SI; None for no limit."""

    low: float | None = None
    high: float | None = None
    within_golden: float | None = None
    """Largest relative difference from the golden unit."""


@dataclass(frozen=True, slots=True)
class Limits:
    """Limits of a file."""

    limits: Mapping[str, Limit]
    rule: Rule = "guarded"
    golden: str = ""
    source: str = ""
    """File name and hash, without folder: the report does not depend on where it is made."""

    @property
    def bounds(self) -> dict[str, tuple[float | None, float | None]]:
        """Lower and upper limits of the quantities that have one of them, SI."""
        return {
            name: (limit.low, limit.high)
            for name, limit in self.limits.items()
            if limit.low is not None or limit.high is not None
        }


class _Limit(ConfigTable):
    @model_validator(mode="after")
    def _check_not_empty(self) -> "_Limit":
        bounds = self.model_dump()
        low, high = bounds["low"], bounds["high"]
        if all(value is None for value in bounds.values()):
            raise ValueError("asks nothing; give low, high or within_golden")
        if low is not None and high is not None and low > high:
            raise ValueError(f"low {low:g} is above high {high:g}; nothing could pass")
        return self


def _table(name: str, unit: str) -> type[_Limit]:
    number = Annotated[float | None, Unit(unit)]
    share = Annotated[float | None, Unit("1"), Interval(gt=0)]
    fields: dict[str, Any] = {"low": (number, None), "high": (number, None), "within_golden": (share, None)}
    return create_model(f"Limit of {name}", __base__=_Limit, **fields)


_FIELDS: dict[str, Any] = {name: (_table(name, QUANTITIES[name].unit) | None, None) for name in FIGURES_OF_MERIT}
_Named = create_model("Limits", __base__=ConfigTable, **_FIELDS)


class _File(ConfigTable):
    golden: Annotated[str, "the specimen that within_golden compares with"] = ""
    rule: Annotated[Rule, "whether the 95 % interval or the value alone must lie within"] = "guarded"
    limits: _Named = Field(default_factory=_Named)


def read_limits(path: Path) -> Limits:
    """Read a limits file.

    Raises:
        LimitsError: the file is missing or invalid; every fault is listed.
    """
    text = read_toml_text(path, f"the limits {path}", "file of limits", LimitsError)
    try:
        given = parse_toml(text)
        named = given.get("limits")
        if isinstance(named, dict) and "resonance" in named:
            raise LimitsError(f"{path}: {AMBIGUOUS_RESONANCE}")
        read = _File.model_validate(given).model_dump()
    except ValidationError as error:
        lines = "\n".join(validation_messages(error, text))
        raise LimitsError(
            f"{path} has faults:\n{lines}\nA limit can be set on: {', '.join(FIGURES_OF_MERIT)}"
        ) from error
    except ValueError as error:
        raise LimitsError(f"{path} is not valid TOML: {error}") from error
    limits = {name: Limit(**given) for name, given in read["limits"].items() if given is not None}
    if not limits:
        raise LimitsError(f"{path} sets no limit; 'tactor-bench report --new-limits FILE' writes an example")
    digest = hashlib.sha256(text.encode()).hexdigest()[:16]
    return Limits(limits, read["rule"], read["golden"], f"{path.name} (SHA-256 {digest}...)")


def example_limits() -> str:
    """Return a commented example of a limits file."""
    return EXAMPLE_LIMITS.format(names=", ".join(FIGURES_OF_MERIT))


def judge_limits(
    limits: Limits, merits: Mapping[str, EstimatedQuantity], golden: Mapping[str, EstimatedQuantity]
) -> tuple[LimitOutcome, ...]:
    """Return each limit with its verdict; quantities that were not measured cannot pass."""
    return tuple(
        outcome
        for name, limit in limits.limits.items()
        for outcome in _limit_outcomes(name, limit, limits, merits.get(name), golden.get(name))
    )


def _limit_outcomes(
    name: str, limit: Limit, limits: Limits, merit: EstimatedQuantity | None, golden: EstimatedQuantity | None
) -> Iterator[LimitOutcome]:
    measured, source = "not determined by these runs", ""
    if merit is not None:
        source = str(merit.source)
        measured = typeset_measurement(merit.value, merit.standard_error, merit.unit, name)
    if limit.low is not None or limit.high is not None:
        required = _limit_text(limit, QUANTITIES[name])
        if merit is None:
            yield LimitOutcome(name, required, measured, "cannot tell", "not determined by these runs")
        else:
            half_interval = COVERAGE_FACTOR_95 * merit.standard_error
            low, high = (-inf if limit.low is None else limit.low), (inf if limit.high is None else limit.high)
            verdict = _verdict(merit.value, half_interval, low, high, limits.rule)
            yield LimitOutcome(name, required, measured, *verdict, source)
    if (share := limit.within_golden) is not None:
        required = f"within {100 * share:g} % of {limits.golden}"
        if merit is None or golden is None or golden.value == 0:
            why = "not determined by these runs" if merit is None else f"not determined by the runs of {limits.golden}"
            yield LimitOutcome(name, required, measured, "cannot tell", why, source)
        else:
            ratio = merit.value / golden.value - 1
            both = (merit.standard_error / golden.value, golden.standard_error * merit.value / golden.value**2)
            half_interval = COVERAGE_FACTOR_95 * sum(e * e for e in both) ** 0.5
            change = format_with_uncertainty(100 * ratio, 100 * half_interval, "% (95 %)", signed=True)
            measured += f": {change}".replace("-", MINUS)
            verdict = _verdict(ratio, half_interval, -share, share, limits.rule)
            yield LimitOutcome(name, required, measured, *verdict, source)


def _verdict(value: float, half_interval: float, low: float, high: float, rule: Rule) -> tuple[Verdict, str]:
    if rule == "simple":
        half_interval = 0.0
    if low <= value - half_interval and value + half_interval <= high:
        return "pass", ""
    if value + half_interval < low or value - half_interval > high:
        return "fail", ""
    return "cannot tell", "the 95 % interval crosses the limit"


def _limit_text(limit: Limit, quantity: Quantity) -> str:
    factor, shown = quantity.shown
    low, high = (None if v is None else typeset_number(factor * v) for v in (limit.low, limit.high))
    shown = f" {typeset_unit(shown)}".rstrip()
    if low is not None and high is not None:
        return f"{low} to {high}{shown}"
    return f"at least {low}{shown}" if low is not None else f"at most {high}{shown}"
