"""Records of what is done: one of each clip, in a folder beside the outputs.

A clip is done when its record says so, its output holds the bytes that the record names, and neither its options nor
its source have changed. Times of files are not trusted to tell that: where size, times and place of a source are as
they were it is taken to be the same (its change time is set by the system alone), else its bytes decide.

The record is written when the file is whole, and before the file takes its place: a run that is killed in between
leaves an output that does not fit its record, and the clip is coded again.
"""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pdecodec.errors import unreadable
from pdecodec.system.storage import RemoteFile, is_address
from pdecodec.system.whole_output import whole_file, write_errors

STATE_FOLDER = ".batch"
"""In the folder of the outputs."""

RECORD_VERSION = 1
"""Of what a record has in it: one of another version counts as none, and its clip is done again."""

_ALGORITHM = "blake2b"
"""Of the digests that tell whether a source is as it was."""

Place = Path | RemoteFile
"""Where a file is: here, or at an address."""


def place_of(folder: str, *steps: str) -> Place:
    """A file in a folder, which may be an address."""
    if is_address(folder):
        return RemoteFile("/".join((folder.rstrip("/"), *steps)))
    return Path(folder, *steps)


def is_there(place: Place) -> bool:
    """Whether there is a file, or a link that leads nowhere."""
    return place.exists() if isinstance(place, RemoteFile) else os.path.lexists(place)


def write_text(place: Place, text: str) -> None:
    """Write a text in UTF-8, with escapes of other bytes in names, whole or not at all, in place of what is there; a
    link is replaced. InputError where it cannot be written.
    """
    if isinstance(place, RemoteFile):
        place.write(text.encode(errors="backslashreplace"))
        return
    with write_errors(place):
        place.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(place, overwrite=True, through_links=False) as partial:
        partial.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")


def digest_of(path: Place) -> str:
    """Of the bytes of a file; InputError where it cannot be read."""
    try:
        with path.open("rb") as file:
            # IO[bytes], as places open files, lacks what file_digest reads by; every file of theirs has it.
            return hashlib.file_digest(file, _ALGORITHM).hexdigest()  # type: ignore[arg-type]
    except OSError as error:
        raise unreadable(error, path) from error


def digests_of(files: Sequence[Place]) -> list[list[str]]:
    """Name of each file, and digest of its bytes."""
    return [[path.name, digest_of(path)] for path in files]


def stamp_of(files: Sequence[Place]) -> list[list[Any]]:
    """Name, size, times and place on disk of each file, or what its storage says of it: equal only where nothing was
    written to it, or where None says that nothing is known.
    """
    found = []
    for path in files:
        if isinstance(path, RemoteFile):
            found.append(path.stamp())
            continue
        try:
            status = path.stat()
        except OSError as error:
            raise unreadable(error, path) from error
        found.append([path.name, status.st_size, status.st_mtime_ns, status.st_ctime_ns, status.st_ino])
    return found


@dataclass(frozen=True, kw_only=True)
class Record:
    """What a clip was made from, and what came of it.

    Attributes
    ----------
    source_digests : list
        As :func:`digests_of` gives them.
    source_stamp : list
        As :func:`stamp_of` gives it.
    options : dict
        Of the clip, as JSON.
    output_digest : str
    replaces : str
        Digest of the output that this one takes the place of; empty where there was none.
    result : dict
        Figures for the summary.
    """

    source_digests: list[list[str]]
    source_stamp: list[list[Any]]
    options: Mapping[str, Any]
    output_digest: str
    replaces: str = ""
    result: Mapping[str, Any] = field(default_factory=dict)


def record_place(folder: str, output: str) -> Place:
    """Where the record of an output is; folders by the first digits of its name's digest, so that none grows large."""
    name = hashlib.blake2b(output.encode("utf-8", "surrogateescape"), digest_size=16).hexdigest()
    return place_of(folder, STATE_FOLDER, name[:2], f"{name[2:]}.json")


def read_record(folder: str, output: str) -> Record | None:
    """The record of an output; None where there is none that can be read."""
    place = record_place(folder, output)
    try:
        data = place.read_bytes() if isinstance(place, Path) else place.read() if place.exists() else b""
        values = json.loads(data)
        if values.pop("version") != RECORD_VERSION or values.pop("output") != output:
            return None
        return Record(**values)
    except (OSError, ValueError, TypeError, KeyError, AttributeError, RecursionError):
        return None


def write_record(folder: str, output: str, record: Record) -> None:
    """Write the record of an output, whole or not at all.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_text(record_place(folder, output), json.dumps({"version": RECORD_VERSION, "output": output, **vars(record)}))
