"""`pdecodec formats`: which formats there are."""

from __future__ import annotations

import click

from pdecodec.cli.console import print_json, print_table
from pdecodec.cli.options import json_option


@click.command()
@json_option
def formats(*, as_json: bool) -> None:
    """List the formats that can be read and written."""
    from rich.table import Table

    from pdecodec.formats import list_formats

    entries = list_formats()
    if as_json:
        rows = [
            {
                "name": entry.name,
                "title": entry.title,
                "extensions": list(entry.extensions),
                "reads": entry.reads,
                "writes": entry.writes,
                "extra": entry.extra,
                "keeps": entry.keeps,
                "loses": entry.loses,
            }
            for entry in entries
        ]
        print_json({"formats": rows})
        return
    table = Table("format", "extensions", "read", "write", "keeps", box=None)
    for entry in entries:
        writes = "yes" if entry.writes else entry.write_with or "no"
        table.add_row(entry.title, " ".join(entry.extensions), "yes" if entry.reads else "no", writes, entry.keeps)
    print_table(table)
