"""Section SCEN: the file that the motion came from, in its own format, without the data that other sections hold.

It is a set of named streams, whose meaning depends on the format's family; :mod:`pdecodec.formats.base.carrying`
writes the motion back onto them.
"""

from __future__ import annotations

import json
import re
import zlib
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import zstandard

from pdecodec.codec.sections.bytestream import FieldReader, FieldWriter, section_fault
from pdecodec.codec.sections.description import unpack_frame
from pdecodec.errors import InputError, LimitError

if TYPE_CHECKING:
    from pdecodec.mesh.sequence import MeshSequence

CUTS = "cuts"
"""Name of the stream that says what was cut out of the files."""

MAX_CUTS = 2**28
"""Largest size of that stream when it is only passed on [bytes]."""

MAX_STREAMS = 2**16
"""Largest number of streams, of kinds of contents, and of outside paths."""

MAX_NAME_BYTES = 255
"""Largest length of a stream's name [bytes], as in most file systems."""

MAX_TEXT_BYTES = 2**12
"""Largest length of any other text [bytes]."""

MAX_SCENE_BYTES = 2**40
"""Largest size of all streams together [bytes]."""

LONG_DISTANCE_BYTES = 2**20
"""Size from which matches in a stream are searched at any distance [bytes]: textures and layers repeat far apart."""

LEVEL, LONGEST_WINDOW = 12, 27
"""zstandard level (19 saves 1 % of the carriers of the shared scenes), and the window's largest logarithm: 128 MiB,
which every zstandard decoder takes.
"""

_CONTROL = re.compile(r"[\x00-\x1f\x7f-\x9f]")


@dataclass(frozen=True)
class SceneStream:
    """A named stream, compressed; `checksum` is the CRC-32 of its content, of `size` bytes."""

    name: str
    size: int
    checksum: int
    packed: bytes

    @classmethod
    def of(cls, name: str, content: bytes) -> SceneStream:
        """Compress a content."""
        if not content:
            return cls(name, 0, 0, b"")
        far = len(content) >= LONG_DISTANCE_BYTES
        window = {"enable_ldm": True, "window_log": min(LONGEST_WINDOW, len(content).bit_length())} if far else {}
        parameters = zstandard.ZstdCompressionParameters.from_level(
            LEVEL, source_size=len(content), write_content_size=True, **window
        )
        packed = zstandard.ZstdCompressor(compression_params=parameters).compress(content)
        return cls(name, len(content), zlib.crc32(content), packed)

    def content(self) -> bytes:
        """Return the content; raise CorruptFileError if size or checksum do not match."""
        fault = section_fault("SCEN", f"holds a damaged stream, {self.name}; get the file again")
        try:
            declared = zstandard.frame_content_size(self.packed) if self.packed else 0
            if declared != self.size:
                raise fault
            found = unpack_frame(self.packed) if self.size else b""
        except zstandard.ZstdError as error:
            raise fault from error
        if len(found) != self.size or zlib.crc32(found) != self.checksum:
            raise fault
        return found


@dataclass(frozen=True)
class Carrier:
    """A scene that a file carries.

    Attributes
    ----------
    family : str
        Name of the format of the scene's files.
    contents : tuple of (str, int)
        Kinds of things that other sections do not hold, and how many there are of each.
    outside : tuple of str
        Files that the scene refers to, but that are not in it.
    streams : tuple of SceneStream
    """

    family: str
    contents: tuple[tuple[str, int], ...]
    outside: tuple[str, ...]
    streams: tuple[SceneStream, ...]

    @classmethod
    def of(
        cls, family: str, contents: Iterable[tuple[str, int]], outside: Sequence[str], files: Mapping[str, bytes]
    ) -> Carrier:
        """Compress files into a carrier; raise InputError if a carrier cannot hold a file's name."""
        for name in files:
            if fault := name_fault(name):
                raise InputError(f"the scene holds a file {name!r}, whose name {fault}", code="unsupported-feature")
        texts = tuple((_shown(kind), count) for kind, count in contents)
        streams = tuple(SceneStream.of(name, data) for name, data in files.items())
        return cls(family, texts[:MAX_STREAMS], tuple(map(_shown, outside))[:MAX_STREAMS], streams)

    def carrier(self, sequence: MeshSequence, *, exact_uvs: bool, fields: Collection[str]) -> Carrier:
        """Return itself, because the scene is passed on unchanged; raise InputError if it needs data that are
        coded otherwise.
        """
        if not exact_uvs:
            raise InputError("it needs the texture coordinates to the last bit", code="unsupported-feature")
        if absent := self._fields() - set(fields):
            raise InputError(f"it needs the field {min(absent)!r}", code="unsupported-feature")
        return self

    def of_some_objects(self) -> None:
        """Return None: a scene without the shapes of all other objects would be incomplete."""

    def _fields(self) -> set[str]:
        """Return the names of the fields that were cut out of the files, which are written anew."""
        try:
            (cuts,) = (json.loads(one.content()) for one in self.streams if one.name == CUTS and one.size <= MAX_CUTS)
            return {name for name in cuts.get("fields", ()) if isinstance(name, str)}
        except (ValueError, TypeError, AttributeError, RecursionError):
            return set()  # whoever writes the scene names the damage

    @property
    def size(self) -> int:
        """Bytes of all contents."""
        return sum(stream.size for stream in self.streams)

    def files(self, most: int) -> dict[str, bytes]:
        """Return the contents by name; LimitError if they take more than `most` bytes."""
        if self.size > most:
            raise LimitError(
                f"declares a scene of {self.size} bytes; the memory limit is {most}",
                code="memory-limit",
                limit="max_memory",
                section="SCEN",
            )
        return {stream.name: stream.content() for stream in self.streams}


def encode_scene(carrier: Carrier) -> bytes:
    """Return section SCEN."""
    writer = FieldWriter()
    writer.text(carrier.family)
    writer.count(len(carrier.contents))
    for kind, count in carrier.contents:
        writer.text(kind)
        writer.count(count)
    writer.count(len(carrier.outside))
    for path in carrier.outside:
        writer.text(path)
    writer.count(len(carrier.streams))
    for stream in carrier.streams:
        writer.text(stream.name)
        writer.count(stream.size)
        writer.count(len(stream.packed))
        writer.numbers("I", stream.checksum)
    return b"".join([writer.to_bytes(), *(stream.packed for stream in carrier.streams)])


def decode_scene(data: bytes) -> Carrier:
    """Undo :func:`encode_scene`; CorruptFileError if it breaks the format. Nothing is unpacked."""
    reader = FieldReader(data, "SCEN")
    family = _text(reader)
    if not family:
        raise section_fault("SCEN", "names no format")
    contents = tuple((_text(reader), reader.count()) for _ in range(_number(reader, 0)))
    outside = tuple(_text(reader) for _ in range(_number(reader, 0)))
    rows = []
    for _ in range(_number(reader, 1)):
        name = _text(reader)
        if fault := name_fault(name):
            raise section_fault("SCEN", f"has a stream {name[:40]!r}, whose name {fault}")
        size, length = reader.count(), reader.count()
        rows.append((name, size, length, reader.integers("I")[0]))
    names = {name.encode().lower() for name, *_ in rows}
    folders = {name.rsplit(b"/", depth)[0] for name in names for depth in range(1, 1 + name.count(b"/"))}
    if len(names) < len(rows) or names & folders:
        raise section_fault("SCEN", "has two streams of one name")
    if sum(size for _, size, _, _ in rows) > MAX_SCENE_BYTES:
        raise section_fault("SCEN", f"declares more than {MAX_SCENE_BYTES} bytes")
    streams = tuple(SceneStream(name, size, checksum, reader.take(length)) for name, size, length, checksum in rows)
    reader.finish()
    for stream in streams:
        if bool(stream.size) != bool(stream.packed) or not (stream.size or stream.checksum == 0):
            raise section_fault("SCEN", f"has a stream {stream.name} of no bytes that declares some")
    return Carrier(family, contents, outside, streams)


def scene_facts(carrier: Carrier, stored: int) -> dict[str, Any]:
    """Return the contents of a scene as a JSON object; `stored` is the size of its section in bytes."""
    return {
        "format": carrier.family,
        "bytes": stored,
        "unpacked_bytes": carrier.size,
        "contents": [{"kind": kind, "count": count} for kind, count in carrier.contents],
        "outside": list(carrier.outside),
        "streams": [{"name": one.name, "bytes": len(one.packed), "size": one.size} for one in carrier.streams],
    }


def _number(reader: FieldReader, least: int) -> int:
    found = reader.count()
    if not least <= found <= MAX_STREAMS:
        raise section_fault("SCEN", f"declares {found} entries of a list; {least} to {MAX_STREAMS} can be")
    return found


def _text(reader: FieldReader) -> str:
    length = reader.count()
    if length > MAX_TEXT_BYTES:
        raise section_fault("SCEN", f"has a text of {length} bytes; the most is {MAX_TEXT_BYTES}")
    try:
        text = reader.take(length).decode()
    except UnicodeDecodeError as error:
        raise section_fault("SCEN", "has a text that is not UTF-8") from error
    if _CONTROL.search(text):
        raise section_fault("SCEN", "has a text with control characters")
    return text


def _shown(text: str) -> str:
    """Return a text as a carrier can hold it: without control characters, and not too long."""
    return _CONTROL.sub("?", text).encode(errors="replace")[:MAX_TEXT_BYTES].decode(errors="ignore")


def name_fault(name: str) -> str | None:
    """Return what is wrong with the name of a stream, which must be the relative path of a file; None if it is
    valid.
    """
    try:
        size = len(name.encode())
    except UnicodeEncodeError:
        return "is not text that UTF-8 can hold"
    if not 0 < size <= MAX_NAME_BYTES:
        return f"has {size} bytes; 1 to {MAX_NAME_BYTES} can be"
    if _CONTROL.search(name) or set(name) & set('\\:*?"<>|'):
        return "holds a character that names of files do not have everywhere"
    if any(part in ("", ".", "..") or part != part.strip(" ").rstrip(".") for part in name.split("/")):
        return "is not the path of a file in a folder"
    return None
