"""`tactor-bench devices`, `bench new` and `faults`."""

import argparse
import json
import sys
from dataclasses import asdict

from rich.console import Console
from rich.table import Table

from app.exits import DONE, UsageError
from app.finding import find
from app.first_bench import first_bench
from sim_hardware.faults import FAULTS


def devices(options: argparse.Namespace) -> int:
    """Print what is connected; 0 also where nothing is."""
    found, notes = find(options.hosts, options.server)
    if options.json:
        sys.stdout.write(json.dumps({"found": [asdict(one) for one in found], "notes": notes}) + "\n")
        return DONE
    table = Table(title="Connected" if found else "Nothing was found", title_justify="left")
    for head in ("what", "where", "who"):
        table.add_column(head, overflow="fold")
    for one in found:
        table.add_row(one.role, one.where, one.identity)
    Console(markup=False, highlight=False).print(table if found else "Nothing was found.")
    for note in notes:
        sys.stderr.write(f"{note}\n")
    return DONE


def bench_new(options: argparse.Namespace) -> int:
    """Write a first bench file.

    Raises:
        UsageError: the file is there already, or cannot be written.
    """
    if options.file.exists():
        raise UsageError(f"{options.file} is there already and is not overwritten; give another name")
    found, notes = find(options.hosts, options.server)
    try:
        with options.file.open("x", encoding="utf-8") as file:
            file.write(first_bench(found, options.server))
    except FileExistsError:
        raise UsageError(f"{options.file} is there already and is not overwritten; give another name") from None
    except OSError as error:
        raise UsageError(f"{options.file} cannot be written: {error.strerror or error}") from None
    for note in notes:
        sys.stderr.write(f"{note}\n")
    have = [f"{one.role} {one.identity}" for one in found if one.role in ("generator", "supply", "card")]
    sys.stderr.write(
        f"{options.file}: {', '.join(have) or 'nothing was found, the addresses are examples'}. Go through it\n"
    )
    return DONE


def list_faults(options: argparse.Namespace) -> int:
    """Print what can be broken on a simulated bench."""
    if options.json:
        sys.stdout.write(json.dumps(FAULTS) + "\n")
        return DONE
    width = max(map(len, FAULTS))
    sys.stdout.write("".join(f"{name:{width}}  {words}\n" for name, words in FAULTS.items()))
    return DONE
