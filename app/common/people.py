"""Operator of the day and typed temperature and humidity, remembered until midnight for this user of the computer."""

import json
import re
from dataclasses import replace
from datetime import datetime
from pathlib import Path

from app.common.exit_codes import UsageError
from app.common.terminal import truncate_text
from protocols.base import RunConditions, read_json_file, write_atomic

GIVEN, LOGIN = "given", "login of the computer"
MAX_NAME_LENGTH = 100
NUMBER_WITH_UNIT = re.compile(r"([-+]?\d+(?:\.\d*)?)\s*(\S*)")
REMEMBERED = ("operator", "temperature_c", "humidity", "origin")
"""Conditions that the file of the day stores."""
KELVIN_OF_ZERO_C = 273.15


def operator_path() -> Path:
    """Return the file that remembers who measures today."""
    from platformdirs import user_config_path

    return user_config_path("tactor-bench", appauthor=False) / "operator.json"


def remembered_conditions(now: datetime | None = None) -> RunConditions:
    """Return the conditions stated today; their operator is empty if none was stated today or the file is damaged."""
    today = f"{now or datetime.now():%Y-%m-%d}"
    try:
        record = read_json_file(operator_path())
        if record["day"] != today:
            return RunConditions()
        name, origin = check_operator(record["operator"]), str(record["origin"])
        temperature_c, humidity = (
            None if record[key] is None else float(record[key]) for key in ("temperature_c", "humidity")
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError, UsageError):
        return RunConditions()
    return RunConditions(name, GIVEN if name else "", temperature_c, humidity, origin)


def remember_typed_conditions(name: str | None, temperature: str | None, humidity: str | None) -> None:
    """Remember until midnight the arguments that are not None; temperature and humidity with their units.

    Raises:
        UsageError: a value cannot be used.
    """
    if not (name is None and temperature is None and humidity is None):
        remember_conditions(
            name,
            None if temperature is None else read_temperature(temperature),
            None if humidity is None else read_humidity(humidity),
        )


def remember_conditions(
    operator: str | None = None,
    temperature_c: float | None = None,
    humidity: float | None = None,
    now: datetime | None = None,
) -> RunConditions:
    """Store the operator and the typed conditions until midnight; arguments that are None leave the stored value unchanged.

    Raises:
        UsageError: the name cannot be used, or the file cannot be written.
    """
    now = now or datetime.now()
    conditions = remembered_conditions(now)
    if operator is not None:
        name = check_operator(operator)
        conditions = replace(conditions, operator=name, operator_origin=GIVEN if name else "")
    if temperature_c is not None or humidity is not None:
        conditions = replace(
            conditions, temperature_c=temperature_c, humidity=humidity, origin=f"typed {now:%Y-%m-%d %H:%M}"
        )
    record = {"day": f"{now:%Y-%m-%d}", **{name: getattr(conditions, name) for name in REMEMBERED}}
    path = operator_path()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        write_atomic(path, json.dumps(record, ensure_ascii=False, indent=1) + "\n")
    except OSError as error:
        raise UsageError(f"{path} cannot be written: {error.strerror or error}; free space there") from None
    return conditions


def current_conditions() -> RunConditions:
    """Return the conditions stated today; the operator defaults to the computer's login name."""
    conditions = remembered_conditions()
    return conditions if conditions.operator else replace(conditions, operator=login_name(), operator_origin=LOGIN)


def login_name() -> str:
    """Return the computer's login name; empty if it has none."""
    import getpass

    try:
        return check_operator(getpass.getuser())
    except (OSError, KeyError, ImportError, UsageError):  # no such user, or a name that cannot be stored
        return ""


def check_operator(text: str) -> str:
    """Return a person's name, without surrounding spaces; it may be empty.

    Raises:
        UsageError: it is too long, or has unprintable characters.
    """
    name = " ".join(text.split())
    if len(name) > MAX_NAME_LENGTH or not name.isprintable():
        raise UsageError(
            f"{truncate_text(name)!r} is not a name; give up to {MAX_NAME_LENGTH} readable characters in one line"
        )
    return name


def read_temperature(text: str) -> float:
    """Parse `23.4`, `23.4 °C`, `23.4 degC` or `296.5 K` into degrees Celsius.

    Raises:
        UsageError: it has none of these forms, or is no temperature of a laboratory.
    """
    from drivers.sensors import HIGHEST_C, LOWEST_C

    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    if match is None or match[2] not in ("", "C", "°C", "degC", "K"):
        raise UsageError(f"'{truncate_text(text)}' is no temperature; write for example 23.4 °C")
    celsius = float(match[1]) - (KELVIN_OF_ZERO_C if match[2] == "K" else 0.0)
    if not LOWEST_C <= celsius <= HIGHEST_C:
        raise UsageError(f"{celsius:g} °C is no temperature of a laboratory; from {LOWEST_C:g} to {HIGHEST_C:g} °C")
    return round(celsius, 6)


def read_humidity(text: str) -> float:
    """Parse `45 %` or `45`, per cent, into relative humidity from 0 to 1.

    Raises:
        UsageError: it has none of these forms, or is not from 1 to 100 %.
    """
    match = NUMBER_WITH_UNIT.fullmatch(text.strip())
    if match is None or match[2] not in ("", "%", "%RH"):
        raise UsageError(f"'{truncate_text(text)}' is no humidity; write for example 45 %")
    if not 1 <= float(match[1]) <= 100:
        raise UsageError(f"a relative humidity of {match[1]} % is not from 1 to 100 %; write for example 45 %")
    return float(match[1]) / 100
