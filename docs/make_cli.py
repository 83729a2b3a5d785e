"""Write the command line's help pages as Markdown: `python docs/make_cli.py docs/cli.md` (or `make docs`)."""

from __future__ import annotations

import sys
from pathlib import Path

import click
from pdecodec.cli.main import pdecodec


def help_pages() -> str:
    """Every command's usage, text and options, in the words of its `--help`."""
    pages = ["# The command line", "", "Written by `make docs` from the commands themselves; do not edit."]
    root = click.Context(pdecodec, info_name="pdecodec")
    pages += ["", *_page(pdecodec, root)]
    for name in pdecodec.list_commands(root):
        command = pdecodec.commands[name]
        pages += ["", *_page(command, click.Context(command, info_name=name, parent=root))]
    return "\n".join(pages) + "\n"


def _page(command: click.Command, context: click.Context) -> list[str]:
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    lines = [f"## {context.command_path}", "", "```text", usage, "```", "", *_paragraphs(command.help or "")]
    if isinstance(command, click.Group):
        lines += [f"- `{name}`: {command.commands[name].get_short_help_str(200)}" for name in sorted(command.commands)]
        return lines
    records = [record for item in command.get_params(context) if (record := item.get_help_record(context))]
    return lines + [f"- `{names}`: {' '.join(text.split())}" for names, text in records]


def _paragraphs(text: str) -> list[str]:
    return [line for paragraph in text.strip().split("\n\n") for line in (" ".join(paragraph.split()), "")]


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(help_pages(), encoding="utf-8")
