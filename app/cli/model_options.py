"""Options of the model's commands: `--set`, numbers with units, lists and ranges."""

import math
import re
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np
from annotated_types import Interval

from app.cli.options import JSON_OBJECT, FileOptions, option, options, split_setting
from app.cli.output import NO_FILES, CommandResult, check_output_files, render
from app.common import PEAK_TO_PEAK, UnitError, UsageError, read_number, to_number
from app.identification import PAPER_MODEL, USUAL_RANGES, ActiveModel
from drivers import open_regular
from model import (
    GRAVITY,
    PRE_STRETCH,
    Membrane,
    ParameterError,
    ParameterSpec,
    Specimen,
    parameter_specs,
    replace_variables,
    variable_specs,
)
from model.response import DEFAULT_ACCURACY, ShapeChoice, choose_shapes
from protocols.base import MAX_TOML_BYTES, parse_json_object, parse_toml

VOLTAGE = ParameterSpec("voltage", "V", Interval(), "voltage on the specimen", None)
LOAD = ParameterSpec("load", "N", Interval(), "load at the centre", None)
OFFSET = ParameterSpec("offset", "V", Interval(), "offset of the drive at the amplifier's input", 2.5)
ELONGATION = ParameterSpec("elongation", "m", Interval(ge=0), "elongation of the membrane", None)
DURATION = ParameterSpec("duration", "s", Interval(gt=0), "duration of the curve", None)
DENSITY = ParameterSpec("density", "kg/m^3", Interval(gt=0), "density of the membrane", 1000.0)

MEMBRANE_VARIABLES = {"delta", "contact_length", *(spec.name for spec in parameter_specs(Membrane))}
"""Variables that put the tactor on the membrane if one of them is given."""

MAX_VALUES = 100_000
"""Most values of a range."""

SET_HELP = (
    "a parameter with its value, with or without a unit, e.g. 'L=22 mm'; may be repeated. "
    "'tactor-bench model parameters' lists them. @FILE reads several from a TOML or JSON file, as the Explore page copies them"
)

NUMBER_WITH_UNIT = re.compile(r"[-+]?[\d.]+(?:[eE][-+]?\d+)?\s*(?P<unit>[^\d\s].*)")


@contextmanager
def translate_model_errors() -> Iterator[None]:
    """Raise UsageError for errors of the model."""
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            yield
    except (ParameterError, UnitError) as error:
        raise UsageError(str(error).replace(" : ", ": ")) from None
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise UsageError(
            f"the model cannot be computed with these parameters ({error}): they lie too many orders of magnitude apart; "
            "correct the one that is far from the paper's, which 'tactor-bench model parameters' lists"
        ) from None


def read_load(text: str) -> float:
    """Return a load in newtons; a mass means its weight."""
    try:
        return read_number(text, LOAD)
    except UnitError:
        try:
            return float(LOAD.check(to_number(text, "kg"))) * GRAVITY
        except UnitError:
            raise UnitError(
                f"load: '{text}' is neither a force nor a mass; write for example '0.5 N' or '50 g'"
            ) from None


def read_values(text: str, quantity: ParameterSpec) -> tuple[float, ...]:
    """Read `25, 50, 75 Hz` (the unit at the end applies to all), `START:STOP:COUNT`, or `START:STOP:COUNT:log`.

    Raises:
        UsageError: an invalid range.
        UnitError, ParameterError: an invalid number, or one out of range.
    """
    if ":" not in text:
        items = text.split(",") if "," in text else _split_list(text)
        return tuple(read_number(item, quantity) for item in _apply_shared_unit(items))
    ends, (count, *how) = (
        _apply_shared_unit(text.split(":")[:2]),
        (*text.split(":")[2:], "")[: max(text.count(":") - 1, 1)],
    )
    if not count.strip().isdigit() or how not in ([], ["log"]):
        raise UsageError(f"{quantity.name}: '{text}' is not a range; write START:STOP:COUNT, or START:STOP:COUNT:log")
    if not 2 <= int(count) <= MAX_VALUES:
        raise UsageError(f"{quantity.name}: '{text}' has {count} values; a range has 2 to {MAX_VALUES}")
    start, stop = (read_number(end, quantity) for end in ends)
    if not how:
        return tuple(np.linspace(start, stop, int(count)).tolist())
    if not (start > 0 and stop > 0):
        raise UsageError(f"{quantity.name}: '{text}' is logarithmic, so both ends must be greater than 0")
    return tuple(np.geomspace(start, stop, int(count)).tolist())


def read_vary(text: str) -> tuple[str, tuple[float, ...]]:
    """Read `NAME=LIST`: a variable of the model and its values."""
    name, values = split_setting(text, "--vary", "delta=0:0.04:9")
    return name, read_values(values, _variable_spec(name))


def read_settings(settings: Sequence[str]) -> dict[str, float]:
    """Read `NAME=VALUE` texts as SI numbers by name; the last value of a name applies.

    A text may also hold several: a JSON object or TOML lines, as the window copies them, or `@FILE` with either.

    Raises:
        UsageError: an invalid setting, or an unknown name.
    """
    values = {}
    for setting in (one for text in settings for one in _expand_setting(text)):
        name, value = split_setting(setting, "--set", "'L=22 mm'")
        values[name] = read_number(value, _variable_spec(name))
    return values


@options
class ParameterOptions:
    """Parameters of the model, and JSON output."""

    settings: Sequence[str] = option(SET_HELP, flag="--set", metavar="NAME=VALUE")
    json: bool = JSON_OBJECT


@options
class SpecimenOptions(ParameterOptions):
    """Parameters and pre-stretch of a specimen."""

    pre_stretch: str | None = option(
        "pre-stretch of the membrane, e.g. 0.0075 or '0.75 %%'; puts the tactor on the membrane", metavar="DELTA"
    )
    elongation: str | None = option(
        "elongation of the membrane, e.g. '1.27 mm'; puts the tactor on the membrane", metavar="LENGTH"
    )

    @property
    def stretch_flags(self) -> list[str]:
        """The options given that stretch the membrane."""
        given = {"--pre-stretch": self.pre_stretch, "--elongation": self.elongation}
        return [flag for flag, text in given.items() if text is not None]


class Topic(SpecimenOptions, ABC):
    """A topic of the command `model`.

    It is not a dataclass itself, so that the options of a topic's `files`, if it writes any, are the last ones.
    """

    files: FileOptions = NO_FILES

    @abstractmethod
    def compute(self) -> CommandResult:
        """Return the result, which is then written and printed."""

    def execute(self) -> int:
        check_output_files(self.files)
        try:
            with translate_model_errors():
                result = self.compute()
                notes = plausibility_notes(result.specimen, self)
        except UsageError as error:
            questions = self._implausible_settings()
            if not questions:
                raise
            raise UsageError("; ".join((*questions, str(error)))) from None
        return render(replace(result, notes=(*result.notes, *notes)), self.json, self.files)

    def _implausible_settings(self) -> list[str]:
        """Return a question for each implausible setting; none where a setting cannot be read at all."""
        try:
            with translate_model_errors():
                return [
                    text.removeprefix("CAUTION: ") for text in plausibility_notes(read_settings(self.settings), self)
                ]
        except UsageError:
            return []


@options
class DriveOptions:
    """The drive at the amplifier's input."""

    peak_to_peak: str = option("drive at the amplifier's input, peak to peak (default: 5 V)", "5 V", metavar="VOLTS")
    offset: str = option("mean of the drive at the amplifier's input (default: 2.5 V)", "2.5 V", metavar="VOLTS")

    def read(self) -> tuple[float, float]:
        """Return amplitude and offset in volts.

        Raises:
            UnitError, ParameterError: a value is not a voltage, or not admitted.
        """
        return read_number(self.peak_to_peak, PEAK_TO_PEAK) / 2, read_number(self.offset, OFFSET)


def plausibility_notes(values: Mapping[str, float], given: SpecimenOptions) -> tuple[str, ...]:
    """Return a question for each value that the user gave and that is implausible: most likely its unit is wrong."""
    names = set(read_settings(given.settings))
    if given.stretch_flags:
        names.add("delta")
    return tuple(
        note
        for name in sorted(names & USUAL_RANGES.keys() & values.keys())
        if (note := plausibility_note(name, values[name]))
    )


def plausibility_note(name: str, value: float) -> str:
    """Return the question for an implausible value; empty for a usual one."""
    low, high = USUAL_RANGES[name]
    if not value or low <= abs(value) <= high:
        return ""
    unit = _variable_spec(name).unit.removeprefix("1")
    stated, usual = f"{name} is {value:.4g} {unit}".rstrip(), f"usually {low:g} to {high:g} {unit}".rstrip()
    return f"CAUTION: {stated}, {usual}: is the unit right?"


@options
class ShapeOptions:
    """Number of shape functions, or the accuracy that they must have."""

    n: int | None = option("number of shape functions, 3 to 300 (default: as many as --accuracy needs)", flag="-n")
    accuracy: str = option(
        "largest relative error of the complex response up to 500 Hz, against the closed form (default: 0.1 %%)",
        f"{100 * DEFAULT_ACCURACY:g} %",
        metavar="SHARE",
    )

    def choose(self, specimen: Specimen, highest_hz: float = 0.0, hermite: bool = False) -> ShapeChoice:
        """Return the number of shape functions for a specimen, or of unknowns if it may be `hermite`, and how accurate it is."""
        share = to_number(self.accuracy.strip().removesuffix("%"), "1") / (100 if "%" in self.accuracy else 1)
        return choose_shapes(specimen.tactor, specimen.skin, self.n, share, highest_hz, hermite)


def read_specimen(options: SpecimenOptions, on_membrane: bool = False, base: ActiveModel = PAPER_MODEL) -> Specimen:
    """Return the specimen of `--set`, `--pre-stretch` and `--elongation`; other values are taken from `base`.

    The tactor is free unless a parameter of the membrane is given, or `on_membrane`.
    """
    values = read_settings(options.settings)
    given = options.stretch_flags + ["--set delta"] * ("delta" in values)
    if len(given) > 1:
        raise UsageError(f"the pre-stretch is given twice, by {' and '.join(given)}; leave one out")
    if options.pre_stretch is not None:
        values["delta"] = read_number(options.pre_stretch, PRE_STRETCH)
    if options.elongation is not None:
        specimen = replace_variables(Specimen(base.tactor, base.membrane), values)
        values["delta"] = read_number(options.elongation, ELONGATION) / specimen.value("L_m")
    pressed = on_membrane or bool(values.keys() & MEMBRANE_VARIABLES)
    membrane = base.membrane if pressed else None
    return replace_variables(Specimen(base.tactor, membrane), {**base.nonideal, **values})


def describe_specimen(specimen: Specimen) -> str:
    """Describe the support of the specimen: free, or its skin."""
    skin = specimen.skin
    if specimen.membrane is None and skin.k_s == 0 and skin.c_s == 0:
        return "vibrating freely"
    bed = f"k_s = {skin.k_s:.4g} N/m², c_s = {skin.c_s:.4g} kg/(m s)"
    if specimen.membrane is None:
        return f"on a skin of {bed}"
    length = 1e3 * specimen.delta * specimen.membrane.L_m
    return f"on the membrane at pre-stretch {specimen.delta:.4g} ({length:.3g} mm elongation): {bed}"


def _expand_setting(text: str) -> list[str]:
    """Split a text of several settings; a single one is returned as it is."""
    if text.startswith("@"):
        try:
            with open_regular(Path(text[1:]), "r", encoding="utf-8") as file:
                text = file.read(MAX_TOML_BYTES + 1)
        except (OSError, ValueError) as error:
            raise UsageError(f"--set {text}: the file cannot be read: {error}") from None
        if len(text) > MAX_TOML_BYTES:
            raise UsageError(f"--set: the file is longer than {MAX_TOML_BYTES / 1e6:g} MB and no list of settings")
    elif not text.lstrip().startswith("{") and "\n" not in text.strip():
        return [text]
    try:
        record = parse_json_object(text) if text.lstrip().startswith("{") else parse_toml(text)
    except ValueError as error:
        raise UsageError(f"--set: no JSON object and no TOML lines of NAME = VALUE: {error}") from None
    return [f"{name}={value}" for name, value in record.items()]


def _variable_spec(name: str) -> ParameterSpec:
    specs = variable_specs()
    if name not in specs:
        raise UsageError(f"there is no parameter '{name}'; there are: {', '.join(specs)}")
    return specs[name]


def _apply_shared_unit(items: Sequence[str]) -> list[str]:
    """Apply a unit that only the last item has to all: `1, 2 mm` does not mean 1 m."""
    last = None if _is_number(items[-1]) else NUMBER_WITH_UNIT.fullmatch(items[-1].strip())
    return [f"{item.strip()} {last['unit']}" if last and _is_number(item) else item.strip() for item in items]


def _split_list(text: str) -> list[str]:
    """Split a list at spaces, unless a space separates number and unit."""
    return text.split() if all(_is_number(word) for word in text.split()) and text.strip() else [text]


def _is_number(text: str) -> bool:
    try:
        return not math.isnan(float(text))
    except ValueError:
        return False
