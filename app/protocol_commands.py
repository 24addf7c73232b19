"""`tactor-bench protocols` and `tactor-bench resume`: what can be measured, and going on with what was begun."""

import argparse
import json
import sys
from inspect import getdoc

from app.commands import chosen_bench, protocol_kind, run_headless
from app.exits import DONE, UsageError
from app.gui.fields import fields_of, text_of
from protocols.continuation import earlier, named
from protocols.protocol import Protocol
from protocols.registry import PROTOCOLS, load_plug_ins
from protocols.runreader import RunError


def resume_run(options: argparse.Namespace) -> int:
    """Go on with a run beside the old one, of the same specimen; the exit code of a run."""
    config, speed = chosen_bench(options)
    for trouble in load_plug_ins():
        sys.stderr.write(f"{trouble}\n")
    if options.file:
        protocol_kind(options.file)
    try:
        again = named(options.run, [word for word in options.again.split(",") if word]) if options.again else ()
        before = earlier(options.run, again)
    except RunError as error:
        raise UsageError(str(error)) from None
    options.out = options.out or options.run.parent
    options.specimen = options.specimen or before.specimen
    return run_headless(config, speed, options, before.protocol, before=before)[0]


def list_protocols(options: argparse.Namespace) -> int:
    """What can be measured, or the parameters of one protocol."""
    for trouble in load_plug_ins():
        sys.stderr.write(f"{trouble}\n")
    if options.protocol:
        kind = protocol_kind(options.protocol)
        rows = _parameters(kind)
        lines = [f"{kind.title}: {_first_line(kind)}"]
        for row in rows:
            lines += [f"  {row['parameter']} = {row['default']} {row['unit']}".rstrip()]
            lines += [f"      {row['what it is']}" + (f"; {row['range']}" if row["range"] else "")]
    else:
        rows = [{"protocol": name, "what it measures": _first_line(kind)} for name, kind in sorted(PROTOCOLS.items())]
        widest = max(map(len, PROTOCOLS))
        lines = [f"{row['protocol']:{widest}}  {row['what it measures']}" for row in rows]
    sys.stdout.write((json.dumps(rows) if options.json else "\n".join(lines)) + "\n")
    return DONE


def _parameters(kind: type[Protocol]) -> list[dict[str, str]]:
    return [
        {
            "parameter": field.name,
            "default": text_of(kind.model_fields[field.name].get_default(call_default_factory=True)),
            "unit": field.unit,
            "range": field.limits,
            "what it is": field.words,
        }
        for field in fields_of(kind)
    ]


def _first_line(kind: type[Protocol]) -> str:
    """The protocol's own first sentence."""
    return (getdoc(kind) or kind.title).splitlines()[0]
