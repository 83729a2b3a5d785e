"""Read VTK and ParaView files that list other files: parts of a data set (PVTU, PVTP, VTM), time steps (PVD,
.series).
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from pdecodec.errors import InputError, damaged
from pdecodec.formats.vtk.motion import quoted
from pdecodec.system.reading import FileScope, open_regular, read_regular

PARTS = {".pvtu": "PUnstructuredGrid", ".pvtp": "PPolyData", ".vtm": "vtkMultiBlockDataSet"}
"""XML types of files that list parts, by extension."""


@dataclass(frozen=True)
class Entry:
    """A listed file and its time; `part` identifies the part it holds, None if the list does not say."""

    time: float
    file: Path
    part: str | None


def listed_parts(path: Path, scope: FileScope) -> list[Path]:
    """Return the files of the parts of a data set.

    Raises
    ------
    InputError
        If the list is damaged, of another type or empty, or a listed file is missing or outside the scope.
    """
    kind = PARTS[path.suffix.lower()]
    try:
        root = _root(path)
        found = root.find(kind)
        if root.get("type") != kind or found is None:
            raise ValueError(f"its type is {root.get('type')}")
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise damaged(f"is not a {path.suffix[1:]} file, or is damaged ({error}); write it again", path=path) from error
    names = [one.get("Source", "") for one in found.findall("Piece")]
    if kind == PARTS[".vtm"]:
        # A block without data has no file.
        names = [one.get("file", "") for one in found.iter("DataSet") if one.get("file")]
    if not names:
        raise damaged("lists no files; write it again", path=path)
    files = [scope.checked(name, path.parent) for name in names]
    missing = [name for name, file in zip(names, files, strict=True) if not name or not file.exists()]
    if missing:
        raise InputError(f"lists {missing[0]!r}, which is missing; restore that file", code="file-missing", path=path)
    return files


def _root(path: Path) -> ElementTree.Element:
    with open_regular(path) as file:
        return ElementTree.parse(file).getroot()


def read_pvd(path: Path, scope: FileScope) -> tuple[list[float], list[list[Path]]]:
    """Return the times [s] of a PVD file, and for each time the files of its parts in order.

    Raises
    ------
    InputError
        If it is damaged, several files have the same part and time, or one is outside the scope.
    """
    try:
        rows = _root(path).findall("./Collection/DataSet")
        found = [
            (
                float(row.get("timestep", "nan")),
                row.get("file", ""),
                row.get("part"),
                row.get("group") or row.get("name"),
            )
            for row in rows
        ]
    except (ElementTree.ParseError, OSError, ValueError) as error:
        raise damaged(f"is not a PVD file, or is damaged ({error}); write it again", path=path) from error
    entries = [
        Entry(time, scope.checked(file, path.parent), None if part is None else f"{group or ''} {part}".strip())
        for time, file, part, group in found
        if file
    ]
    if len(entries) < len(found) or not entries or any(not math.isfinite(entry.time) for entry in entries):
        raise damaged("lists no files with times; write it again", path=path)
    return _by_time(entries, path)


def read_series(path: Path, scope: FileScope) -> tuple[list[float] | None, list[list[Path]]]:
    """Return the times [s] of a ParaView file series, None if it has none, and the file of each step.

    Raises
    ------
    InputError
        If it is damaged, several files have the same time, or one is outside the scope.
    """
    try:
        files = json.loads(read_regular(path))["files"]
        found = [(str(one["name"]), None if one.get("time") is None else float(one["time"])) for one in files]
    except (ArithmeticError, OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise damaged(f"is not a file series, or is damaged ({error}); write it again", path=path) from error
    times = [time for _, time in found if time is not None]
    if not found or 0 < len(times) < len(found) or not all(map(math.isfinite, times)):
        raise damaged("lists no files with times; write it again", path=path)
    listed = [scope.checked(name, path.parent) for name, _ in found]
    if not times:
        return None, [[file] for file in listed]
    entries = [Entry(time, file, "0") for file, time in zip(listed, times, strict=True)]
    return _by_time(entries, path)


def _by_time(entries: Sequence[Entry], path: Path) -> tuple[list[float], list[list[Path]]]:
    """Return sorted times, and the files of each.

    Files with the same time are its parts if the list numbers them as parts, or if it has no part numbers but the
    same number of files for every time. Otherwise their times were probably rounded, and the steps cannot be told
    apart.
    """
    at: dict[float, list[Entry]] = {}
    for entry in entries:
        at.setdefault(entry.time, []).append(entry)
    unequal = len({len(found) for found in at.values()}) > 1
    for time, found in at.items():
        parts: dict[str | None, list[Entry]] = {}
        for entry in found:
            parts.setdefault(entry.part, []).append(entry)
        for part, same in parts.items():
            if len(same) > 1 and (part is not None or unequal):
                names = quoted(entry.file.name for entry in same[:4])
                more = "" if len(same) <= 4 else ", ..."
                raise InputError(
                    f"{len(same)} files of one part are at one time, {time!r} ({names}{more}): were their times "
                    "rounded? Give each step its own time",
                    code="invalid-times",
                    path=path,
                )
    times = sorted(at)
    return times, [[entry.file for entry in at[time]] for time in times]


def named_files(path: Path) -> Iterator[Path]:
    """Yield the files that a list names, and recursively the files named in lists among them; nothing for
    damaged lists.
    """
    scope, left, seen = FileScope(path), [path], {path}
    while left:
        one = left.pop()
        suffix = one.suffix.lower()
        try:
            if suffix in (".pvd", ".series") and one == path:
                read = read_pvd if suffix == ".pvd" else read_series
                files = [file for frame in read(path, scope)[1] for file in frame]
            else:
                files = listed_parts(one, scope) if suffix in PARTS else []
        except InputError:
            continue
        files = [file for file in dict.fromkeys(files) if file not in seen]
        seen.update(files)
        left += files
        yield from files


def named_by_xdmf(path: Path) -> Iterator[str]:
    """Yield the names of the data files that an XDMF file refers to, and of the files that it includes."""
    for item in _root(path).iter():
        if item.get("Format", "").upper() in ("HDF", "BINARY"):
            yield (item.text or "").strip().partition(":")[0]
        elif str(item.tag).endswith("}include"):
            yield item.get("href", "")
