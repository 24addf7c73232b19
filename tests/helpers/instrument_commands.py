"""Commands of an instrument, recorded by phase and compared with data that name their sources."""

import re
from collections.abc import Iterable, Mapping
from typing import Any

Recorded = tuple[tuple[str, str], ...]
"""Step and command, one by one, in the order in which they were sent; a step is a phase and its number."""

SOURCE = re.compile(
    r" at [0-9a-f]{7}\b|p\. ?\d+|\b\d-\d{2,3}\b|issue \d+|IEEE 488|SCPI-99|Guide|Manual|\bPG02|unproven"
)
"""A public driver with its commit, a guide with its page or command, a standard, or "unproven"."""

NUMBER_OR_NAME = re.compile(r"[+-]?[\d.]+(E[+-]?\d+)?$|TB\d+$|tbench\d+$|$", re.IGNORECASE)


def commands_of(message: str) -> list[str]:
    """Split a message into its commands, without the data of a waveform."""
    text = message.partition(",#")[0].partition("WAVEDATA")[0]
    return [command.strip().removeprefix(":") for command in text.split(";") if command.strip()]


def without_values(command: str) -> str:
    """Return a command without its numbers and names: its header, and those parameters that are keywords."""
    header, _, parameters = command.partition(" ")
    keywords = [p for p in parameters.split(",") if not NUMBER_OR_NAME.match(p.strip())]
    return f"{header} {','.join(keywords)}".strip()


def sourced(sources: Iterable[Mapping[str, Any]]) -> dict[str, str]:
    """Return the source of each command; queries without parameters have that of their header."""
    return {command: str(each["source"]) for each in sources for command in each["commands"]}


def without_source(recorded: Recorded, known: Iterable[str]) -> set[str]:
    """Return what was sent and is in no source: commands with their keywords, and queries."""
    commands = set(known)
    queries = {f"{command.partition(' ')[0].rstrip('?')}?" for command in commands}
    sent = {without_values(command) for _, command in recorded}
    return sent - commands - queries


def never_sent(recorded: Recorded, known: Iterable[str]) -> set[str]:
    """Return what is in a source and was not sent; a header alone may have been queried only."""
    sent = {without_values(command) for _, command in recorded}
    return {command for command in known if command not in sent and f"{command}?" not in sent}


def steps_of(recorded: Recorded, phase: str) -> list[list[str]]:
    """Return the commands of each step of a phase."""
    steps: dict[str, list[str]] = {}
    for step, command in recorded:
        if step.partition(" ")[0] == phase:
            steps.setdefault(step, []).append(command)
    return list(steps.values())


def assert_in_order(recorded: Recorded, rule: Mapping[str, Any]) -> None:
    """Assert that in each step with a `then` (and with `among`, if given), which there is, a `first` precedes it."""
    compared = 0
    for commands in steps_of(recorded, rule["phase"]):
        thens = [i for i, command in enumerate(commands) if is_about(command, rule["then"])]
        if thens and ("among" not in rule or any(is_about(command, rule["among"]) for command in commands)):
            assert any(is_about(command, rule["first"]) for command in commands[: thens[0]]), (rule, commands)
            compared += 1
    assert compared, rule


def is_about(command: str, text: str | list[str]) -> bool:
    """Whether a command is one of these, with or without further parameters."""
    texts = [text] if isinstance(text, str) else text
    return any(command == t or command.startswith((t + ",", t + " ")) for t in texts)
