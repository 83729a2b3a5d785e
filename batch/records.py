"""Records of finished clips: one for each clip, in a folder next to the outputs.

A clip is done if its output has the bytes that its record names, and neither its options nor its source have changed.
Modification times alone do not prove that. If size, times and inode of a source are unchanged, the source counts as
unchanged (only the system sets the change time); otherwise its bytes decide.

The record is written when the file is complete, and before the file moves to its place. A run that is killed in between
leaves an output that does not match its record, and the clip is encoded again.
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
"""Name of the folder of records, in the folder of the outputs."""

RECORD_VERSION = 1
"""Version of the contents of records; a record of another version is ignored, and its clip is done again."""

_ALGORITHM = "blake2b"
"""Algorithm of the digests that tell whether a source is unchanged."""

Place = Path | RemoteFile
"""Where a file is: a local path, or an address."""


def place_of(folder: str, *steps: str) -> Place:
    """Return the place of a file in a folder, which may be an address."""
    if is_address(folder):
        return RemoteFile("/".join((folder.rstrip("/"), *steps)))
    return Path(folder, *steps)


def is_there(place: Place) -> bool:
    """Return whether there is a file, or a broken link."""
    return place.exists() if isinstance(place, RemoteFile) else os.path.lexists(place)


def write_text(place: Place, text: str) -> None:
    """Write a text atomically in UTF-8, other bytes of names escaped; replace a file or a link.

    Raises InputError if it cannot be written.
    """
    if isinstance(place, RemoteFile):
        place.write(text.encode(errors="backslashreplace"))
        return
    with write_errors(place):
        place.parent.mkdir(parents=True, exist_ok=True)
    with whole_file(place, overwrite=True, through_links=False) as partial:
        partial.write_text(text, encoding="utf-8", errors="backslashreplace", newline="")


def digest_of(path: Place) -> str:
    """Return the digest of the bytes of a file; raise InputError if it cannot be read."""
    try:
        with path.open("rb") as file:
            # The type IO[bytes], which places return, lacks a method that file_digest needs; all files that they open
            # have it.
            return hashlib.file_digest(file, _ALGORITHM).hexdigest()  # type: ignore[arg-type]
    except OSError as error:
        raise unreadable(error, path) from error


def digests_of(files: Sequence[Place]) -> list[list[str]]:
    """Return the name of each file with the digest of its bytes."""
    return [[path.name, digest_of(path)] for path in files]


def stamp_of(files: Sequence[Place]) -> list[list[Any]]:
    """Return name, size, times and inode of each file, or for a remote file the data that its storage reports.

    Equal stamps mean that nothing was written in between, unless they contain None for an unknown value.
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
    """The inputs of a clip that is done, and its results.

    Attributes
    ----------
    source_digests : list
        As from :func:`digests_of`.
    source_stamp : list
        As from :func:`stamp_of`.
    options : dict
        Options of the clip, as JSON.
    output_digest : str
    replaces : str
        Digest of the output that this one replaces; empty if there was none.
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
    """Return the place of an output's record; its folder is named by a digest, to keep folders small."""
    name = hashlib.blake2b(output.encode("utf-8", "surrogateescape"), digest_size=16).hexdigest()
    return place_of(folder, STATE_FOLDER, name[:2], f"{name[2:]}.json")


def read_record(folder: str, output: str) -> Record | None:
    """Return the record of an output; None if there is none, or it cannot be read."""
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
    """Write the record of an output atomically.

    Raises
    ------
    InputError
        If it cannot be written.
    """
    write_text(record_place(folder, output), json.dumps({"version": RECORD_VERSION, "output": output, **vars(record)}))
