"""Generate section 22 of the specification, a small file byte by byte, so that the text always matches the file.

python -m spec.example        print the section
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import ExitStack
from itertools import groupby
from typing import Any
from unittest.mock import patch

from spec.decoder.animation import decode
from spec.decoder.contexts import Contexts
from spec.decoder.fields import Fields
from spec.decoder.rangecoder import Rehearsal
from spec.sealing import HEADER, table_end, take_apart
from spec.vector_files import accepted_vectors

LONG_REPETITION = 12
MAX_SHARED_BYTES = 8
"""Bytes in a row that several fields share."""

Row = tuple[bytes, str]

FIELDS: dict[str, list[tuple[str, str]]] = {
    "SEQN": [
        ("count", "runs"),
        ("count", "frames"),
        ("u8", "flags: rule 1, rate is the frame rate, counts follow"),
        ("count", "frame rate"),
        ("count", "start"),
    ],
    "CONN": [("count", "object"), ("count", "vertices")],
    "REST": [("f64", "step"), ("f64", "origin x"), ("f64", "origin y"), ("f64", "origin z"), ("u8", "predictor")],
    "MODL": [
        ("u8", "space basis"),
        ("count", "points"),
        ("u8", "functions"),
        ("u8", "threshold"),
        ("f64", "step of residuals"),
    ],
    "GRUP": [
        ("count", "frames"),
        ("count", "functions of time"),
        ("u8", "kind"),
        ("f64", "step"),
        ("f64", "step of functions of time"),
        ("count", "bytes in TIME"),
        ("count", "bytes in COEF"),
        ("count", "bytes in CORR"),
        ("u32", "CRC-32 of these"),
    ],
    "TIME": [("u8", "method")],
    "COEF": [],
    "CORR": [],
}
"""Fields of each section before its coded stream."""


def decisions(data: bytes) -> dict[bytes, list[tuple[str, int]]]:
    """List what is decoded from each coded stream of a file: the word in the model's name, and the number or bit."""
    found: dict[bytes, list[tuple[str, int]]] = {}
    streams: dict[int, list[tuple[str, int]]] = {}
    is_inside = False

    def opened(contexts: Contexts, stream: bytes, *rest: Any) -> None:
        create(contexts, stream, *rest)
        streams[id(contexts)] = found.setdefault(stream, [])

    def noted(method: str) -> Callable[..., int]:
        usual = getattr(Contexts, method)

        def read(contexts: Contexts, *name: Any, **options: Any) -> int:
            nonlocal is_inside
            if is_inside or isinstance(contexts._coder, Rehearsal):
                return int(usual(contexts, *name, **options))
            is_inside = True
            value = int(usual(contexts, *name, **options))
            is_inside = False
            words = name[0] if method == "mixed" else name[1:] if method == "counted" else name
            word = next((str(word) for word in reversed(words) if isinstance(word, str)), "bypass")
            streams[id(contexts)].append((word, value))
            return value

        return read

    create = Contexts.__init__
    with ExitStack() as held:
        held.enter_context(patch.object(Contexts, "__init__", opened))
        for method in ("bit", "bypass", "mixed", "counted", "number", "signed"):
            held.enter_context(patch.object(Contexts, method, noted(method)))
        animation = decode(data)
        animation.motion.group(0)
    return found


def format_decisions(stream: list[tuple[str, int]]) -> str:
    """Format decisions: each word with its values, long repetitions as a count."""
    parts = []
    for word, several in groupby(stream, key=lambda decision: decision[0]):
        values = [value for _, value in several]
        if word == "texts":
            bits = "".join(map(str, values))
            characters = bytes(int(bits[k : k + 8], 2) for k in range(0, len(bits), 8))
            parts.append(f"text {characters[:-1].decode()!r} and 255")
        elif len(values) > LONG_REPETITION and len(set(values)) == 1:
            parts.append(f"{word} {values[0]} ({len(values)} times)")
        else:
            parts.append(f"{word} {' '.join(map(str, values))}")
    return ", ".join(parts)


def rows(data: bytes) -> Iterator[tuple[str, list[Row]]]:
    """Yield the parts of a file: the title of each, and its bytes with their meaning."""
    parts = take_apart(data)
    _, major, minor, count, *_ = HEADER.unpack_from(data)
    names = ("identifier", f"major version {major}", f"minor version {minor}", f"{count} sections")
    sizes = (12, 2, 2, 4, 4, 4)
    begins = [sum(sizes[:k]) for k in range(len(sizes))]
    meanings = (*names, "CRC-32 of the table", "CRC-32 of all before")
    header = [(data[at : at + n], said) for at, n, said in zip(begins, sizes, meanings, strict=True)]
    yield "Header", merge_short_fields(header)
    yield "Table", [(part.row, f"{part.kind}, required, {len(part.content)} bytes, CRC-32") for part in parts]
    assert sum(len(part.row) for part in parts) == table_end(parts) - HEADER.size
    streams = decisions(data)
    for part in parts:
        fields = Fields(part.content)
        found: list[Row] = []
        for kind, name in FIELDS[part.kind] if part.content else ():
            before = fields.position
            value = getattr(fields, kind)()
            said = f"{value:08X}" if kind == "u32" else f"{value:.9g}"
            found.append((part.content[before : fields.position], f"{name}: {said}"))
        found = merge_short_fields(found)
        stream = part.content[fields.position :]
        if stream:
            found.append((stream, format_decisions(streams[stream])))
        yield part.kind, found


def merge_short_fields(fields: list[Row]) -> list[Row]:
    """Merge short fields into common rows."""
    rows: list[Row] = []
    for some, said in fields:
        if rows and len(rows[-1][0]) + len(some) <= MAX_SHARED_BYTES:
            rows[-1] = rows[-1][0] + some, f"{rows[-1][1]}; {said}"
        else:
            rows.append((some, said))
    return rows


def section(data: bytes) -> str:
    """Return the text of the section."""
    written = ["| at | bytes | |", "|---|---|---|"]
    at = 0
    for title, several in rows(data):
        if not several:
            written.append(f"| {at} | | **{title}**: empty |")
        for number, (some, said) in enumerate(several):
            shown = some.hex(" ").upper()
            head = f"**{title}**: " if number == 0 else ""
            written.append(f"| {at} | `{shown}` | {head}{said} |")
            at += len(some)
    assert at == len(data)
    return "\n".join(written) + "\n"


if __name__ == "__main__":
    print(section(accepted_vectors()["example"]), end="")
