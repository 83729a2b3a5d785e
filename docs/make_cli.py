"""Write the command line's help pages as Markdown: `python docs/make_cli.py docs/cli.md` (or `make docs`)."""

from __future__ import annotations

import sys
from pathlib import Path

import click

from pdecodec.cli.main import pdecodec

COMPLETION = """\
## Completion

Shells complete commands and options after one of these lines in their start-up files:

```sh
eval "$(_PDECODEC_COMPLETE=bash_source pdecodec)"        # ~/.bashrc
eval "$(_PDECODEC_COMPLETE=zsh_source pdecodec)"         # ~/.zshrc
_PDECODEC_COMPLETE=fish_source pdecodec | source         # ~/.config/fish/completions/pdecodec.fish
```
"""


def help_pages() -> str:
    """Every command's usage, text and options, in the words of its `--help`."""
    head = ["# The command line", "", "Written by `make docs` from the commands themselves; do not edit.", ""]
    # click keeps what the first context says about a command's help option.
    pages = _pages(pdecodec, click.Context(pdecodec, info_name="pdecodec", **pdecodec.context_settings))
    return "\n".join([*head, *pages, COMPLETION]).rstrip("\n") + "\n"


def _pages(command: click.Command, context: click.Context) -> list[str]:
    """Return the page of a command, followed by the pages of its subcommands."""
    usage = " ".join([context.command_path, *command.collect_usage_pieces(context)])
    lines = [f"## {context.command_path}", "", "```text", usage, "```", "", *_paragraphs(command.help or "")]
    lines += [f"- `{names}`: {' '.join(text.split())}" for names, text in _options(command, context)]
    if not isinstance(command, click.Group):
        return [*lines, ""]
    members = [
        (name, member) for name in command.list_commands(context) if (member := command.get_command(context, name))
    ]
    lines += [f"- `{name}`: {member.short_help or member.get_short_help_str(200)}" for name, member in members]
    lines.append("")
    for name, member in members:
        lines += _pages(member, click.Context(member, info_name=name, parent=context))
    return lines


def _options(command: click.Command, context: click.Context) -> list[tuple[str, str]]:
    """Return names and help texts of a command's own options. `--help` is left out, which all have; arguments
    are in the usage.
    """
    options = [item for item in command.params if isinstance(item, click.Option)]
    return [record for item in options if (record := item.get_help_record(context)) is not None]


def _paragraphs(text: str) -> list[str]:
    return [line for paragraph in text.strip().split("\n\n") for line in (" ".join(paragraph.split()), "")]


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(help_pages(), encoding="utf-8")
