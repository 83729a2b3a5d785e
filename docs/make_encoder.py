"""Write the tables of decisions and constants into `docs/encoder.md`: `python docs/make_encoder.py docs/encoder.md`.

The constants are the fields of :class:`pdecodec.codec.encode.tuning.Tuning`, in the words of its docstring; their
measured effects are in `docs/ablation.csv`, which :mod:`pdecodec.research.ablation` writes. `make docs` runs this.
"""

from __future__ import annotations

import csv
import inspect
import re
import sys
from collections.abc import Iterable, Iterator
from dataclasses import fields
from pathlib import Path

from pdecodec.codec.encode.tuning import TUNINGS, Tuning

PAGE = Path(__file__).with_name("encoder.md")
ATTRIBUTE = re.compile(r"^(?P<names>\w+(?:, \w+)*) : (?P<kind>.+)$")
NAMED = re.compile(r"`(?P<name>[a-z_]+) = [^`\n]*`")
NOT_MEASURED = "-"
ALL = "all"

MUCH = 0.003
"""Change of a group's bytes from which on the table names the group."""

Effects = dict[tuple[str, str, str], dict[str, dict[str, str]]]
"""Rows of the ablation: by name, change and effort, then by group of clips."""


def encoder_page() -> str:
    """Return the page with its two tables, and the values of constants that its text names, written again."""
    effects: Effects = {}
    for row in csv.DictReader(_measured()):
        effects.setdefault((row["name"], row["change"], row["effort"]), {})[row["group"]] = row
    page = PAGE.read_text(encoding="utf-8")
    for name, rows in (("decisions", _decisions(effects)), ("constants", _constants(effects))):
        begin, end = (
            f"<!-- {edge} of the table of {name}, which `make docs` writes -->\n" for edge in ("begin", "end")
        )
        before, rest = page.split(begin)
        page = before + begin + "\n".join(["", *rows, "", end]) + rest.split(end)[1]
    return NAMED.sub(_named, page)


def _named(found: re.Match[str]) -> str:
    """Return a constant that the text names, with its present value; ValueError if there is no such constant."""
    name = found["name"]
    if name not in {item.name for item in fields(Tuning)}:
        raise ValueError(
            f"docs/encoder.md names the constant {name}, which Tuning does not have; change the text there"
        )
    return f"`{name} = {_shown(getattr(TUNINGS['default'], name))}`"


def _measured() -> Iterable[str]:
    return PAGE.with_name("ablation.csv").read_text(encoding="utf-8").splitlines()


def _decisions(effects: Effects) -> Iterator[str]:
    yield '| without | bytes | worst clip | time | normals | STED | bytes, "fast" | time, "fast" |'
    yield "|---|---|---|---|---|---|---|---|"
    for (name, change, effort), groups in effects.items():
        if change == "without" and effort == "default":
            figures = (groups[ALL][column] for column in ("worst_bytes", "seconds", "normals", "sted"))
            fast = effects.get((name, change, "fast"))
            of_fast = (_bytes(fast), _percent(fast[ALL]["seconds"])) if fast else ("0", "0")
            yield f"| {name} | {' | '.join((_bytes(groups), *map(_percent, figures), *of_fast))} |"


def _bytes(groups: dict[str, dict[str, str]]) -> str:
    """Return the change of all bytes, and of the group that changes most if that is much."""
    most = max((name for name in groups if name != ALL), key=lambda name: abs(float(groups[name]["bytes"]) - 1.0))
    found = _percent(groups[ALL]["bytes"])
    is_much = abs(float(groups[most]["bytes"]) - 1.0) >= MUCH
    return f"{found} ({most} {_percent(groups[most]['bytes'])})" if is_much else found


def _constants(effects: Effects) -> Iterator[str]:
    yield "| constant | default | fast | best | what it does | bytes, halved | bytes, doubled |"
    yield "|---|---|---|---|---|---|---|"
    described = _descriptions()
    for name in (item.name for item in fields(Tuning)):
        usual, fast, best = (_shown(getattr(TUNINGS[effort], name)) for effort in ("default", "fast", "best"))
        changed = [
            _bytes(found) if (found := effects.get((name, change, "default"))) else NOT_MEASURED
            for change in ("half", "double")
        ]
        others = ("" if other == usual else other for other in (fast, best))
        yield f"| `{name}` | {usual} | {' | '.join(others)} | {described[name]} | {' | '.join(changed)} |"


def _descriptions() -> dict[str, str]:
    """Return unit and description of each field, from the docstring of the class."""
    lines = (inspect.getdoc(Tuning) or "").split("Attributes\n----------\n")[1].splitlines()
    found: dict[str, str] = {}
    names: list[str] = []
    for line in lines:
        entry = ATTRIBUTE.match(line)
        if entry:
            names = entry["names"].split(", ")
            unit = re.search(r"\[.+\]", entry["kind"])
            found |= dict.fromkeys(names, unit[0] if unit else "")
        else:
            found |= {name: f"{found[name]} {line.strip()}".strip() for name in names}
    return found


def _shown(value: object) -> str:
    """Return a value as a person writes it: 2^16, 1/8, patch 64."""
    if isinstance(value, tuple):
        return ", ".join(_shown(item) if not isinstance(item, tuple) else _pair(item) for item in value) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if value is None or value == float("inf"):
        return "none" if value is None else "no limit"
    if isinstance(value, int | float) and value >= 2**13 and float(value).is_integer():
        odd, power = int(value), 0
        while odd % 2 == 0:
            odd, power = odd // 2, power + 1
        return f"{f'{odd} x ' if odd > 1 else ''}2^{power}"
    return f"{value:g}" if isinstance(value, float) else str(value)


def _pair(item: tuple[object, ...]) -> str:
    return " ".join(map(str, item)) if isinstance(item[0], str) else f"({', '.join(map(str, item))})"


def _percent(ratio: str) -> str:
    change = 100.0 * (float(ratio) - 1.0)
    return f"{change:+.1f} %" if abs(change) >= 0.05 else "0"


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(encoder_page(), encoding="utf-8")
